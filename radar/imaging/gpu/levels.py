"""The tree of boxes on a device: the weights, phases and antennas of the boxes of one level, padded
to common sizes, so that a few batched products compute the samples of all boxes.

The padding is zero: samples of tones and antennas that a box does not have are zero and add nothing
to an image.
"""

from collections.abc import Callable
from types import ModuleType

import numpy as np

from handbench.radar.imaging.device import BLOCK_BYTES, Array, cis, distances
from handbench.radar.imaging.plan import TreePlan
from handbench.radar.imaging.tree import NodeStack

CHILD_BYTES = 32  # per sample of the parent: it is copied, turned and mixed


def level(
    xp: ModuleType, nodes: NodeStack, turns_per_m: np.ndarray, parent: np.ndarray
) -> Callable[[Array], Array]:
    """Copy the n nodes of one level of the tree to a device with the array module xp, and return
    the function that computes their samples, complex64 [n, k, a, b], from the samples S of all
    boxes of the level above, [n', k', a', b']: L (S e^{jφ}) on the tones, X S Yᵀ on the antennas.

    turns_per_m [n', k']: f/c of the tones of the level above; parent [n]: index of each node's
    parent there. The phases φ move the reference from the parent's centre to the box's.
    """
    turns, parent = xp.asarray(turns_per_m[parent][:, :, None]), xp.asarray(parent)
    (a, shift_a, _, _), (b, shift_b, _, _) = nodes.legs
    to, back = (cis(xp, turns * xp.asarray(shift_m[:, None])) for shift_m in (shift_a, shift_b))
    host = (nodes.tone_weights, a[:, None], np.ascontiguousarray(b.swapaxes(1, 2)))
    of_tones, of_a, of_b = (xp.asarray(weights, dtype=np.complex64) for weights in host)

    def descend(samples: Array) -> Array:
        block = max(BLOCK_BYTES // (CHILD_BYTES * int(np.prod(samples.shape[1:]))), 1)
        parts = []
        for start in range(0, len(parent), block):
            here = slice(start, start + block)
            turned = samples[parent[here]]
            turned *= to[here, :, :, None]
            turned *= back[here, :, None]
            n, k, a, b = turned.shape
            mixed = xp.matmul(of_tones[here], turned.reshape(n, k, a * b))
            fewer = xp.matmul(mixed.reshape(n, -1, b), of_b[here])
            parts.append(xp.matmul(of_a[here], fewer.reshape(n, mixed.shape[1], a, -1)))
        return xp.concatenate(parts)

    return descend


def leaf_legs(
    xp: ModuleType, leaves: NodeStack, plan: TreePlan
) -> list[tuple[float, Array, Array]]:
    """Copy the antennas of n leaves of the plan to a device, float64: for transmitters and for
    receivers, how often a path passes them, positions [3, n, l] and paths to the leaf's centre
    [n, l]. The last of the l antennas is a reference point, the mean position of all antennas of
    that leg."""
    legs = []
    passes_of = plan.passes.tolist()
    for leg, passes, reference_m in zip(leaves.legs, passes_of, plan.reference_m, strict=True):
        _, _, length_m, position_m = leg
        references_m = np.broadcast_to(reference_m, (len(length_m), 1, 3))
        to_reference_m = passes * distances(np, leaves.centre_m.T, reference_m)
        position_m = np.concatenate([position_m, references_m], axis=1)
        length_m = np.concatenate([length_m, to_reference_m[:, None]], axis=1)
        position_m = np.moveaxis(position_m, 2, 0).copy()
        legs.append((passes, xp.asarray(position_m), xp.asarray(length_m)))
    return legs


def waves(
    xp: ModuleType,
    turns_per_m: Array,
    legs: list[tuple[float, Array, Array]],
    leaves: Array,
    points_m: Array,
) -> tuple[Array, Array]:
    """Compute the waves e^{jkΔR} of the antennas of leaves [m] at p points of each, points_m [3, m,
    p]: complex64 [m, k, a, p] and [m, k, b, p]. turns_per_m [n, k]: f/c of the tones of all leaves;
    legs: their antennas (`leaf_legs`).

    Path differences to the reference point are computed in float64, and the phases of these
    remainders in float32; the second factor has the reference's own phase.
    """
    turns_per_m = turns_per_m[leaves][:, :, None]
    shared_m, factors = 0.0, []
    for passes, position_m, length_m in legs:
        path_m = distances(xp, points_m[:, :, None], position_m[:, leaves][..., None])
        path_m *= passes
        path_m -= length_m[leaves][..., None]
        reference_m = path_m[:, -1:]
        shared_m = shared_m + reference_m
        remainder_m = (path_m[:, :-1] - reference_m).astype(np.float32)
        factors.append(cis(xp, turns_per_m[..., None].astype(np.float32) * remainder_m[:, None]))
    return factors[0], factors[1] * cis(xp, turns_per_m * shared_m)[:, :, None]

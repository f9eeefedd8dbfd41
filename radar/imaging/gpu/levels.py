"""The tree of boxes on a device: the weights, phases and antennas of the boxes of one level, padded
to common sizes, so that a few batched products compute the samples of all boxes.

The padding is zero: samples of tones and antennas that a box does not have are zero and add nothing
to an image.
"""

from types import ModuleType
from typing import NamedTuple

import numpy as np

from handbench.radar.imaging.device import BLOCK_BYTES, Array, cis, distances
from handbench.radar.imaging.plan import TreePlan
from handbench.radar.imaging.tree import NodeStack

CHILD_BYTES = 32  # per sample of the parent: it is copied, turned and mixed


class Level(NamedTuple):
    """The n boxes of one level of the tree, as arrays on a device. A box has k tones, a
    transmitters and b receivers; its parent, in the level above, has k', a', b'.

    parent [n]: row of each box's parent in the level above. Complex64: phases [n, k', a', 1] and
    [n, k', 1, b'] from the parent's centre to the box's; weights of the tones [n, k, k'], of the
    transmitters [n, 1, a, a'] and of the receivers [n, b', b] (transposed).
    """

    parent: Array
    phases: tuple[Array, Array]
    weights: tuple[Array, Array, Array]


def level(xp: ModuleType, nodes: NodeStack, turns_per_m: np.ndarray, parent: np.ndarray) -> Level:
    """Copy nodes (boxes of one level of the tree, with tones, antennas and weights) to a device
    whose array module is xp. turns_per_m [n', k']: f/c of the tones of the n' boxes of the level
    above; parent [n]: index of each node's parent among these."""
    turns = xp.asarray(turns_per_m[parent][:, :, None])
    (a, shift_a, _, _), (b, shift_b, _, _) = nodes.legs
    to, back = (cis(xp, turns * xp.asarray(shift_m[:, None])) for shift_m in (shift_a, shift_b))
    host = (nodes.tone_weights, a[:, None], np.ascontiguousarray(b.swapaxes(1, 2)))
    tones, a, b = (xp.asarray(weights, dtype=np.complex64) for weights in host)
    return Level(xp.asarray(parent), (to[..., None], back[:, :, None]), (tones, a, b))


def descend(xp: ModuleType, level: Level, samples: Array) -> Array:
    """Compute the samples of the level's boxes, complex64 [n, k, a, b], from the samples S of all
    boxes of the level above, [n', k', a', b']: L (S e^{jφ}) on the tones, X S Yᵀ on the
    antennas."""
    block = max(BLOCK_BYTES // (CHILD_BYTES * int(np.prod(samples.shape[1:]))), 1)
    parts = []
    for start in range(0, len(level.parent), block):
        here = slice(start, start + block)
        tone_weights, weights_a, weights_b = (weights[here] for weights in level.weights)
        turned = samples[level.parent[here]]
        turned *= level.phases[0][here]
        turned *= level.phases[1][here]
        n, k, a, b = turned.shape
        mixed = xp.matmul(tone_weights, turned.reshape(n, k, a * b))
        fewer = xp.matmul(mixed.reshape(n, -1, b), weights_b).reshape(n, mixed.shape[1], a, -1)
        parts.append(xp.matmul(weights_a, fewer))
    return xp.concatenate(parts)


class LeafAntennas(NamedTuple):
    """The k tones and the antennas of n leaves, as float64 arrays on a device.

    turns_per_m [n, k] = f/c; legs: of transmitters and of receivers the positions [3, n, l] and the
    paths to the leaf's centre [n, l]. The last of the l antennas is a reference point, the mean
    position of all antennas of that leg.
    """

    turns_per_m: Array
    legs: list[tuple[Array, Array]]


def leaf_antennas(xp: ModuleType, leaves: NodeStack, plan: TreePlan) -> LeafAntennas:
    """Copy the tones and antennas of the plan's leaves to a device."""
    legs = []
    for leg, passes, reference_m in zip(leaves.legs, plan.passes, plan.reference_m, strict=True):
        _, _, length_m, position_m = leg
        references_m = np.broadcast_to(reference_m, (len(length_m), 1, 3))
        to_reference_m = passes * distances(np, leaves.centre_m.T, reference_m)
        position_m = np.concatenate([position_m, references_m], axis=1)
        length_m = np.concatenate([length_m, to_reference_m[:, None]], axis=1)
        legs.append((xp.asarray(np.moveaxis(position_m, 2, 0).copy()), xp.asarray(length_m)))
    return LeafAntennas(xp.asarray(leaves.turns_per_m), legs)


def waves(
    xp: ModuleType, antennas: LeafAntennas, passes: np.ndarray, leaves: Array, points_m: Array
) -> tuple[Array, Array]:
    """Compute the waves e^{jkΔR} of the antennas of leaves [m] at p points of each, points_m [3, m,
    p]: complex64 [m, k, a, p] and [m, k, b, p].

    Path differences to the reference point are computed in float64, and the phases of these
    remainders in float32; the second factor has the reference's own phase. passes [2]: how often
    the path passes each leg.
    """
    turns_per_m = antennas.turns_per_m[leaves][:, :, None]
    shared_m, factors = 0.0, []
    for count, (position_m, length_m) in zip(passes.tolist(), antennas.legs, strict=True):
        path_m = distances(xp, points_m[:, :, None], position_m[:, leaves][..., None])
        path_m *= count
        path_m -= length_m[leaves][..., None]
        reference_m = path_m[:, -1:]
        shared_m = shared_m + reference_m
        remainder_m = (path_m[:, :-1] - reference_m).astype(np.float32)
        factors.append(cis(xp, turns_per_m[..., None].astype(np.float32) * remainder_m[:, None]))
    return factors[0], factors[1] * cis(xp, turns_per_m * shared_m)[:, :, None]

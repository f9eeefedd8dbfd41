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
from handbench.radar.imaging.tree import Node

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


def level(xp: ModuleType, nodes: list[Node], above: list[Node], parent: np.ndarray) -> Level:
    """Copy nodes (boxes of one level of the tree, with tones, antennas and weights) to a device
    whose array module is xp. above: nodes of the level above; parent [n]: index of each node's
    parent among them."""
    turns_per_m = xp.asarray(_padded([above[i].turns_per_m for i in parent])[:, :, None])
    to, back = (
        cis(xp, turns_per_m * xp.asarray(_padded([node.shifts_m[leg] for node in nodes])[:, None]))
        for leg in (0, 1)
    )
    tones = _weights([(node.tone_weights, len(node.turns_per_m)) for node in nodes])
    a, b = (
        _weights([(node.leg_weights[leg], len(node.legs[leg].length_m)) for node in nodes])
        for leg in (0, 1)
    )
    weights = (tones, a[:, None], np.ascontiguousarray(b.swapaxes(1, 2)))
    tones, a, b = map(xp.asarray, weights)
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


def leaf_antennas(xp: ModuleType, leaves: list[Node], plan: TreePlan) -> LeafAntennas:
    """Copy the tones and antennas of the plan's leaves to a device."""
    centre_m = np.stack([leaf.box.centre_m for leaf in leaves])
    legs = []
    for leg, (passes, reference_m) in enumerate(zip(plan.passes, plan.reference_m, strict=True)):
        position_m = _padded([leaf.legs[leg].position_m for leaf in leaves])
        length_m = _padded([leaf.legs[leg].length_m for leaf in leaves])
        references_m = np.broadcast_to(reference_m, (len(leaves), 1, 3))
        to_reference_m = passes * distances(np, centre_m.T, reference_m)
        position_m = np.concatenate([position_m, references_m], axis=1)
        length_m = np.concatenate([length_m, to_reference_m[:, None]], axis=1)
        legs.append((xp.asarray(np.moveaxis(position_m, 2, 0).copy()), xp.asarray(length_m)))
    return LeafAntennas(xp.asarray(_padded([leaf.turns_per_m for leaf in leaves])), legs)


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


def _weights(weights: list[tuple[np.ndarray, int]]) -> np.ndarray:
    """Stack the boxes' weights of one axis, padded: complex64 [n, size, parent's size]. weights:
    for each box its weights, empty if the axis is unchanged, and the size of the axis."""
    full = [array if array.size else np.eye(size) for array, size in weights]
    return _padded(full).astype(np.complex64)


def _padded(arrays: list[np.ndarray]) -> np.ndarray:
    """Stack arrays of different shapes, each padded with zeros to the largest size along each axis:
    float64 [n, ...]."""
    stacked = np.zeros((len(arrays), *np.max([array.shape for array in arrays], axis=0)))
    for row, array in zip(stacked, arrays, strict=True):
        row[tuple(map(slice, array.shape))] = array
    return stacked

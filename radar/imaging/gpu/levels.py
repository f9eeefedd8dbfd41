"""One level of the tree of boxes on a device: the weights and phases of its boxes, padded to common
sizes, so that a few batched products compute the samples of all boxes.

The padding is zero: samples of tones and antennas that a box does not have are zero and add nothing
to an image.
"""

from dataclasses import dataclass, replace
from types import ModuleType

import numpy as np

from handbench.radar.imaging.device import BLOCK_BYTES, Array, cis, distances
from handbench.radar.imaging.tree import Node

CHILD_BYTES = 32  # per sample of the parent: it is copied, turned and mixed


@dataclass(frozen=True)
class Level:
    """The n boxes of one level of the tree, as arrays on a device. A box has k tones, a
    transmitters and b receivers; its parent, in the level above, has k', a', b'.

    parent [n]: row of each box's parent in the level above. Complex64: phases [n, k', a', 1] and
    [n, k', 1, b'] from the parent's centre to the box's, tone_weights [n, k, k'], weights_a [n, 1,
    a, a'], weights_b [n, b', b] (transposed); None where no box changes that axis. xp: numpy or
    cupy.
    """

    xp: ModuleType
    parent: Array
    phases: tuple[Array, Array]
    tone_weights: Array | None
    weights_a: Array | None
    weights_b: Array | None

    def of(self, rows: np.ndarray) -> "Level":
        """Return the level with only the boxes of these rows [m]."""
        if np.array_equal(rows, np.arange(len(self.parent))):
            return self
        chosen = self.xp.asarray(rows)
        return replace(
            self,
            parent=self.parent[chosen],
            phases=(self.phases[0][chosen], self.phases[1][chosen]),
            tone_weights=_rows(self.tone_weights, chosen),
            weights_a=_rows(self.weights_a, chosen),
            weights_b=_rows(self.weights_b, chosen),
        )

    def descend(self, samples: Array) -> Array:
        """Compute the samples of the level's boxes from those of all boxes of the level above,
        [n', k', a', b']: complex64 [n, k, a, b]."""
        count = len(self.parent)
        block = max(BLOCK_BYTES // (CHILD_BYTES * int(np.prod(samples.shape[1:]))), 1)
        parts = [
            self._descend(samples, slice(start, start + block)) for start in range(0, count, block)
        ]
        return parts[0] if len(parts) == 1 else self.xp.concatenate(parts)

    def _descend(self, samples: Array, rows: slice) -> Array:
        samples = samples[self.parent[rows]]
        samples *= self.phases[0][rows]
        samples *= self.phases[1][rows]
        n, k, a, b = samples.shape
        if self.tone_weights is not None:
            mixed = self.xp.matmul(self.tone_weights[rows], samples.reshape(n, k, a * b))
            k = mixed.shape[1]
            samples = mixed.reshape(n, k, a, b)
        if self.weights_b is not None:
            fewer = self.xp.matmul(samples.reshape(n, k * a, b), self.weights_b[rows])
            samples = fewer.reshape(n, k, a, -1)
        if self.weights_a is not None:
            samples = self.xp.matmul(self.weights_a[rows], samples)
        return samples


def _rows(weights: Array | None, rows: Array) -> Array | None:
    return None if weights is None else weights[rows]


def level(xp: ModuleType, nodes: list[Node], above: list[Node], parent: list[int]) -> Level:
    """Copy nodes (boxes of one level of the tree, with tones, antennas and weights) to a device as
    a `Level`. above: nodes of the level above; parent [n]: index of each node's parent among
    them."""
    shifts = [_padded([node.shifts_m[leg] for node in nodes]) for leg in (0, 1)]
    turns_above = _padded([above[i].turns_per_m for i in parent])
    phases = [
        cis(xp, xp.asarray(turns_above[:, :, None]) * xp.asarray(shift[:, None]))
        for shift in shifts
    ]
    tones = [len(node.turns_per_m) for node in nodes]
    tone_weights = _weights([node.tone_weights for node in nodes], tones)
    counts = [[len(node.legs[leg].length_m) for node in nodes] for leg in (0, 1)]
    weights_a, weights_b = (
        _weights([node.leg_weights[leg] for node in nodes], counts[leg]) for leg in (0, 1)
    )
    return Level(
        xp=xp,
        parent=xp.asarray(np.array(parent)),
        phases=(phases[0][..., None], phases[1][:, :, None]),
        tone_weights=None if tone_weights is None else xp.asarray(tone_weights),
        weights_a=None if weights_a is None else xp.asarray(weights_a[:, None]),
        weights_b=None
        if weights_b is None
        else xp.asarray(np.ascontiguousarray(weights_b.swapaxes(1, 2))),
    )


@dataclass(frozen=True)
class BoxAntennas:
    """The tones and antennas of n boxes, as arrays on a device: k tones, and together l antennas,
    the a transmitters followed by a reference point (their mean position before thinning), and the
    b receivers followed by theirs.

    Float64: turns_per_m [n, k] = f/c, position_m [3, n, l], length_m [n, l], the path between
    antenna and the box's centre, and passes [l, 1], how often the path passes the antenna's leg.
    transmitters: a. xp: numpy or cupy.
    """

    xp: ModuleType
    turns_per_m: Array
    position_m: Array
    length_m: Array
    passes: Array
    transmitters: int

    def waves(self, boxes: Array, points_m: Array) -> tuple[Array, Array]:
        """Compute the factors with which samples of boxes [m] are summed to images at p points of
        each, points_m [3, m, p]: complex64 [m, k, a, p] and [m, k, b, p].

        Path differences to the reference point are computed in float64, and the phases of these
        remainders in float32; the second factor has the reference's own phase.
        """
        xp, a = self.xp, self.transmitters
        path_m = distances(xp, points_m[:, :, None], self.position_m[:, boxes][..., None])
        path_m *= self.passes
        path_m -= self.length_m[boxes][..., None]
        to_m, back_m = path_m[:, :a], path_m[:, a + 1 : -1]
        shared_m = path_m[:, a] + path_m[:, -1]
        to_m -= path_m[:, a, None]
        back_m -= path_m[:, -1:]
        turns_per_m = self.turns_per_m[boxes][:, :, None]
        common = cis(xp, turns_per_m * shared_m[:, None])[:, :, None]
        turns_per_m, path_m = turns_per_m[..., None].astype(np.float32), path_m.astype(np.float32)
        waves = cis(xp, turns_per_m * path_m[:, None])
        return xp.ascontiguousarray(waves[:, :, :a]), waves[:, :, a + 1 : -1] * common


def box_antennas(
    xp: ModuleType, nodes: list[Node], passes: np.ndarray, reference_m: np.ndarray
) -> BoxAntennas:
    """Copy the tones and antennas of nodes (boxes of one level of the tree) to a device. passes
    [2], reference_m [2, 3]: how often the path passes each of the two legs, and their reference
    points, from `plan.carriers`."""
    centre_m = np.stack([node.box.centre_m for node in nodes])
    positions, lengths, counts = [], [], []
    for leg, (count, reference) in enumerate(zip(passes, reference_m, strict=True)):
        position_m = _padded([node.legs[leg].position_m for node in nodes])
        length_m = _padded([node.legs[leg].length_m for node in nodes])
        to_reference_m = count * distances(np, centre_m.T, reference)
        at = np.broadcast_to(reference, (len(nodes), 1, 3))
        positions.append(np.concatenate([position_m, at], axis=1))
        lengths.append(np.concatenate([length_m, to_reference_m[:, None]], axis=1))
        counts.append(np.full((lengths[-1].shape[1], 1), count))
    joined_m = np.concatenate(positions, axis=1)
    return BoxAntennas(
        xp=xp,
        turns_per_m=xp.asarray(_padded([node.turns_per_m for node in nodes])),
        position_m=xp.asarray(np.ascontiguousarray(np.moveaxis(joined_m, 2, 0))),
        length_m=xp.asarray(np.concatenate(lengths, axis=1)),
        passes=xp.asarray(np.concatenate(counts)),
        transmitters=lengths[0].shape[1] - 1,
    )


def _weights(weights: list[np.ndarray], counts: list[int]) -> np.ndarray | None:
    """Stack the nodes' weights of one axis, padded: complex64 [n, size, parent's size]; None if all
    are empty, which stands for an unchanged axis. counts [n]: sizes of the axis."""
    if not any(array.size for array in weights):
        return None
    full = [w if w.size else np.eye(count) for w, count in zip(weights, counts, strict=True)]
    return _padded(full).astype(np.complex64)


def _padded(arrays: list[np.ndarray]) -> np.ndarray:
    """Stack arrays of different shapes, each padded with zeros to the largest size along each axis:
    float64 [n, ...]."""
    stacked = np.zeros((len(arrays), *np.max([array.shape for array in arrays], axis=0)))
    for row, array in zip(stacked, arrays, strict=True):
        row[tuple(map(slice, array.shape))] = array
    return stacked

"""One level of the tree of boxes on a device: the weights and phases of its boxes, padded to common
sizes, so that a few batched products compute the samples of all boxes.

The padding is zero: samples of tones and antennas that a box does not have are zero and add nothing
to an image.
"""

from dataclasses import dataclass
from types import ModuleType

import numpy as np

from handbench.radar.imaging.device import BLOCK_BYTES, Array, cis
from handbench.radar.imaging.tree import Node

CHILD_BYTES = 32  # per sample of the parent: it is copied, turned and mixed


@dataclass(frozen=True)
class Level:
    """The n boxes of one level of the tree, as arrays on a device. A box has k tones, a
    transmitters and b receivers; its parent, in the level above, has k', a', b'.

    parent [n]: row of each box's parent in the level above. Complex64: phases [n, k', a'] and [n,
    k', b'] from the parent's centre to the box's, tone_weights [n, k, k'], weights_a [n, a, a'],
    weights_b [n, b', b] (transposed). Float64: turns_per_m [n, k] = f/c, centre_m [3, n], and for
    transmitters and receivers position_m [3, n, a] and length_m [n, a], the path between antenna
    and centre. xp: numpy or cupy.
    """

    xp: ModuleType
    parent: Array
    phases: tuple[Array, Array]
    tone_weights: Array
    weights_a: Array
    weights_b: Array
    turns_per_m: Array
    centre_m: Array
    position_m: tuple[Array, Array]
    length_m: tuple[Array, Array]

    def descend(self, samples: Array, rows: Array) -> Array:
        """Compute the samples of the level's boxes with these rows [m] from those of all boxes of
        the level above, [n', k', a', b']: complex64 [m, k, a, b]."""
        block = max(BLOCK_BYTES // (CHILD_BYTES * int(np.prod(samples.shape[1:]))), 1)
        parts = [
            self._descend(samples, rows[start : start + block])
            for start in range(0, len(rows), block)
        ]
        return self.xp.concatenate(parts)

    def _descend(self, samples: Array, rows: Array) -> Array:
        turned = samples[self.parent[rows]]
        n, k, a, b = turned.shape
        turned *= self.phases[0][rows][:, :, :, None]
        turned *= self.phases[1][rows][:, :, None, :]
        mixed = self.xp.matmul(self.tone_weights[rows], turned.reshape(n, k, a * b))
        k = mixed.shape[1]
        fewer = self.xp.matmul(mixed.reshape(n, k * a, b), self.weights_b[rows]).reshape(
            n, k, a, -1
        )
        return self.xp.matmul(self.weights_a[rows][:, None], fewer)


def level(xp: ModuleType, nodes: list[Node], above: list[Node], parent: list[int]) -> Level:
    """Copy nodes (boxes of one level of the tree, with tones, antennas and weights) to a device as
    a `Level`. above: nodes of the level above; parent [n]: index of each node's parent among
    them."""
    shifts = [_padded([node.shifts_m[leg] for node in nodes]) for leg in (0, 1)]
    turns_above = _padded([above[i].turns_per_m for i in parent])[:, :, None]
    tones = [_weights(node.tone_weights, len(node.turns_per_m)) for node in nodes]
    weights = [
        [_weights(node.leg_weights[leg], len(node.legs[leg].length_m)) for node in nodes]
        for leg in (0, 1)
    ]
    return Level(
        xp=xp,
        parent=xp.asarray(np.array(parent)),
        phases=tuple(
            cis(xp, xp.asarray(turns_above) * xp.asarray(shift[:, None])) for shift in shifts
        ),
        tone_weights=xp.asarray(_padded(tones), dtype=np.complex64),
        weights_a=xp.asarray(_padded(weights[0]), dtype=np.complex64),
        weights_b=xp.asarray(_padded(weights[1]).swapaxes(1, 2), dtype=np.complex64),
        turns_per_m=xp.asarray(_padded([node.turns_per_m for node in nodes])),
        centre_m=xp.asarray(np.stack([node.box.centre_m for node in nodes], axis=1)),
        position_m=tuple(
            xp.asarray(np.moveaxis(_padded([node.legs[leg].position_m for node in nodes]), 2, 0))
            for leg in (0, 1)
        ),
        length_m=tuple(
            xp.asarray(_padded([node.legs[leg].length_m for node in nodes])) for leg in (0, 1)
        ),
    )


def _weights(weights: np.ndarray, count: int) -> np.ndarray:
    """Return the weights; or, if they are empty, which stands for an unchanged axis, the unit
    matrix of size `count`."""
    return weights if weights.size else np.eye(count)


def _padded(arrays: list[np.ndarray]) -> np.ndarray:
    """Stack arrays of different shapes, each padded with zeros to the largest size along each axis:
    float64 [n, ...]."""
    stacked = np.zeros((len(arrays), *np.max([array.shape for array in arrays], axis=0)))
    for row, array in zip(stacked, arrays, strict=True):
        row[tuple(map(slice, array.shape))] = array
    return stacked

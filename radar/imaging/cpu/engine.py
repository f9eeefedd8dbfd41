"""Imaging and simulation over one box by its tree: the same plan serves both, one as the adjoint of the other."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from radar.data.arrays import Aperture
from radar.imaging.bands import bands, carriers
from radar.imaging.cpu.chain import ascend, complex_samples, descend, planes
from radar.imaging.cpu.leaf import Source
from radar.imaging.cpu.leaves import Leaves, gather, pack, scatter
from radar.imaging.tree import Box, Family, Node, branch, split, trunk
from radar.support.parallel import for_each, one_blas_thread

LEAF = 7.0  # Nyquist intervals along each axis of a leaf, at most ...
LIMB = 3  # ... and leaves along each axis of a limb: the balance of compressing against evaluating


class Sorted(NamedTuple):
    """Points [3, n] by limb and leaf: order [n] of the original ones, starts [leaves + 1] of each leaf's."""

    points_m: np.ndarray
    order: np.ndarray
    starts: np.ndarray


class Engine:
    """Images of points within `box` from samples of `aperture` at frequencies_hz, to the family's tolerance.

    Plans limbs and leaves when points first touch them.
    """

    def __init__(self, frequencies_hz: np.ndarray, aperture: Aperture, box: Box, family: Family) -> None:
        self.box, self.family = box, family
        low, high = bands(frequencies_hz, aperture, box)
        leaves = np.maximum(np.ceil((box.high_m - box.low_m) * (high - low) / 2 / np.pi / LEAF), 1).astype(int)
        self.limbs = np.maximum(np.round(leaves / LIMB), 1).astype(int)
        self.leaves = np.ceil(leaves / self.limbs).astype(int)  # of each limb
        self.passes, self.reference_m = carriers(aperture)
        self._trunk = trunk(frequencies_hz, aperture)
        self._root = branch(self._trunk, box, family, keep_antennas=True)
        self._boxes = split(box, self.limbs)
        self._limbs: list[tuple[Node, Leaves] | None] = [None] * len(self._boxes)

    def sort(self, points_m: np.ndarray) -> Sorted:
        """Points [n, 3] within the box, by limb and leaf."""
        counts = self.limbs * self.leaves
        extent = np.maximum(self.box.high_m - self.box.low_m, np.finfo(float).tiny)
        cell = np.clip(((points_m - self.box.low_m) / extent * counts).astype(int), 0, counts - 1)
        limb, leaf = np.divmod(cell, self.leaves)
        key = np.ravel_multi_index(limb.T, self.limbs) * int(np.prod(self.leaves))
        key += np.ravel_multi_index(leaf.T, self.leaves)
        order = np.argsort(key.astype(np.int32), kind="stable")
        starts = np.searchsorted(key[order], np.arange(int(np.prod(counts)) + 1))
        return Sorted(np.ascontiguousarray(points_m[order].T, np.float64), order, starts)

    def image(self, samples: np.ndarray, where: Sorted) -> np.ndarray:
        """Images complex64 [f, n] (tones apart) or [1, n] (summed) of samples [f, t, r] or [f, n] at sorted points."""
        with one_blas_thread():
            root = _down(planes(samples), self._trunk, self._root)
        points, order, starts = where
        images = np.empty((len(samples) if self.family.apart else 1, len(order)), np.complex64)
        per_limb = int(np.prod(self.leaves))

        def work(limb: int) -> None:
            node, leaves = self._limb(limb)
            begin = starts[limb * per_limb : (limb + 1) * per_limb + 1]
            below = _down(root, self._root, node)
            images[:, begin[0] : begin[-1]] = gather(
                below, node.turns_per_m, leaves, self.passes, self.reference_m, points, begin, len(images)
            )

        for_each(work, [i for i in range(len(self._boxes)) if starts[(i + 1) * per_limb] > starts[i * per_limb]])
        unsorted = np.empty_like(images)
        unsorted[:, order] = images
        return unsorted

    def echoes(self, source: Source, where: Sorted) -> np.ndarray:
        """Samples complex64 [f, t, r or 1] of scatterers, the adjoint of `image` with the tones summed."""
        per_limb = int(np.prod(self.leaves))
        touched = [i for i in range(len(self._boxes)) if where.starts[(i + 1) * per_limb] > where.starts[i * per_limb]]
        parts: list[np.ndarray | None] = [None] * len(touched)

        def work(i: int) -> None:
            node, leaves = self._limb(touched[i])
            begin = where.starts[touched[i] * per_limb : (touched[i] + 1) * per_limb + 1]
            shape = (len(node.turns_per_m), 2, *(len(leg.length_m) for leg in node.legs))
            limb = scatter(source, node.turns_per_m, leaves, self.passes, self.reference_m, begin, shape)
            parts[i] = _up(limb, self._root, node)

        for_each(work, range(len(touched)))
        with one_blas_thread():
            samples = _up(sum(parts), self._trunk, self._root)  # added in order: no result depends on the threads
        return complex_samples(samples)

    def _limb(self, limb: int) -> tuple[Node, Leaves]:
        if self._limbs[limb] is None:
            node = branch(self._root, self._boxes[limb], self.family)
            self._limbs[limb] = node, pack([branch(node, box, self.family) for box in split(node.box, self.leaves)])
        return self._limbs[limb]


def _down(samples: np.ndarray, parent: Node, child: Node) -> np.ndarray:
    return descend(samples, parent.turns_per_m, *child.shifts_m, child.tone_weights, *child.leg_weights)


def _up(samples: np.ndarray, parent: Node, child: Node) -> np.ndarray:
    return ascend(samples, parent.turns_per_m, *child.shifts_m, child.tone_weights, *child.leg_weights)

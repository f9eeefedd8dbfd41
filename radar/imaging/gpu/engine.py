"""Imaging over one box on a device: the tree of `radar.imaging.cpu.engine`, all boxes of a level at once.

Points are cut into pieces, each of one leaf, and pieces of like size are padded to batches. A batch is one product per
tone, as in `radar.imaging.cpu.leaf`: ΔR in float64 against a reference point, what is left of it in float32.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from threading import Lock
from typing import NamedTuple

import numpy as np

from radar.data.arrays import Aperture
from radar.imaging.cpu.engine import Engine, Sorted
from radar.imaging.device import BLOCK_BYTES, Array, array_module, to_host
from radar.imaging.gpu.levels import Level, level
from radar.imaging.gpu.steering import cis, distances
from radar.imaging.tree import Box, Family, Node, branch, split, trunk
from radar.support.parallel import for_each

PIECE = 512  # points of one leaf that share a product
WAVE_BYTES = 24  # per point, tone and antenna: turns, phases and products
PATH_BYTES = 40  # per point and antenna: differences in double


class Batch(NamedTuple):
    """n pieces of up to p points: sample [n] (its leaf's row among the samples), leaf [n] (its row in the level),
    points_m [3, n, p], and target [n, p], where each point's image goes; padding goes one column past the last."""

    sample: Array
    leaf: Array
    points_m: Array
    target: Array


@dataclass(frozen=True)
class Placed:
    """Points on the device, by leaf: how many, the levels of the tree that they need, which leaves, and the batches."""

    count: int
    limbs: Level
    leaves: Level
    rows: Array
    batches: list[Batch]


class DeviceEngine:
    """As `radar.imaging.cpu.engine.Engine`, on the chosen device, where the limbs that points have touched stay."""

    def __init__(self, frequencies_hz: np.ndarray, aperture: Aperture, box: Box, family: Family) -> None:
        self._xp = array_module()
        self._division = Engine(frequencies_hz, aperture, box, family)  # into limbs and leaves; it images nothing here
        self._family = family
        above = trunk(frequencies_hz, aperture)
        self._root = branch(above, box, family, keep_antennas=True)
        self._top = level(self._xp, [self._root], [above], [0])
        self._boxes = split(box, self._division.limbs)
        self._planned: dict[int, tuple[Node, list[Node]]] = {}
        self._levels: tuple[Level, Level] | None = None
        self._lock = Lock()

    def sort(self, points_m: np.ndarray) -> Placed:
        """Points [n, 3] within the box, on the device and by leaf."""
        where = self._division.sort(points_m)
        per_limb = int(np.prod(self._division.leaves))
        touched = np.flatnonzero(np.diff(where.starts))  # leaves, counted over all limbs
        limbs, leaves, limb_rows = self._require(np.unique(touched // per_limb))
        rows = limb_rows[touched // per_limb] * per_limb + touched % per_limb
        batches = _batches(where, touched, rows, _point_bytes(leaves))
        on_device = [Batch(*map(self._xp.asarray, batch)) for batch in batches]
        return Placed(len(points_m), limbs, leaves, self._xp.asarray(rows), on_device)

    def image(self, samples: np.ndarray, placed: Placed) -> np.ndarray:
        """Images complex64 [f, n] (tones apart) or [1, n] (summed) of samples [f, t, r] or [f, n] at placed points."""
        xp, apart = self._xp, self._family.apart
        whole = xp.asarray(samples.reshape(1, len(samples), samples.shape[1], -1), dtype=np.complex64)
        root = self._top.descend(whole, xp.arange(1))
        limbs = placed.limbs.descend(root, xp.arange(placed.limbs.centre_m.shape[1]))
        leaves = placed.leaves.descend(limbs, placed.rows)
        images = xp.empty((len(samples) if apart else 1, placed.count + 1), np.complex64)
        for batch in placed.batches:
            tones = self._evaluate(placed.leaves, leaves, batch)
            images[:, batch.target] = tones.swapaxes(0, 1) if apart else tones.sum(axis=1)[None]
        return to_host(images[:, :-1])

    def _evaluate(self, leaves: Level, samples: Array, batch: Batch) -> Array:
        """Images [n, k, p] of every tone at a batch's points, from the leaves' samples [leaves, k, a, b]."""
        xp, division = self._xp, self._division
        turns = leaves.turns_per_m[batch.leaf][:, :, None]
        waves, common_m = [], 0.0
        for leg, (passes, reference_m) in enumerate(zip(division.passes, division.reference_m, strict=True)):
            reference = xp.asarray(reference_m)[:, None]
            centre = distances(xp, leaves.centre_m[:, batch.leaf], reference)[:, None]
            shared_m = passes * (distances(xp, batch.points_m, reference[:, :, None]) - centre)
            antennas = leaves.position_m[leg][:, batch.leaf][:, :, :, None]
            path_m = passes * distances(xp, batch.points_m[:, :, None], antennas)
            path_m -= leaves.length_m[leg][batch.leaf][:, :, None]
            path_m -= shared_m[:, None]
            waves.append(cis(xp, turns.astype(np.float32)[..., None] * path_m.astype(np.float32)[:, None]))
            common_m = common_m + shared_m
        heard = xp.matmul(samples[batch.sample].swapaxes(2, 3), waves[0])
        heard *= waves[1]
        return heard.sum(axis=2) * cis(xp, turns * common_m[:, None])

    def _require(self, limbs: np.ndarray) -> tuple[Level, Level, np.ndarray]:
        """The levels of limbs and leaves with these limbs planned, and each limb's row there [limbs] (−1: none)."""
        with self._lock:
            new = [int(limb) for limb in limbs if int(limb) not in self._planned]
            if new:
                for_each(self._plan, new)
                nodes = [self._planned[limb] for limb in sorted(self._planned)]
                above = [limb for limb, _ in nodes]
                below = [leaf for _, leaves in nodes for leaf in leaves]
                parent = [row for row, (_, leaves) in enumerate(nodes) for _ in leaves]
                self._levels = (
                    level(self._xp, above, [self._root], [0] * len(above)),
                    level(self._xp, below, above, parent),
                )
            rows = np.full(len(self._boxes), -1)
            rows[sorted(self._planned)] = np.arange(len(self._planned))
            return *self._levels, rows

    def _plan(self, limb: int) -> None:
        node = branch(self._root, self._boxes[limb], self._family)
        leaves = [branch(node, box, self._family) for box in split(node.box, self._division.leaves)]
        self._planned[limb] = node, leaves


def _point_bytes(leaves: Level) -> int:
    """Intermediate bytes per point of a batch."""
    antennas = sum(length.shape[1] for length in leaves.length_m)
    return antennas * (WAVE_BYTES * leaves.turns_per_m.shape[1] + PATH_BYTES)


def _batches(where: Sorted, touched: np.ndarray, rows: np.ndarray, point_bytes: int) -> Iterator[Batch]:
    """The points of the touched leaves, whose rows in the level are `rows`, still in numpy: even pieces, the largest
    first, so that little is padded. Padding repeats a piece's last point."""
    starts, counts = where.starts[touched], np.diff(where.starts)[touched]
    pieces = -(-counts // PIECE)
    leaf = np.repeat(np.arange(len(touched)), pieces)
    place = np.arange(len(leaf)) - np.repeat(np.cumsum(pieces) - pieces, pieces)  # among the pieces of its leaf
    first, end = (starts[leaf] + counts[leaf] * (place + i) // pieces[leaf] for i in (0, 1))
    order = np.argsort(first - end, kind="stable")
    while len(order):
        widest = end[order[0]] - first[order[0]]
        now, order = np.split(order, [max(BLOCK_BYTES // int(point_bytes * widest), 1)])
        index, last = first[now, None] + np.arange(widest), end[now, None] - 1
        target = np.where(index <= last, where.order[np.minimum(index, last)], len(where.order))
        yield Batch(leaf[now], rows[leaf[now]], where.points_m[:, np.minimum(index, last)], target)

"""Echoes of ray tubes with several bounces, computed for whole bundles of tubes.

Tubes that start in one small cube of the target and end in another form a bundle. Its echo at few
tones and few antennas determines all others, by interpolation as in `radar.imaging.tree`. Rays are
traced for these antennas only, and bundles are summed at the few tones that represent the target.
"""

from __future__ import annotations

from itertools import groupby
from typing import NamedTuple

import numpy as np

from handbench.radar.data.arrays import SPEED_OF_LIGHT_M_S, AntennaArray
from handbench.radar.imaging.cpu.adjoint import to_parent
from handbench.radar.imaging.cpu.forward import complex_samples
from handbench.radar.imaging.cpu.steering import steered_differences
from handbench.radar.imaging.skeleton import band_kernel, skeleton
from handbench.radar.simulation.physics.bounces import radiate
from handbench.radar.simulation.physics.line_of_sight import nodes
from handbench.radar.simulation.physics.polarisation import tube_factors
from handbench.radar.simulation.physics.ray_tubes import RayTrace
from handbench.radar.simulation.physics.vectors import minus, norm, vec
from handbench.support.compiled import FAST, njit
from handbench.support.parallel import for_each

TOLERANCE = 3e-3  # of the bounces' echoes, by the choice of tones
# Distances between the few transmitters and receivers: a cell's waves vary over 25 mm, 0.3 m away.
# Each transmitter has its own tubes, whose borders jump; receivers share tubes.
NODES_M = 0.015, 0.0138
CELL_M = 0.03  # edges of the cells
PROBES = 300  # points of a cell to which the weights of antennas are fitted
RIDGES = 1e-3, 1e-6  # of the fit for either, against weights that amplify the nodes' own errors
REACH_M = 5e-3  # steps of the differences between paths, so that bundles share their tones
SUMS = 8  # partial sums, whatever the number of threads
EVERY = np.zeros((0, 0), np.float32)  # weights that leave an axis as it is


def traced_nodes(array: AntennaArray) -> tuple[np.ndarray, np.ndarray]:
    """Choose the antennas for which rays are traced: (indices of transmitters, indices of
    receivers). The samples of all other antennas are interpolated from those of the chosen
    ones."""
    return nodes(array.tx_m, NODES_M[0]), nodes(array.rx_m, NODES_M[1])


class Cells(NamedTuple):
    """n points of the target sorted into c cubes of space, 30 mm wide.

    cell [n]: number of each point's cube; centre_m [c, 3]: mean of the points in each cube;
    points_m: per cube, some of its points.
    """

    cell: np.ndarray
    centre_m: np.ndarray
    points_m: list[np.ndarray]

    @classmethod
    def of(cls, points_m: np.ndarray) -> Cells:
        """Sort points [n, 3] into cubes of space, 30 mm wide. Cubes without a point are left
        out."""
        corner = np.floor(points_m / CELL_M).astype(int)
        corner -= corner.min(axis=0, initial=0)
        key = np.ravel_multi_index(tuple(corner.T), tuple(corner.max(axis=0, initial=0) + 1))
        among = np.bincount(key)
        index, count = (np.cumsum(among > 0) - 1)[key], among[among > 0]
        centre_m = np.stack([np.bincount(index, column) / count for column in points_m.T], axis=1)
        members = np.split(_sorting(index), np.cumsum(count)[:-1])
        return cls(index, centre_m, [points_m[one[:: 1 + len(one) // PROBES]] for one in members])


class LegWeights(NamedTuple):
    """Interpolation over the antennas of one leg (transmitters or receivers), for waves to or from
    each cube of the target (`Cells`).

    distance_m [c, a]: distances from each cube's centre to each antenna; weights: per cube, a
    matrix [nodes, a] that interpolates samples at a few antennas (nodes) to all.
    """

    distance_m: np.ndarray
    weights: list[np.ndarray]

    @classmethod
    def of(
        cls, cells: Cells, antennas_m: np.ndarray, at: np.ndarray, turns_per_m: float, ridge: float
    ) -> LegWeights:
        """Compute the interpolation from the antennas with indices `at` to all antennas_m [a, 3].
        turns_per_m: f/c of the highest tone; ridge: damping of the fit, which keeps weights
        small."""
        distance_m = np.linalg.norm(cells.centre_m[:, None] - antennas_m, axis=2)
        places = zip(cells.points_m, cells.centre_m, strict=True)
        weights = [
            _weights(antennas_m, at, points_m, middle, turns_per_m, ridge)
            for points_m, middle in places
        ]
        return cls(distance_m, weights)


class ToneSubset(NamedTuple):
    """A few tones whose samples determine those at all f tones. chosen [k]: their indices; weights
    [k, f]: interpolate from them to all tones (empty if all tones are kept)."""

    chosen: np.ndarray
    weights: np.ndarray

    @classmethod
    def of(cls, turns_per_m: np.ndarray, reach_m: float) -> ToneSubset:
        """Choose the tones that are enough for echoes whose paths differ by at most ±reach_m.
        turns_per_m [f]: f/c of all tones."""
        if len(turns_per_m) <= 2:
            return cls(np.arange(len(turns_per_m)), EVERY)
        wavenumber = 2 * np.pi * turns_per_m[:, None]
        chosen, weights = skeleton(
            band_kernel(wavenumber, wavenumber, np.array([reach_m])), TOLERANCE
        )
        return cls(chosen, np.ascontiguousarray(weights, np.float32))

    def at(self, chosen: np.ndarray) -> np.ndarray:
        """Return the interpolation weights [k, n] for only those n of all tones that have the
        indices `chosen`; empty if all tones are kept."""
        return (
            self.weights
            if self.weights.size == 0
            else np.ascontiguousarray(self.weights[:, chosen])
        )


class Bundles:
    """Traced rays grouped into bundles. The rays of a bundle have the same number of reflections,
    their first reflections are in the same small cube of the target, and so are their last ones.

    layer [faces]: number of the surface layer of each face of the body (thin skin or palm); at:
    indices of the transmitters and of the receivers for which rays were traced; dipole [3]:
    direction of the antennas' electric field.
    """

    def __init__(
        self,
        traced: RayTrace,
        layer: np.ndarray,
        at: tuple[np.ndarray, np.ndarray],
        dipole: np.ndarray,
    ) -> None:
        hits, mirrors = traced.hits, traced.mirrors
        self._traced, self._at, self._dipole = traced, at, dipole
        self._count = 2 + int(layer.max())  # one more, of the faces that are not met
        met = np.append(layer, self._count - 1).astype(np.int8)[hits.faces]
        self._layers = np.column_stack([layer.astype(np.int8)[mirrors.face[hits.patch]], met])
        start_m = mirrors.patches.middle_m
        self._cells = first, last = Cells.of(start_m), Cells.of(hits.end_m)
        kinds, more = (
            (len(last.centre_m), len(first.centre_m), hits.faces.shape[1]),
            sum(hits.faces.T[1:] >= 0),
        )
        key = np.ravel_multi_index((last.cell, first.cell[hits.patch], more), kinds)
        order = _sorting(key)  # the transmitters are in order
        self._bundles = [
            one for one in np.split(order, np.flatnonzero(np.diff(key[order])) + 1) if len(one)
        ]
        one = np.array([bundle[0] for bundle in self._bundles], int)
        self._places = np.stack([first.cell[hits.patch[one]], last.cell[one]], axis=1)
        starts, legs = np.cumsum([0, *map(len, self._bundles)]), (traced.array.tx_m, start_m)
        self._length_m, reach_m = _reach(
            hits, order, starts, self._places, *legs, first.centre_m, last.centre_m
        )
        self._reach_m = REACH_M * np.ceil(reach_m / REACH_M)

    def __len__(self) -> int:
        return len(self._bundles)

    def echo(
        self,
        frequencies_hz: np.ndarray,
        array: AntennaArray,
        reflection: np.ndarray | None,
        pattern: float,
        ratios: np.ndarray,
    ) -> np.ndarray:
        """Compute the sum of the echoes of all bundles: samples complex64 [f, t, r]. The antennas
        of `array` may differ a little from those for which rays were traced: the places of
        reflection are kept, since paths are stationary there.

        reflection [layers, f]: amplitude relative to metal at normal incidence (None: metal);
        pattern: exponent q of the antennas' pattern cosᵠθ; ratios: reflection of round surfaces at
        oblique incidence over that of a plane at normal incidence (`round_ratios`), for all layers
        or for the one material.

        Amplitudes are relative to a single echo of metal, so each further reflection multiplies by
        the −1 of a metal mirror.
        """
        if len(self) == 0:
            return np.zeros((len(frequencies_hz), *array.channels), np.complex64)
        level = np.ones((self._count, len(frequencies_hz)), complex)
        level[:-1] = -1.0 if reflection is None else -reflection[: self._count - 1]
        products = level
        for _ in range(self._layers.shape[1] - 1):
            products = (products[:, None] * level).reshape(-1, len(frequencies_hz))
        turns_per_m, legs = frequencies_hz / SPEED_OF_LIGHT_M_S, (array.tx_m, array.rx_m)
        tx, rx = (
            LegWeights.of(cells, leg, at, turns_per_m.max(), ridge)
            for cells, leg, at, ridge in zip(self._cells, legs, self._at, RIDGES, strict=True)
        )
        first, last = self._places.T
        before_m, after_m = tx.distance_m[first] + self._length_m[:, None], rx.distance_m[last]
        middle_m = before_m.mean(axis=0), after_m.mean(axis=0)
        before_m, after_m = before_m - middle_m[0], after_m - middle_m[1]
        reach_m = np.abs(before_m).max(axis=1) + np.abs(after_m).max(axis=1) + self._reach_m
        whole = ToneSubset.of(turns_per_m, float(reach_m.max()))
        tones = {reach: ToneSubset.of(turns_per_m, reach) for reach in np.unique(self._reach_m)}
        parts = np.zeros((SUMS, len(whole.chosen), 2, *array.channels), np.float32)
        groups = [list(group) for _, group in groupby(range(len(self)), lambda n: last[n])]
        some_per_m, unmoved_m = (
            turns_per_m[whole.chosen],
            [np.zeros(len(at)) for at in (array.tx_m, self._at[1])],
        )

        def work(i: int) -> None:
            # bundles that land in one cell share the step to all receivers
            for group in groups[i::SUMS]:
                landed = np.zeros(
                    (len(some_per_m), 2, len(array.tx_m), len(self._at[1])), np.float32
                )
                for n in group:
                    own = tones[self._reach_m[n]]
                    few = self._few(n, turns_per_m, own.chosen, array, products, pattern, ratios)
                    mixed, weights = own.at(whole.chosen), tx.weights[first[n]]
                    landed += to_parent(
                        few, some_per_m, before_m[n], unmoved_m[1], mixed, weights, EVERY
                    )
                weights = rx.weights[last[group[0]]]
                parts[i] += to_parent(
                    landed, some_per_m, unmoved_m[0], after_m[group[0]], EVERY, EVERY, weights
                )

        for_each(work, range(SUMS))
        # Summed in order: no result depends on the threads.
        samples = to_parent(parts.sum(axis=0), turns_per_m, *middle_m, whole.weights, EVERY, EVERY)
        return -complex_samples(samples)

    def _few(
        self,
        n: int,
        turns_per_m: np.ndarray,
        chosen: np.ndarray,
        array: AntennaArray,
        products: np.ndarray,
        pattern: float,
        ratios: np.ndarray,
    ) -> np.ndarray:
        """Compute the samples of bundle n at the chosen tones and for the few traced antennas:
        float32 [k, 2, t, r], 2 for real and imaginary part. The phase of the path via the centres
        of the bundle's first and last cube is left out.

        products [pairs, f]: product of the reflections for each sequence of layers.
        """
        bundle, (first, last) = self._bundles[n], self._places[n]
        tubes = self._traced.tubes(bundle)
        tx_m, rx_m = array.tx_m[self._at[0]], array.rx_m[self._at[1]]
        before_m = np.linalg.norm(tx_m - self._cells[0].centre_m[first], axis=1) + self._length_m[n]
        after_m = np.linalg.norm(rx_m - self._cells[1].centre_m[last], axis=1)
        layers = self._layers[bundle].astype(np.int64)
        factor = tube_factors(
            tubes,
            tx_m,
            self._dipole,
            ratios,
            np.minimum(layers, len(ratios) - 1),
            2 * np.pi * turns_per_m.mean(),
        )
        row = layers @ self._count ** np.arange(layers.shape[1])[::-1]
        reflection = factor, row, products[:, chosen].astype(np.complex64)
        starts = np.searchsorted(tubes.transmitter, np.arange(len(tx_m) + 1))
        tones = turns_per_m[chosen], turns_per_m.mean()
        seen = self._traced.seen
        return np.asarray(
            radiate(
                tubes, *reflection, starts, tx_m, rx_m, before_m, after_m, *tones, pattern, seen
            )
        )


def _sorting(key: np.ndarray) -> np.ndarray:
    """Return the indices [n] that sort small integers `key` [n]; equal ones stay in order."""
    return np.argsort(key.astype(np.min_scalar_type(key.max(initial=0))), kind="stable")


@njit(**FAST)
def _reach(  # type: ignore[no-untyped-def]
    hits, order, starts, places, tx_m, start_m, first_m, last_m
):
    """Return for each bundle the mean length of its rays on the target, and a bound on how much a
    ray's path can differ, for any antennas, from the path via the centres of the bundle's first and
    last cube: ([b], [b]), metres.

    The rays of bundle b are order[starts[b]:starts[b + 1]]; places [b, 2]: rows of its cubes'
    centres in first_m and last_m.
    """
    length_m, reach_m = np.zeros(len(places)), np.zeros(len(places))
    for b in range(len(places)):
        begin, end = vec(first_m[places[b, 0]]), vec(last_m[places[b, 1]])
        for n in order[starts[b] : starts[b + 1]]:
            length_m[b] += hits.length_m[n] / (starts[b + 1] - starts[b])
        late_m = wide_m = 0.0
        for n in order[starts[b] : starts[b + 1]]:
            antenna = vec(tx_m[hits.transmitter[n]])
            path_m = norm(minus(vec(start_m[hits.patch[n]]), antenna)) - norm(minus(begin, antenna))
            late_m = max(late_m, abs(path_m + hits.length_m[n] - length_m[b]))
            wide_m = max(wide_m, norm(minus(vec(hits.end_m[n]), end)))
        reach_m[b] = late_m + wide_m
    return length_m, reach_m


def _weights(
    antennas_m: np.ndarray,
    at: np.ndarray,
    points_m: np.ndarray,
    centre_m: np.ndarray,
    turns_per_m: float,
    ridge: float,
) -> np.ndarray:
    """Compute the matrix [nodes, a] that interpolates the waves of points [n, 3] near a centre [3]
    from the antennas with indices `at` to all antennas [a, 3]; empty if these are all. ridge:
    damping of the fit."""
    if len(at) == len(antennas_m):
        return EVERY
    waves = steered_differences(
        antennas_m, np.full(len(points_m), turns_per_m), points_m, centre_m
    ).astype(np.float64)
    gram = waves.T @ waves / len(points_m)
    known = gram[np.ix_(at, at)] + ridge * np.eye(len(at))
    return np.ascontiguousarray(np.linalg.solve(known, gram[at]), np.float32)

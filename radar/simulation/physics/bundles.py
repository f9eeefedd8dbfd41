"""Echoes of ray tubes, bundle by bundle.

What starts in one small cell of the target and lands in another tells few tones and few antennas all there is to know:
the rest of both is interpolated, as in `radar.imaging.tree`. Rays are only traced for those antennas (`nodes`).
"""

from __future__ import annotations

from typing import Any

import numpy as np

from radar.data.arrays import SPEED_OF_LIGHT_M_S, AntennaArray
from radar.imaging.cpu.ascent import ascend
from radar.imaging.cpu.descent import complex_samples
from radar.imaging.cpu.steering import steered_differences
from radar.imaging.skeleton import band_skeleton
from radar.simulation.physics.bounces import radiate
from radar.simulation.physics.line_of_sight import lines, spaced
from radar.simulation.physics.polarisation import tube_factors
from radar.simulation.physics.ray_tubes import Traced
from radar.support.parallel import for_each

TOLERANCE = 1e-4  # of the two-bounce echoes: for the tones that stand for the others
# Between the antennas that stand for the others: a cell's waves oscillate over more than 25 mm. Each transmitter has
# tubes of its own, whose errors are not smooth, so that more of them are better; receivers share tubes.
TX_NODES_M, RX_NODES_M = 0.0075, 0.0125
START_M, END_M = 0.08, 0.03  # edges of the cells
PROBES = 300  # tubes of a bundle to which the weights of antennas are fitted
RIDGE = 1e-6  # of the fit, against weights that amplify noise
SUMS = 8  # partial sums per pair of layers, whatever the number of threads
EVERY = np.zeros((0, 0), np.float32)  # weights that leave an axis as it is


def nodes(antennas_m: np.ndarray, apart_m: float) -> np.ndarray:
    """Indices of antennas [a, 3] about apart_m apart along each line, its ends included."""
    return np.concatenate([line[spaced(antennas_m[line], apart_m)[0]] for line in lines(antennas_m)])


class Bundles:
    """Traced hits in bundles: by the layers of their mirror and of where they land, the cells of both, and transmitter.

    layer [faces]: of each face of the body; at: the indices of the antennas for which the rays were traced; dipole [3]:
    the antennas'.
    """

    def __init__(
        self, traced: Traced, layer: np.ndarray, at: tuple[np.ndarray, np.ndarray], dipole: np.ndarray
    ) -> None:
        hits, start_m = traced.hits, traced.patches.middle_m[traced.hits.patch]
        first, second, layers = layer[traced.patch_face[hits.patch]], layer[hits.face], 1 + int(layer.max())
        cells = np.concatenate([np.floor(start_m / START_M), np.floor(hits.end_m / END_M)], axis=1).astype(int)
        cells -= cells.min(axis=0)
        key = np.ravel_multi_index((first, second, *cells.T), (layers, layers, *(cells.max(axis=0) + 1)))
        self._traced, self._at, self._dipole = traced, at, dipole
        order = np.argsort(key, kind="stable")  # the transmitters are in order
        self._bundles = np.split(order, np.flatnonzero(np.diff(key[order])) + 1)
        self._layers = [(int(first[bundle[0]]), int(second[bundle[0]])) for bundle in self._bundles]

    def echo(
        self,
        frequencies_hz: np.ndarray,
        array: AntennaArray,
        reflection: np.ndarray | None,
        pattern: float,
        ratios: np.ndarray,
    ) -> np.ndarray:
        """Samples complex64 [f, t, r]. Tubes stay where they are on the target when the array moves a little: paths are
        stationary with respect to the mirror's point. reflection [layers, f]: amplitude against metal's at normal
        incidence; ratios: `oblique_ratios`, of all layers or of the one material.

        A metal mirror's −1 is one more than the single echo has, to which the forward model's amplitudes are referred.
        """
        total = np.zeros((len(frequencies_hz), *array.channels), np.complex64)
        for layers in sorted(set(self._layers)):
            chosen = [bundle for bundle, meets in zip(self._bundles, self._layers, strict=True) if meets == layers]
            both_ratios = tuple(ratios[min(layer, len(ratios) - 1)] for layer in layers)
            samples = self._sum(chosen, both_ratios, frequencies_hz, array, pattern)
            both = 1 if reflection is None else np.prod(reflection[list(layers)], axis=0)[:, None, None]
            total -= (samples * both).astype(np.complex64)
        return total

    def _sum(
        self,
        bundles: list[np.ndarray],
        ratios: tuple[np.ndarray, ...],
        frequencies_hz: np.ndarray,
        array: AntennaArray,
        pattern: float,
    ) -> np.ndarray:
        parts: list[Any] = [0] * min(SUMS, len(bundles))

        def work(i: int) -> None:
            for bundle in bundles[i :: len(parts)]:
                parts[i] = parts[i] + self._bundle(bundle, ratios, frequencies_hz, array, pattern)

        for_each(work, range(len(parts)))
        return complex_samples(sum(parts))  # in order: no result depends on the threads

    def _bundle(
        self,
        bundle: np.ndarray,
        ratios: tuple[np.ndarray, ...],
        frequencies_hz: np.ndarray,
        array: AntennaArray,
        pattern: float,
    ) -> np.ndarray:
        """Samples [f, 2, t, r] of the hits of one bundle."""
        tubes = self._traced.tubes(bundle)
        turns_per_m = frequencies_hz / SPEED_OF_LIGHT_M_S
        at_tx, at_rx = self._at
        tx_m, rx_m = array.tx_m[at_tx], array.rx_m[at_rx]
        first_m, last_m = tubes.start_m.mean(axis=0), tubes.end_m.mean(axis=0)
        before_m = np.linalg.norm(array.tx_m - first_m, axis=1) + tubes.length_m.mean()
        after_m = np.linalg.norm(array.rx_m - last_m, axis=1)
        path_m = np.linalg.norm(tubes.start_m - tx_m[tubes.transmitter], axis=1) + tubes.length_m
        reach_m = np.abs(path_m - before_m[at_tx][tubes.transmitter]).max()
        reach_m += np.linalg.norm(tubes.end_m - last_m, axis=1).max()
        tones, weights = _tones(turns_per_m, reach_m)
        starts = np.searchsorted(tubes.transmitter, np.arange(len(tx_m) + 1))
        few_m, few_turns, middle = (before_m[at_tx], after_m[at_rx]), turns_per_m[tones], turns_per_m.mean()
        factor = tube_factors(tubes, tx_m, self._dipole, ratios)
        few = radiate(tubes, factor, starts, tx_m, rx_m, *few_m, few_turns, middle, pattern, self._traced.seen)
        weights_tx = _weights(array.tx_m, at_tx, tubes.start_m, first_m, turns_per_m.max())
        weights_rx = _weights(array.rx_m, at_rx, tubes.end_m, last_m, turns_per_m.max())
        return ascend(few, turns_per_m, before_m, after_m, weights, weights_tx, weights_rx)


def _tones(turns_per_m: np.ndarray, reach_m: float) -> tuple[np.ndarray, np.ndarray]:
    """The tones that stand for all where paths differ by up to reach_m, and their weights [k, f]."""
    if len(turns_per_m) <= 2:
        return np.arange(len(turns_per_m)), EVERY
    tones, weights = band_skeleton(2 * np.pi * turns_per_m[:, None], np.array([reach_m]), TOLERANCE)
    return tones, np.ascontiguousarray(weights, np.float32)


def _weights(
    antennas_m: np.ndarray, at: np.ndarray, points_m: np.ndarray, centre_m: np.ndarray, turns_per_m: float
) -> np.ndarray:
    """Weights [nodes, a] by which the antennas `at` stand for all in the waves of points [n, 3] about a centre."""
    if len(at) == len(antennas_m):
        return EVERY
    probes = points_m[:: max(1, len(points_m) // PROBES)]
    waves = steered_differences(antennas_m, np.full(len(probes), turns_per_m), probes, centre_m).astype(np.float64)
    gram = waves.T @ waves / len(probes)
    known = gram[np.ix_(at, at)] + RIDGE * np.eye(len(at))
    return np.ascontiguousarray(np.linalg.solve(known, gram[at]), np.float32)

"""Conjugated echoes, told by focus: of the coarse images of the echoes as they are and conjugated the sharper one wins,
by Σ|I|⁴ / (Σ|I|²)² (Muller & Buffington, J. Opt. Soc. Am. 64 (1974) 1200).

Sharpness does not tell a mirrored array, exchanged axes or antennas, or a wrong length; tones in reverse order it tells
only where nothing beyond the image echoes. A surface tells these (`bench.validation.surface_fit`).
"""

from dataclasses import replace

import numpy as np

from handbench.bench.validation.checks import places_m
from handbench.radar.data.arrays import SPEED_OF_LIGHT_M_S, AntennaArray
from handbench.radar.data.capture import RadarCapture, evenly
from handbench.radar.data.grid import VoxelGrid
from handbench.radar.imaging.api import image_volume

ANTENNAS, POSITIONS, TONES = 32, 400, 32  # at most, of a kind and of a scan: more do not change which is sharpest
SHARPER_DB = 3.0  # conjugated; conjugating what is right cost 7 dB or more on random scenes of ten kinds
SHALLOW = 0.3  # an array deeper than this share of its width may stand around its target, where none is looked for
WIDE, NEAR, FAR = 0.85, 1.0, 8.0  # the box imaged, in apertures: to either side, and along z from and to
CELL, DEEP = 2.0, 8.0  # resolution cell and depth of focus two apertures away, in wavelengths


def findings(capture: RadarCapture) -> list[str]:
    """The sentence that a capture's echoes are conjugated, with its cure, if its first frame focuses better so; none of
    arrays that may stand around what they see."""
    *across_m, deep_m = np.ptp(places_m(capture), axis=0)
    if not capture.samples[0].any() or deep_m > SHALLOW * max(across_m):
        return []
    sharper_db = sharpness_db(replace(capture, samples=capture.samples.conj())) - sharpness_db(capture)
    if sharper_db < SHARPER_DB:
        return []
    within = f"if the target stands within {FAR * max(across_m):.2g} m"
    better = f"the echoes focus better, {sharper_db:.0f} dB sharper, conjugated: {within},"
    return [f'{better} conjugate the samples (sign = "+" in a mapping.toml, time = "-jwt" in echoes.h5)']


def sharpness_db(capture: RadarCapture) -> float:
    """Sharpness of a coarse image of the first frame."""
    few = _few(capture)
    volume = image_volume(few.samples[0], few.frequencies_hz, few.aperture, _box(few), None)  # a plan takes longer
    power = np.abs(volume).astype(np.float64) ** 2
    return float(10 * np.log10((power**2).sum() / power.sum() ** 2))


def _few(capture: RadarCapture) -> RadarCapture:
    """The first frame as in vacuum, with few tones, in rising order, and few antennas, all of which were measured."""
    order = np.argsort(capture.frequencies_hz, kind="stable")
    tones, array = order[evenly(len(order), TONES)], capture.aperture
    samples, frequencies_hz = capture.samples[:1, tones], capture.frequencies_hz[tones]
    if isinstance(array, AntennaArray):
        heard = np.ones(array.channels, bool) if array.measured is None else array.measured
        t, r = (np.flatnonzero(heard.any(axis=axis)) for axis in (1, 0))
        t, r = t[evenly(len(t), ANTENNAS)], r[evenly(len(r), ANTENNAS)]
        samples, places = samples[:, :, t[:, None], r], {"tx_m": array.tx_m[t], "rx_m": array.rx_m[r], "measured": None}
    else:  # at random: every n-th of a raster may be one column
        number = array.channels[0]
        some = np.sort(np.random.default_rng(0).choice(number, min(number, POSITIONS), replace=False))
        samples, places = samples[:, :, some], {name: places_m[some] for name, places_m in vars(array).items()}
    slower = SPEED_OF_LIGHT_M_S / capture.wave_speed_m_s
    return RadarCapture(np.ascontiguousarray(samples), frequencies_hz * slower, replace(array, **places))


def _box(capture: RadarCapture) -> VoxelGrid:
    """Coarse voxels before the aperture, which the echoes of anything near are in."""
    places = places_m(capture)
    middle_m, size_m = (places.min(axis=0) + places.max(axis=0)) / 2, float(np.ptp(places, axis=0).max())
    length_m = SPEED_OF_LIGHT_M_S / capture.frequencies_hz.mean()
    cell_m = SPEED_OF_LIGHT_M_S / 2 / max(float(np.ptp(capture.frequencies_hz)), 1.0)
    deep_m, wide_m = min(DEEP * length_m, 0.8 * cell_m), max(WIDE * size_m, length_m)
    across_m = np.arange(-wide_m, wide_m, max(CELL * length_m, wide_m / 40))
    far_m = max(FAR * size_m, 2 * deep_m)
    along_m = np.arange(NEAR * size_m, far_m, max(deep_m, far_m / 100))
    return VoxelGrid(middle_m[0] + across_m, middle_m[1] + across_m, middle_m[2] + along_m)

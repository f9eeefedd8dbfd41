"""Mistakes in echoes that no reader can see, told by focus: echoes focus best as they truly are.

The echoes are imaged coarsely as they are and as they would be without each mistake, and the sharpest image wins, by
Σ|I|⁴ / (Σ|I|²)² (Muller & Buffington, J. Opt. Soc. Am. 64 (1974) 1200). Sharpness does not tell a mirrored array,
exchanged axes or antennas, or a wrong length. A surface tells them (`bench.validation.surface_fit`).
"""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from bench.validation.capture_problems import places_m
from radar.data.arrays import SPEED_OF_LIGHT_M_S, AntennaArray
from radar.data.capture import RadarCapture, thinned
from radar.data.grid import VoxelGrid
from radar.imaging.api import image_volume

ANTENNAS, TONES = 48, 32  # of each kind, at most: more do not change which is sharpest
SHALLOW = 0.3  # an array deeper than this share of its width may stand around its target, where none is looked for
TOLERANCE = 0.1  # of a coarse image
WIDE, NEAR, FAR = 0.85, 1.0, 8.0  # the box imaged, in apertures: to either side, and along z from and to
CELL, DEEP = 2.0, 8.0  # resolution cell and depth of focus two apertures away, in wavelengths


@dataclass(frozen=True)
class Mistake:
    """A way to get echoes wrong: its name, what to do, its undoing, how many dB sharper the image of the undone echoes
    must be, and how many tones it takes to tell."""

    name: str
    cure: str
    undo: Callable[[RadarCapture], RadarCapture]
    sharper_db: float
    tones: int = 1


def _conjugated(capture: RadarCapture) -> RadarCapture:
    return replace(capture, samples=capture.samples.conj())


def _reversed(capture: RadarCapture) -> RadarCapture:
    return replace(capture, samples=capture.samples[:, ::-1])


# Measured on ten random scenes: undoing what is right costs 7 dB or more, and with 128 tones 3 dB or more.
MISTAKES = (
    Mistake("conjugated", 'conjugate the samples (sign = "+" in a mapping.toml)', _conjugated, 3.0),
    Mistake("with the tones in reverse order", "reverse frequencies_hz, or the samples along it", _reversed, 1.0, 8),
)


def findings(capture: RadarCapture) -> list[str]:
    """The mistakes that a capture's first frame shows by its focus, each with its cure; none where all is well, and of
    arrays that may stand around what they see."""
    first, (*across_m, deep_m) = replace(capture, samples=capture.samples[:1]), np.ptp(places_m(capture), axis=0)
    if not first.samples.any() or deep_m > SHALLOW * max(across_m):
        return []
    as_is_db = sharpness_db(first)
    possible = [mistake for mistake in MISTAKES if len(first.frequencies_hz) >= mistake.tones]
    gains = [(sharpness_db(mistake.undo(first)) - as_is_db, mistake) for mistake in possible]
    gained_db, mistake = max(gains, key=lambda found: found[0] - found[1].sharper_db)
    if gained_db < mistake.sharper_db:
        return []
    return [f"the echoes focus better, {gained_db:.0f} dB sharper, {mistake.name}: {mistake.cure}"]


def sharpness_db(capture: RadarCapture) -> float:
    """Sharpness of a coarse image of the first frame."""
    few = _few(capture)
    volume = image_volume(few.samples[0], few.frequencies_hz, few.aperture, _box(few), TOLERANCE, carrier=False)
    power = np.abs(volume).astype(np.float64) ** 2
    return float(10 * np.log10((power**2).sum() / power.sum() ** 2))


def _few(capture: RadarCapture) -> RadarCapture:
    """The first frame with few tones, in rising order, and few antennas: enough for a coarse image."""
    order = np.argsort(capture.frequencies_hz, kind="stable")
    kept = order[np.unique(np.linspace(0, len(order) - 1, min(TONES, len(order))).round().astype(int))]
    samples, frequencies_hz = capture.samples[:1, kept], capture.frequencies_hz[kept]
    in_vacuum = {"frequencies_hz": frequencies_hz * (SPEED_OF_LIGHT_M_S / capture.wave_speed_m_s)}
    few = replace(capture, samples=samples, wave_speed_m_s=SPEED_OF_LIGHT_M_S, **in_vacuum)
    most = ANTENNAS if isinstance(capture.aperture, AntennaArray) else ANTENNAS**2
    return thinned(few, max(1, -(-max(capture.aperture.channels) // most)))


def _box(capture: RadarCapture) -> VoxelGrid:
    """Coarse voxels before the aperture, which the echoes of anything near are in."""
    places = places_m(capture)
    middle_m, size_m = (places.min(axis=0) + places.max(axis=0)) / 2, float(np.ptp(places, axis=0).max())
    length_m = SPEED_OF_LIGHT_M_S / capture.frequencies_hz.mean()
    span_hz = np.ptp(capture.frequencies_hz)
    deep_m = min(DEEP * length_m, 0.8 * SPEED_OF_LIGHT_M_S / (2 * span_hz) if span_hz > 0 else np.inf)
    wide_m = max(WIDE * size_m, length_m)
    across_m = np.arange(-wide_m, wide_m, max(CELL * length_m, wide_m / 40))
    far_m = max(FAR * size_m, 2 * deep_m)
    return VoxelGrid(
        middle_m[0] + across_m,
        middle_m[1] + across_m,
        middle_m[2] + np.arange(NEAR * size_m, far_m, max(deep_m, far_m / 100)),
    )

"""Doubts about where antennas are and about their tones, told by the numbers themselves."""

from collections.abc import Iterator

import numpy as np

from handbench.bench.datasets.native import FAR_M
from handbench.radar.data.capture import RadarCapture

UNITS = ((1e3, "gigahertz", "1e9"), (1e6, "megahertz", "1e6"))  # of frequencies that are, in hertz, below any radar's
LOWEST_HZ, HIGH_HZ = 3e8, 1e12  # of radars whose arrays are told of in metres; more is likelier a wrong unit
MOST_WAVELENGTHS, LEAST_WAVELENGTHS = 1000.0, 0.25  # an array's extent: more or less is in another unit, most likely
FEWEST_PLACES = 4  # that span as little
FLAT = 0.05  # of an array's largest extent: thinner, it is a plane


def lacking(capture: RadarCapture) -> Iterator[str]:
    """A sentence on pairs of antennas that were not measured, if any."""
    heard = getattr(capture.aperture, "measured", None)
    if heard is not None and not heard.all():
        yield f"{np.sum(~heard)} of its {heard.size} pairs were not measured; images do without"


def array_doubts(capture: RadarCapture) -> Iterator[str]:
    """Doubts about where the antennas are and about the tones, each with its cure."""
    places, tones_hz = places_m(capture), capture.frequencies_hz
    highest_hz, far_m, extent_m = float(tones_hz.max()), float(np.abs(places).max()), np.ptp(places, axis=0)
    waves = float(extent_m.max()) * highest_hz / capture.wave_speed_m_s
    unit, factor = next(((unit, factor) for below_hz, unit, factor in UNITS if highest_hz < below_hz), ("", ""))
    if unit:
        yield f"its highest frequency is {highest_hz:g} Hz: are these {unit}? multiply them by {factor}"
    if far_m > FAR_M:
        yield f"an antenna lies {far_m:g} m from the origin: are its positions millimetres? multiply them by 1e-3"
    elif unit:
        pass  # no wavelength is known
    elif waves > MOST_WAVELENGTHS and highest_hz > HIGH_HZ:
        yield f"its highest frequency is {highest_hz:g} Hz: is that a thousand times too much? multiply them by 1e-3"
    elif waves > MOST_WAVELENGTHS:
        span = f"the antennas span {extent_m.max():g} m, over {MOST_WAVELENGTHS:g} wavelengths"
        yield f"{span}: are their positions centimetres? multiply them by 1e-2; or inches? by 0.0254"
    elif 0 < waves < LEAST_WAVELENGTHS and len(places) > FEWEST_PLACES:
        span = f"the antennas span {extent_m.max():g} m, {waves:.2g} wavelengths at {highest_hz:g} Hz"
        what = "frequencies kilohertz" if highest_hz < LOWEST_HZ else "positions kilometres"
        yield f"{span}: are the {what}? multiply them by 1e3"
    flat = int(extent_m.argmin())
    if flat != 2 and extent_m[flat] < FLAT * extent_m.max() < extent_m[2]:
        plane = f"the array lies in the plane of {'xy'[1 - flat]} and z"
        yield f"{plane}, so that it looks along {'xy'[flat]}: z is to point away from it; exchange the axes"
    if twice := len(tones_hz) - len(np.unique(tones_hz)):
        yield f"{twice} of {len(tones_hz)} tones are there twice: leave them out, or mend frequencies_hz"


def places_m(capture: RadarCapture) -> np.ndarray:
    """Positions [n, 3] of the antennas."""
    return np.concatenate([leg.position_m for leg in capture.aperture.legs])

"""The tables [methods] of an imported capture, with which methods use its tones, antennas and
depths at once."""

from typing import Any

import numpy as np

from handbench.radar.data.arrays import SPEED_OF_LIGHT_M_S, range_cell_m
from handbench.radar.data.capture import RadarCapture
from handbench.radar.methods.advice import matching_settings, require_tones
from handbench.radar.methods.evidence import POINT_WAVELENGTHS, live_extents_m, shortest_m
from handbench.radar.methods.first_depth import ENOUGH, first_depth_m
from handbench.radar.methods.registry import method
from handbench.support.errors import HandbenchError

PAIR_HZ = 200e6  # between the paper's close tones: depths are unambiguous within ±0.375 m
HALF_BOX_M = 0.15  # before and behind the target: depths of a volume
NEAREST_M = 0.02
STEPS = 8  # of the depth in a range cell


def method_tables(capture: RadarCapture) -> dict[str, dict[str, Any]]:
    """Choose settings of 2-FSK, 3-FSK and broadband backprojection for a capture: values by the
    settings' names, by the method's id. Left out are methods that its tones do not allow: 3-FSK of
    two tones, broadband of unevenly spaced ones.

    The FSK pair is as close as the paper's, if it can be, and 3-FSK's third tone as many times
    further away. The depths of the volume are those around the strongest target. A row of
    antennas makes maps of one row.
    """
    tones_hz = np.unique(capture.frequencies_hz)[::-1]
    if len(tones_hz) < 2:
        return {}
    step_hz = float(np.median(-np.diff(tones_hz)))
    row = _row(capture)
    every = max(1, min(int(PAIR_HZ / step_hz), (len(tones_hz) - 1) // 2))
    begun = {"first_depth_m": "auto"} if len(tones_hz) >= ENOUGH else {}
    tables: dict[str, dict[str, Any]] = {}
    for name, used_hz in (("2fsk", tones_hz[::every]), ("3fsk", tones_hz[::every])):
        known = method(name).config.model_fields
        tables[name] = matching_settings(used_hz, known) | begun | row
    known = method("broadband").config.model_fields
    tables["broadband"] = (
        matching_settings(tones_hz, known) | _box(capture, tones_hz, step_hz) | row
    )
    return {name: table for name, table in tables.items() if _fits(capture, name, table)}


def _box(capture: RadarCapture, tones_hz: np.ndarray, step_hz: float) -> dict[str, Any]:
    """Choose the axis z of a volume around the strongest target; none if the tones are too few to
    find it, or nothing stands out."""
    far_m = first_depth_m(capture)
    if far_m is None:
        return {}
    half_m = min(HALF_BOX_M, SPEED_OF_LIGHT_M_S / 4 / step_hz)
    step_m = max(1e-3, round(range_cell_m(tones_hz) / STEPS, 4))
    start_m = round(max(far_m - half_m, NEAREST_M), 3)
    count = int((far_m + half_m - start_m) / step_m)
    return {
        "z": {"start_m": start_m, "stop_m": round(start_m + count * step_m, 4), "step_m": step_m}
    }


def _row(capture: RadarCapture) -> dict[str, Any]:
    """Choose the axes across which the antennas do not extend: one pixel at their place."""
    point_m, extents_m = POINT_WAVELENGTHS * shortest_m(capture), live_extents_m(capture, 0)
    middle_m = np.mean([leg.position_m.mean(axis=0) for leg in capture.aperture.legs], axis=0)
    at_m = dict(zip("xy", np.round(middle_m[:2], 4).tolist(), strict=True))
    return {
        name: {"start_m": at_m[name], "stop_m": at_m[name], "step_m": 1e-3}
        for name, extent_m in zip("xy", extents_m, strict=False)
        if extent_m < point_m
    }


def _fits(capture: RadarCapture, name: str, table: dict[str, Any]) -> bool:
    """True if a method with these settings asks for tones that the capture has."""
    chosen = method(name)
    try:
        config = chosen.configure(table, name)
        require_tones(capture, config)
    except HandbenchError:
        return False
    fields = {"f1_hz", "f2_hz", "f3_hz"} & chosen.config.model_fields.keys()
    return fields <= table.keys()

"""Advice for the user where a capture does not suit a method's settings: which of its tones fit,
and what limits the depths."""

from __future__ import annotations

from collections.abc import Container, Iterator, Mapping
from typing import Any

import numpy as np

from handbench.radar.data.arrays import SPEED_OF_LIGHT_M_S
from handbench.radar.data.capture import RadarCapture, even_subset, scaled_to_one
from handbench.radar.data.depthmap import DepthMap
from handbench.radar.data.grid import Axis, PixelGrid
from handbench.radar.methods.doppler import Repetition, shift_s
from handbench.radar.methods.first_depth import ENOUGH, first_depth_m
from handbench.radar.methods.fsk_config import AnyConfig, RefinedConfig, reach_hz
from handbench.support.config import Config
from handbench.support.errors import HandbenchError

EXAMPLE_M_S = 0.1  # of a slow gesture
SHOWN_M = 2e-4  # a shift by motion that is worth a sentence
ABOVE_NOISE = 2.0  # times that velocities exceed those of noise if the target moves
PAIR_HZ = 200e6  # between the paper's close tones: depths are unambiguous within ±0.375 m
TINY = 1e-30
PROBED = 400  # pixels whose velocity is measured for it
NEAR_LIMIT, MANY = 0.8, 0.01  # of the unambiguous velocity; share of pixels
CLIMB = 12.5  # ratio of the reaches of two successive rungs: 200 MHz to 2.5 GHz in the paper
# settings of one tone each, the close pair first
TONES = ("f1_hz", "f2_hz", "f3_hz")


def requested_tones_hz(config: Config) -> np.ndarray | None:
    """Return the tones [f], hertz, that a method's configuration requests; None if it names
    none."""
    tones_hz: Any = getattr(config, "ladder_hz", getattr(config, "tones_hz", None))
    return None if tones_hz is None else np.asarray(tones_hz() if callable(tones_hz) else tones_hz)


def require_tones(capture: RadarCapture, config: Config) -> None:
    """Raise HandbenchError for a capture without the tones that a method's configuration requests,
    or, if it asks for velocities, without one that is measured twice. If the method could use the
    capture's tones with other settings, the message names these."""
    if (asked := requested_tones_hz(config)) is None:
        return
    try:
        capture.tones(asked)
        if getattr(config, "doppler", False):
            Repetition.of(capture, asked)
    except HandbenchError as error:
        suited_to = matching_settings(
            np.unique(capture.frequencies_hz)[::-1], type(config).model_fields
        )
        try:
            suited = type(config).model_validate({**config.model_dump(), **suited_to})
            tones_hz = np.asarray(requested_tones_hz(suited))
            capture.tones(tones_hz)
            if getattr(config, "doppler", False):
                Repetition.of(capture, tones_hz)
        except (HandbenchError, ValueError):  # its tones are too few, uneven, or no ladder
            raise error from None
        other = {name: v for name, v in suited_to.items() if v != getattr(config, name)}
        if not other:
            raise
        raise HandbenchError(f"{error}, e.g. {settings_text(other)}") from None


def settings_text(values: Mapping[str, Any]) -> str:
    """Return a method's settings (name → value) as text, such as f1_hz=82e9, f2_hz=81.9e9: in the
    form of `--set`, of a table in a benchmark and of Python's arguments."""
    return ", ".join(f"{name}={_value_text(value)}" for name, value in values.items())


def _value_text(value: Any) -> str:
    """Format a value; a float from 1e6 on is written in units of 1e9, such as 82e9."""
    if isinstance(value, tuple):
        return f"[{','.join(map(_value_text, value))}]"
    if isinstance(value, float) and abs(value) >= 1e6:
        return f"{value / 1e9:.10g}e9"
    return f"{value:.10g}" if isinstance(value, float) else str(value)


def matching_settings(tones_hz: np.ndarray, known: Container[str]) -> dict[str, Any]:
    """Choose settings with which a method uses the tones_hz [f] that a capture has, highest first:
    values by the settings' names. known: names of the settings that the method has."""
    if "count" in known:
        return {
            "start_hz": float(tones_hz[-1]),
            "stop_hz": float(tones_hz[0]),
            "count": len(tones_hz),
        }
    rungs, reach_hz = [0, 1], np.ptp(tones_hz[:2])
    while len(tones_hz) > 2 and reach_hz < np.ptp(tones_hz):
        reach_hz *= CLIMB
        rungs.append(2 + int(np.abs(tones_hz[2:] - tones_hz[0] + reach_hz).argmin()))
    found = tones_hz[np.unique(rungs) % len(tones_hz)].tolist()
    names = [name for name in TONES if name in known]
    return (
        {"tones_hz": tuple(found)} if "tones_hz" in known else dict(zip(names, found, strict=False))
    )


def default_config(frequencies_hz: np.ndarray) -> dict[str, dict[str, Any]]:
    """Choose settings of 2-FSK, 3-FSK and broadband backprojection for the tones of a capture:
    values by the settings' names, by the method's id. Left out are methods that the tones do not
    allow: 3-FSK of two tones, broadband of unevenly spaced ones.

    The FSK pair is as close as the paper's, if it can be, and 3-FSK's third tone as many times
    further away.
    """
    tones_hz = np.unique(frequencies_hz)[::-1]
    if len(tones_hz) < 2:
        return {}
    steps_hz = -np.diff(tones_hz)
    every = max(1, min(int(PAIR_HZ / np.median(steps_hz)), (len(tones_hz) - 1) // 2))
    first = {"first_depth_m": "auto"} if len(tones_hz) >= ENOUGH else {}
    pairs_hz = tones_hz[::every]
    chosen = {"2fsk": matching_settings(pairs_hz, ("f1_hz", "f2_hz")) | first}
    if len(tones_hz) > 2:
        chosen["3fsk"] = matching_settings(pairs_hz, ("f1_hz", "f2_hz", "f3_hz")) | first
    if np.allclose(steps_hz, steps_hz[0], rtol=1e-3, atol=0):
        chosen["broadband"] = matching_settings(tones_hz, ("count",))
    return chosen


def notes(depth: DepthMap, capture: RadarCapture, config: Config, frame: int = 0) -> Iterator[str]:
    """Yield sentences for the user on what limits the depth map of a capture's frame: motion while
    the tones are measured, ambiguous depths, echoes at an end of the depth box, low range
    resolution, or a short unambiguous range. config: configuration of the method that made the
    map."""
    seen, asked = np.isfinite(depth.z_m), requested_tones_hz(config)
    if asked is None or len(asked) < 2 or not seen.any():
        return
    yield from motion_notes(depth, capture, config, frame)
    steps_hz = np.diff(np.sort(capture.tones(asked)[1]))
    cell_mm, period_mm = (
        500 * SPEED_OF_LIGHT_M_S / step_hz for step_hz in (steps_hz.sum(), steps_hz.min())
    )
    ends_m = (
        axis.values_m()[[0, -1]]
        if isinstance(axis := getattr(config, "z", None), Axis)
        else np.zeros(2)
    )
    box_mm, set_box = 1e3 * np.ptp(ends_m), "z.start_m=… and z.stop_m=…"
    at_end = np.isclose(depth.z_m[..., None], ends_m, rtol=0, atol=1e-9).any(axis=-1).sum()
    wrapped = 0 if axis or depth.wrapped is None else np.count_nonzero(depth.wrapped & seen)
    if isinstance(config, AnyConfig) and config.first_depth_m != "auto":
        limit = (
            f"the two closest tones determine depths only within {period_mm / 2:.0f} mm of "
            f"first_depth_m = {config.first_depth_m:g}"
        )
        found_m = first_depth_m(capture, frame)
        near_m = float(np.median(depth.z_m[seen]))
        if found_m is not None and abs(found_m - near_m) > 0.5e-3 * period_mm:
            way = "behind" if found_m > near_m else "in front of"
            yield (
                f"{limit}, but the echoes come from {found_m:.2f} m, about "
                f"{1e3 * abs(found_m - near_m):.0f} mm {way} these depths; use "
                "first_depth_m=auto"
            )
        elif found_m is None and wrapped > seen.sum() / 2:
            yield (
                f"the phases of {wrapped} of {seen.sum()} pixels may be off by a whole period, "
                f"because {limit}; set first_depth_m to the distance of the target"
            )
    if box_mm and at_end:
        box = f"the depth box, {ends_m[0]:g} to {ends_m[1]:g} m"
        yield (
            f"{at_end} of {seen.sum()} pixels are strongest at an end of {box}, so the target may "
            f"be outside; widen the box with {set_box}"
        )
    if 0 < box_mm < cell_mm:
        limit = (
            f"the tones' range resolution c/2B is {cell_mm:.0f} mm, and the depth box "
            f"{box_mm:.0f} mm deep"
        )
        yield (
            f"{limit}, so the strongest voxel hardly shows the depth; use a method that compares "
            "phases (2fsk, 3fsk, joint), or more bandwidth"
        )
    if period_mm < box_mm:
        limit = (
            f"the tones' unambiguous range c/2Δf is {period_mm:.0f} mm, shorter than the box "
            f"of {box_mm:.0f} mm"
        )
        yield (
            f"{limit}, so echoes repeat inside the box; narrow the box with {set_box}, or use "
            "more tones"
        )


def motion_notes(
    depth: DepthMap, capture: RadarCapture, config: Config, frame: int = 0
) -> Iterator[str]:
    """Yield a sentence for the user if motion between the tones shifts the depths of a map, or may
    do so; of a map with velocities, if these come near the largest one that is unambiguous.

    config: configuration of the method that made the map. Nothing is known of captures without
    times.
    """
    from handbench.radar.imaging.api import image_points  # numba, which most callers do not need

    seen, tones_hz = np.isfinite(depth.z_m), requested_tones_hz(config)
    if capture.times_s is None or tones_hz is None or len(tones_hz) < 2 or not seen.any():
        return
    if depth.velocity_m_s is not None:
        limit_m_s = depth.velocity_limit_m_s or np.inf
        near = np.abs(depth.velocity_m_s[seen]) > NEAR_LIMIT * limit_m_s
        if near.mean() > MANY:
            yield (
                f"the velocities of {100 * near.mean():.0f} % of the pixels come near the limit of "
                f"{limit_m_s:.2g} m/s, beyond which they repeat, and depths may be wrong there; "
                "measure the repeated tone after a shorter time"
            )
        return
    index = capture.tone_index(tones_hz)
    times_s = capture.times_s[index] - capture.times_s.min()
    try:
        repetition = Repetition.of(capture, tones_hz)
    except HandbenchError:
        shift_m, words = _shift_by_motion(config, capture.vacuum_hz[index], times_s, EXAMPLE_M_S)
        if shift_m > SHOWN_M:
            yield (
                f"a radial velocity of {EXAMPLE_M_S:g} m/s would shift {words}, and none of the "
                f"tones of {depth.method} is measured twice to show it; if the target moves, "
                "measure the first tone again after the last, and use a method that ends in "
                "-doppler"
            )
        return
    some = np.flatnonzero(seen)
    some = some[even_subset(len(some), PROBED)]
    points_m = PixelGrid(depth.x_m, depth.y_m).points_at_m(some, depth.z_m.ravel()[some])
    hz = np.full(2, repetition.frequency_hz)
    samples = scaled_to_one(capture.samples[frame][repetition.measured])
    first, last = image_points(samples, hz, capture.aperture, points_m, None, apart=True)
    speed_m_s = float(np.median(np.abs(repetition.velocity_m_s(last * np.conj(first)))))
    # noise changes amplitudes as much as phases, motion hardly changes them
    first, last = np.abs(first), np.abs(last)
    noise_rad = float(np.median(np.abs(last - first) / np.maximum((last + first) / 2, TINY)))
    moves = speed_m_s > ABOVE_NOISE * noise_rad / np.pi * repetition.limit_m_s
    shift_m, words = _shift_by_motion(config, capture.vacuum_hz[index], times_s, speed_m_s)
    if moves and shift_m > SHOWN_M:
        yield (
            f"the target moves: its radial velocity of {speed_m_s:.2g} m/s (median of the "
            f"pixels) shifts {words}; use a method that ends in -doppler instead of {depth.method}"
        )


def _shift_by_motion(
    config: Config, frequencies_hz: np.ndarray, times_s: np.ndarray, speed_m_s: float
) -> tuple[float, str]:
    """Compute by how much a radial velocity shifts the depths of a method with these tones [f]:
    (metres, words). With a ladder of tones, a coarse depth that is shifted by more than the next
    tone resolves makes depths wrong by a period."""
    rungs = range(2, len(frequencies_hz)) if isinstance(config, RefinedConfig) else ()
    for count in rungs:
        coarse_m = speed_m_s * abs(shift_s(frequencies_hz[:count], times_s[:count]))
        resolved_m = SPEED_OF_LIGHT_M_S / (4 * reach_hz(frequencies_hz[: count + 1]))
        if coarse_m > resolved_m:
            return coarse_m, (
                f"the coarse depths by about {1e3 * coarse_m:.2g} mm, more than the "
                f"±{1e3 * resolved_m:.2g} mm that the next tone resolves, so that depths are wrong "
                "by a whole period"
            )
    shift_m = speed_m_s * abs(shift_s(frequencies_hz, times_s))
    return shift_m, f"the depths by about {1e3 * shift_m:.2g} mm"

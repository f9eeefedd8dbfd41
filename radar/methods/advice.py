"""Advice for a capture that a method's settings do not suit: what its tones lack, and what its
images cannot tell."""

from __future__ import annotations

from collections.abc import Container, Iterator
from typing import Any

import numpy as np

from handbench.radar.data.arrays import SPEED_OF_LIGHT_M_S
from handbench.radar.data.capture import RadarCapture
from handbench.radar.data.depthmap import DepthMap
from handbench.radar.data.grid import Axis, PixelGrid
from handbench.support.config import Config
from handbench.support.errors import HandbenchError

CLIMB = 12.5  # times as far as the rung before it: 200 MHz to 2.5 GHz in the paper
CLOSER, CLOSEST = (
    3,
    16,
)  # times as close as a method's pair: tones that reach further, and still tell the period
STRONGEST = 200  # pixels whose echoes tell where the target is, together
LEAST_COHERENCE = 0.5  # coherence of two tones' images, from which on they show one thing
TONES = (
    "f1_hz",
    "f2_hz",
    "close_hz",
    "f3_hz",
    "far_hz",
)  # settings of one tone each, the pair that is close first


def requested_tones_hz(config: Config) -> np.ndarray | None:
    """The tones [f] that a configuration asks for; None where it names none."""
    told: Any = getattr(config, "ladder_hz", getattr(config, "tones_hz", None))
    return None if told is None else np.asarray(told() if callable(told) else told)


def require_tones(capture: RadarCapture, config: Config) -> None:
    """HandbenchError where the capture lacks tones that a configuration asks for; names settings
    for those it has."""
    if (asked := requested_tones_hz(config)) is None:
        return
    try:
        capture.tones(asked)
    except HandbenchError as error:
        settings = _matching_settings(
            np.unique(capture.frequencies_hz)[::-1], type(config).model_fields
        )
        try:
            suited = type(config).model_validate({**config.model_dump(), **settings})
            capture.tones(np.asarray(requested_tones_hz(suited)))
        except (HandbenchError, ValueError):  # its tones are too few, uneven, or no ladder
            raise error from None
        told = " ".join(
            f"--set {name}={_text(v)}" for name, v in settings.items() if v != getattr(config, name)
        )
        raise HandbenchError(f"{error}, as by {told}") from None


def _matching_settings(tones_hz: np.ndarray, known: Container[str]) -> dict[str, Any]:
    """The settings among those known by which a method takes tones that are there, the highest of
    them first."""
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


def _text(value: Any) -> str:
    """A setting as it is typed."""
    if isinstance(value, tuple):
        return f"'[{','.join(map(_text, value))}]'"
    return f"{value / 1e9:.10g}e9" if isinstance(value, float) else str(value)


def notes(depth: DepthMap, capture: RadarCapture, config: Config, frame: int = 0) -> Iterator[str]:
    """Sentences on what limits a depth map of this capture's frame."""
    seen, asked = np.isfinite(depth.z_m), requested_tones_hz(config)
    if asked is None or len(asked) < 2 or not seen.any():
        return
    steps_hz, pixels = np.diff(np.sort(capture.tones(asked)[1])), f"of {seen.sum()} pixels are"
    cell_mm, period_mm = (
        500 * SPEED_OF_LIGHT_M_S / step_hz for step_hz in (steps_hz.sum(), steps_hz.min())
    )
    ends_m = (
        axis.values_m()[[0, -1]]
        if isinstance(axis := getattr(config, "z", None), Axis)
        else np.zeros(2)
    )
    box_mm, set_box = 1e3 * np.ptp(ends_m), "--set z.start_m=… --set z.stop_m=…"
    at_end = np.isclose(depth.z_m[..., None], ends_m, rtol=0, atol=1e-9).any(axis=-1).sum()
    flagged = 0 if axis or depth.wrapped is None else np.count_nonzero(depth.wrapped & seen)
    if first_m := getattr(config, "first_depth_m", None):
        told = (
            f"the closest tones tell depths within {period_mm / 2:.0f} mm of first_depth_m = "
            f"{first_m:g}"
        )
        off_mm = 1e3 * _off_m(depth, capture, asked, frame)
        if abs(off_mm) > period_mm / 2:
            target_m = float(np.median(depth.z_m[seen])) + 1e-3 * off_mm
            way = f"some {abs(off_mm):.0f} mm {'behind' if off_mm > 0 else 'before'} these depths"
            yield (
                f"{told}, and the target lies {way}, as closer tones tell; set "
                f"first_depth_m={target_m:.2f}"
            )
        elif flagged > seen.sum() / 2:
            yield f"{flagged} {pixels} flagged; {told}; set that to the target's distance"
    if box_mm and at_end:
        box = f"the depth box, {ends_m[0]:g} to {ends_m[1]:g} m"
        yield (
            f"{at_end} {pixels} strongest at an end of {box}, and flagged: the echo may lie "
            f"beyond; {set_box}"
        )
    if 0 < box_mm < cell_mm:
        told = (
            f"the tones' range resolution c/2B is {cell_mm:.0f} mm, and the depth box "
            f"{box_mm:.0f} mm deep"
        )
        yield (
            f"{told}: brightness hardly tells a depth in it; phases do (2fsk, 3fsk, joint), or "
            "more bandwidth"
        )
    if period_mm < box_mm:
        told = (
            f"the tones' unambiguous range c/2Δf is {period_mm:.0f} mm, shorter than the box "
            f"of {box_mm:.0f} mm"
        )
        yield f"{told}: echoes repeat in it; {set_box}, or more tones"


def _off_m(depth: DepthMap, capture: RadarCapture, asked_hz: np.ndarray, frame: int) -> float:
    """By how much the target lies behind a map's strongest pixels, as a pair of the capture's tones
    tells that lie closer together than any of those asked for; 0 where there is no such pair."""
    from handbench.radar.imaging.api import image_points
    from handbench.radar.methods.fsk import depth_step_m

    first_hz, apart_hz = asked_hz[0], np.abs(capture.frequencies_hz - asked_hz[0])
    gap_hz = np.diff(np.sort(asked_hz)).min()
    fit = np.flatnonzero((apart_hz >= gap_hz / CLOSEST) & (apart_hz <= gap_hz / CLOSER))
    if not len(fit):
        return 0.0
    pair_hz = np.array([first_hz, capture.frequencies_hz[fit[apart_hz[fit].argmin()]]])
    samples, pair_hz = capture.tones(pair_hz, frame)
    seen = np.flatnonzero(np.isfinite(depth.z_m))
    strongest = seen[np.argsort(depth.amplitude_db.ravel()[seen])[-STRONGEST:]]
    points_m = PixelGrid(depth.x_m, depth.y_m).points_at_m(strongest, depth.z_m.ravel()[strongest])
    a, b = image_points(samples, pair_hz, capture.aperture, points_m, None, apart=True)
    if abs(np.vdot(a, b)) < LEAST_COHERENCE * np.linalg.norm(a) * np.linalg.norm(
        b
    ):  # noise has no distance
        return 0.0
    return float(depth_step_m(np.vdot(a, b), np.ones(1), pair_hz[1] - pair_hz[0])[0])

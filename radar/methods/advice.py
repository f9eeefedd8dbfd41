"""Advice for a capture that does not suit a method's settings: tones that it lacks, and limits of
its depths."""

from __future__ import annotations

from collections.abc import Container, Iterator
from typing import Any

import numpy as np

from handbench.radar.data.arrays import SPEED_OF_LIGHT_M_S
from handbench.radar.data.capture import RadarCapture
from handbench.radar.data.depthmap import DepthMap
from handbench.radar.data.grid import Axis, PixelGrid
from handbench.support.caller import settings
from handbench.support.config import Config
from handbench.support.errors import HandbenchError

CLIMB = 12.5  # ratio of the reaches of two successive rungs: 200 MHz to 2.5 GHz in the paper
# a pair of tones that many times closer than the method's resolves its period
CLOSER, CLOSEST = 3, 16
STRONGEST = 200  # pixels whose echoes locate the target
LEAST_COHERENCE = 0.5  # coherence of two tones' images of the same target
# settings of one tone each, the close pair first
TONES = ("f1_hz", "f2_hz", "close_hz", "f3_hz", "far_hz")


def requested_tones_hz(config: Config) -> np.ndarray | None:
    """Return the tones [f], hertz, that a method's configuration requests; None if it names
    none."""
    tones_hz: Any = getattr(config, "ladder_hz", getattr(config, "tones_hz", None))
    return None if tones_hz is None else np.asarray(tones_hz() if callable(tones_hz) else tones_hz)


def require_tones(capture: RadarCapture, config: Config) -> None:
    """Raise HandbenchError for a capture without the tones that a configuration requests. If other
    settings fit the capture's tones, the message names them."""
    if (asked := requested_tones_hz(config)) is None:
        return
    try:
        capture.tones(asked)
    except HandbenchError as error:
        suited_to = _matching_settings(
            np.unique(capture.frequencies_hz)[::-1], type(config).model_fields
        )
        try:
            suited = type(config).model_validate({**config.model_dump(), **suited_to})
            capture.tones(np.asarray(requested_tones_hz(suited)))
        except (HandbenchError, ValueError):  # its tones are too few, uneven, or no ladder
            raise error from None
        other = {name: v for name, v in suited_to.items() if v != getattr(config, name)}
        raise HandbenchError(f"{error}, e.g. {settings(other)}") from None


def _matching_settings(tones_hz: np.ndarray, known: Container[str]) -> dict[str, Any]:
    """Choose settings with which a method uses the capture's tones_hz [f], highest first: values by
    name, of the names in `known`."""
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


def notes(depth: DepthMap, capture: RadarCapture, config: Config, frame: int = 0) -> Iterator[str]:
    """Yield sentences for the user on what limits a depth map of this capture's frame: ambiguous
    depths, echoes at an end of the depth box, low range resolution, a short unambiguous range.
    config: of the method that made it."""
    seen, asked = np.isfinite(depth.z_m), requested_tones_hz(config)
    if asked is None or len(asked) < 2 or not seen.any():
        return
    steps_hz = np.diff(np.sort(capture.tones(asked)[1]))
    cell_mm, period_mm = (
        500 * SPEED_OF_LIGHT_M_S / step_hz for step_hz in (steps_hz.sum(), steps_hz.min())
    )
    ends_m = (
        axis.values_m()[[0, -1]]
        if isinstance(axis := getattr(config, "z", None), Axis)
        else np.zeros(2)
    )
    box_mm, set_box = 1e3 * np.ptp(ends_m), settings({"z.start_m": "…", "z.stop_m": "…"})
    at_end = np.isclose(depth.z_m[..., None], ends_m, rtol=0, atol=1e-9).any(axis=-1).sum()
    wrapped = 0 if axis or depth.wrapped is None else np.count_nonzero(depth.wrapped & seen)
    if first_m := getattr(config, "first_depth_m", None):
        limit = (
            f"the two closest tones determine depths only within {period_mm / 2:.0f} mm of "
            f"first_depth_m = {first_m:g}"
        )
        off_mm = 1e3 * _off_m(depth, capture, asked, frame)
        if abs(off_mm) > period_mm / 2:
            target_m = float(np.median(depth.z_m[seen])) + 1e-3 * off_mm
            way = (
                f"about {abs(off_mm):.0f} mm {'behind' if off_mm > 0 else 'in front of'} these "
                "depths"
            )
            yield (
                f"{limit}, but other tones of the capture place the target {way}; use "
                f"{settings({'first_depth_m': f'{target_m:.2f}'})}"
            )
        elif wrapped > seen.sum() / 2:
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


def _off_m(depth: DepthMap, capture: RadarCapture, asked_hz: np.ndarray, frame: int) -> float:
    """Estimate how far the target lies behind the depths of a map's strongest pixels, metres, by a
    pair of the capture's tones closer together than those requested (asked_hz), which is less
    ambiguous; 0 without such a pair, or if its images are noise."""
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
    # noise has no distance
    if abs(np.vdot(a, b)) < LEAST_COHERENCE * np.linalg.norm(a) * np.linalg.norm(b):
        return 0.0
    return float(depth_step_m(np.vdot(a, b), np.ones(1), pair_hz[1] - pair_hz[0])[0])

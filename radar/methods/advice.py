"""Advice for a capture that a method's settings do not suit: what its tones lack, and what its images cannot tell."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np

from radar.data.arrays import SPEED_OF_LIGHT_M_S
from radar.data.capture import RadarCapture
from radar.data.depthmap import DepthMap
from radar.support.config import Config
from radar.support.errors import HandbenchError

CLIMB = 12.5  # times as far as the rung before it: 200 MHz to 2.5 GHz in the paper
TONES = ("f1_hz", "f2_hz", "close_hz", "f3_hz", "far_hz")  # settings of one tone each, the pair that is close first


def asked_hz(config: Config) -> np.ndarray | None:
    """The tones [f] that a configuration asks for; None where it names none."""
    told: Any = getattr(config, "ladder_hz", getattr(config, "tones_hz", None))
    return None if told is None else np.asarray(told() if callable(told) else told)


def asked_tones(capture: RadarCapture, config: Config, frame: int = 0) -> tuple[np.ndarray, np.ndarray]:
    """`RadarCapture.tones` for a configuration; where the capture lacks some, the error names the settings that suit
    those that it has."""
    try:
        return capture.tones(np.asarray(asked_hz(config)), frame)
    except HandbenchError as error:
        told = {name: value for name, value in _suiting(config, capture).items() if value != getattr(config, name)}
        advice = " ".join(f"--set {name}={_text(value)}" for name, value in told.items())
        raise HandbenchError(f"{error}{advice and f', as by {advice}'}") from None


def _suiting(config: Config, capture: RadarCapture) -> dict[str, Any]:
    """Settings for which the capture has the tones; none where there are no such."""
    tones_hz, known = np.unique(capture.frequencies_hz)[::-1], type(config).model_fields
    names = [name for name in TONES if name in known]
    if len(tones_hz) < max(len(names), 2 + ("tones_hz" in known)):
        return {}
    reach_hz, rungs = tones_hz[0] - tones_hz[1], [0, 1]
    while len(tones_hz) > 2 and reach_hz < np.ptp(tones_hz):
        reach_hz *= CLIMB
        rungs.append(2 + int(np.abs(tones_hz[2:] - tones_hz[0] + reach_hz).argmin()))
    found = tones_hz[np.unique(rungs)].tolist()
    settings: dict[str, Any] = {"tones_hz": tuple(found)} if "tones_hz" in known else {}
    settings |= dict(zip(names, found, strict=False))
    if "count" in known:
        settings = {"start_hz": float(tones_hz[-1]), "stop_hz": float(tones_hz[0]), "count": len(tones_hz)}
    try:
        capture.tones(np.asarray(asked_hz(type(config).model_validate({**config.model_dump(), **settings}))))
    except (HandbenchError, ValueError):  # its tones are uneven, or no ladder
        return {}
    return settings


def _text(value: Any) -> str:
    """A setting as it is typed."""
    if isinstance(value, tuple):
        return f"'[{','.join(map(_text, value))}]'"
    return f"{value / 1e9:.10g}e9" if isinstance(value, float) else str(value)


def notes(depth: DepthMap, capture: RadarCapture, config: Config) -> Iterator[str]:
    """Sentences on what limits a depth map of this capture."""
    seen_m, asked = depth.z_m[np.isfinite(depth.z_m)], asked_hz(config)
    if asked is None or len(asked) < 2 or not len(seen_m):
        return
    steps_hz = np.diff(np.sort(capture.tones(asked)[1]))
    cell_mm, period_mm = (500 * SPEED_OF_LIGHT_M_S / step_hz for step_hz in (steps_hz.sum(), steps_hz.min()))
    if (axis := getattr(config, "z", None)) is None:
        flagged = 0 if depth.wrapped is None else np.count_nonzero(depth.wrapped & np.isfinite(depth.z_m))
        if flagged > len(seen_m) / 2 and hasattr(config, "first_depth_m"):
            yield (
                f"{flagged} of {len(seen_m)} pixels are flagged; the closest tones tell depths within "
                f"{period_mm / 2:.0f} mm of first_depth_m = {config.first_depth_m:g}; set that to the target's distance"
            )
        return
    ends_m, set_box = axis.values_m()[[0, -1]], "--set z.start_m=… --set z.stop_m=…"
    if ends_m[0] == ends_m[1]:
        return
    box_mm, at_end = 1e3 * np.ptp(ends_m), np.isclose(seen_m[:, None], ends_m, rtol=0, atol=1e-9).any(axis=1).sum()
    if at_end:
        yield (
            f"{at_end} of {len(seen_m)} pixels are strongest at an end of the depth box, {ends_m[0]:g} to "
            f"{ends_m[1]:g} m, and flagged: the echo may lie beyond; {set_box}"
        )
    if cell_mm > box_mm:
        yield (
            f"the tones' range resolution c/2B is {cell_mm:.0f} mm, and the depth box {box_mm:.0f} mm deep: brightness "
            "hardly tells a depth in it; phases do (2fsk, 3fsk, joint), or more bandwidth"
        )
    if period_mm < box_mm:
        yield (
            f"the tones' unambiguous range c/2Δf is {period_mm:.0f} mm, shorter than the depth box of {box_mm:.0f} mm: "
            f"echoes repeat in it; {set_box}, or more tones"
        )

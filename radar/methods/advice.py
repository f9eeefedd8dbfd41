"""Advice for the user where a capture does not suit a method's settings: which of its tones fit."""

from __future__ import annotations

from collections.abc import Container, Mapping
from typing import Any

import numpy as np

from handbench.radar.data.capture import RadarCapture
from handbench.radar.methods.doppler import repetition
from handbench.radar.methods.first_depth import ENOUGH
from handbench.support.config import Config
from handbench.support.errors import HandbenchError

PAIR_HZ = 200e6  # between the paper's close tones: depths are unambiguous within ±0.375 m
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
            repetition(capture, asked)
    except HandbenchError as error:
        suited_to = matching_settings(
            np.unique(capture.frequencies_hz)[::-1], type(config).model_fields
        )
        try:
            suited = type(config).model_validate({**config.model_dump(), **suited_to})
            tones_hz = np.asarray(requested_tones_hz(suited))
            capture.tones(tones_hz)
            if getattr(config, "doppler", False):
                repetition(capture, tones_hz)
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

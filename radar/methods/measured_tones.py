"""Settings of methods for the tones that a capture has measured, written when it is imported."""

from typing import Any

import numpy as np

from handbench.radar.methods.first_depth import ENOUGH

LEAST_PAIR_HZ = 200e6  # between the paper's close tones: depths are unambiguous within ±0.375 m
CLIMB = 12.5  # ratio of the third tone's distance to that of the pair: 2.5 GHz in the paper


def measured_settings(frequencies_hz: np.ndarray) -> dict[str, dict[str, Any]]:
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
    apart = max(1, min(int(LEAST_PAIR_HZ / np.median(steps_hz)), (len(tones_hz) - 1) // 2))
    pair_hz = tones_hz[[0, apart]]
    fsk = {"first_depth_m": "auto"} if len(tones_hz) >= ENOUGH else {}
    chosen: dict[str, dict[str, Any]] = {"2fsk": {"tones_hz": pair_hz.tolist(), **fsk}}
    if len(tones_hz) > 2:
        further_hz = tones_hz[apart + 1 :]
        third = np.abs(further_hz - (tones_hz[0] - CLIMB * np.ptp(pair_hz))).argmin()
        chosen["3fsk"] = {"tones_hz": [*pair_hz.tolist(), float(further_hz[third])], **fsk}
    if np.allclose(steps_hz, steps_hz[0], rtol=1e-3, atol=0):
        sweep = {"start_hz": float(tones_hz[-1]), "stop_hz": float(tones_hz[0])}
        chosen["broadband"] = {"tones_hz": {**sweep, "count": len(tones_hz)}}
    return chosen

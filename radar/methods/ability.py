"""What the antennas and tones of a capture can show, in sentences for the user, and the settings of
methods for these tones."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np

from handbench.radar.data.arrays import SPEED_OF_LIGHT_M_S, lateral_cell_m, range_cell_m
from handbench.radar.data.capture import RadarCapture
from handbench.radar.methods.evidence import copies_m, different_frames, live_extents_m, shortest_m
from handbench.radar.methods.fsk import ENOUGH

LEAST_PAIR_HZ = 200e6  # between the paper's close tones: depths are unambiguous within ±0.375 m
CLIMB = 12.5  # ratio of the third tone's distance to that of the pair: 2.5 GHz in the paper


def abilities(capture: RadarCapture, z_m: float) -> Iterator[str]:
    """Yield sentences about a capture's aperture, its resolution at a depth, the ambiguity of its
    tones, and its noise."""
    hz = np.unique(capture.vacuum_hz)
    extents_m = live_extents_m(capture)[:2]
    cells_m = lateral_cell_m(shortest_m(capture), extents_m, z_m)
    (wide_mm, wide_cell_mm), (high_mm, high_cell_mm) = 1e3 * np.array([extents_m, cells_m]).T
    across_m, up_m = copies_m(capture, z_m)
    yield (
        f"aperture {wide_mm:.3g} × {high_mm:.3g} mm between the middles of transmitters and "
        f"receivers: resolves {wide_cell_mm:.3g} × {high_cell_mm:.3g} mm at {z_m:g} m (λz/2D)"
    )
    yield (
        f"images repeat every {across_m:.3g} × {up_m:.3g} m at {z_m:g} m (λz/d, d: the usual "
        "step of the sums of a transmitter's and a receiver's position)"
    )
    if len(hz) > 1:
        near_mm, far_mm = 250 * SPEED_OF_LIGHT_M_S / np.array([np.diff(hz).min(), np.ptp(hz)])
        yield (
            f"{len(hz)} tones from {hz[0] / 1e9:.6g} to {hz[-1] / 1e9:.6g} GHz: resolve "
            f"{1e3 * range_cell_m(hz):.3g} mm in depth (c/2B); phases are unambiguous within "
            f"±{near_mm:.0f} mm between the closest two, ±{far_mm:.3g} mm between the farthest "
            "(c/4Δf)"
        )
    frames = capture.samples[different_frames(capture.samples)]
    if len(frames) > 1:
        noise = np.diff(frames, axis=0)
        noise_db = 10 * np.log10((np.abs(noise) ** 2).mean() / 2 / (np.abs(frames) ** 2).mean())
        yield f"noise {noise_db:.0f} dB of the samples, by the differences of {len(frames)} frames"
    else:
        yield "noise unknown: it needs two frames"


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
        high_hz, *_, low_hz = tones_hz.tolist()
        sweep = {"start_hz": low_hz, "stop_hz": high_hz, "count": len(tones_hz)}
        chosen["broadband"] = {"tones_hz": sweep}
    return chosen


def further_settings(frequencies_hz: np.ndarray) -> dict[str, dict[str, Any]]:
    """Choose as `measured_settings` does, also for narrowband backprojection, n-FSK and the joint
    estimate."""
    measured = measured_settings(frequencies_hz)
    if fsk := measured.get("3fsk"):
        first_hz, _, third_hz = tones_hz = fsk["tones_hz"]
        measured["narrowband"] = {"tones_hz": tones_hz}
        lowest_hz = float(frequencies_hz.min())
        if lowest_hz < 2 * third_hz - first_hz:
            tones_hz = [*tones_hz, lowest_hz]
        measured |= dict.fromkeys(("nfsk", "joint"), fsk | {"tones_hz": tones_hz})
    return measured

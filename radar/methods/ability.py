"""What the antennas and tones of a capture can show, in sentences for the user."""

from __future__ import annotations

import json
from collections.abc import Iterator
from typing import Any

import numpy as np

from handbench.radar.data.arrays import SPEED_OF_LIGHT_M_S, range_cell_m
from handbench.radar.data.capture import RadarCapture
from handbench.radar.methods.evidence import (
    different_frames,
    live_extents_m,
    needed_tones,
    shortest_m,
)
from handbench.radar.methods.measured_tones import measured_settings
from handbench.radar.methods.settings import MethodSettings
from handbench.support.errors import HandbenchError


def abilities(capture: RadarCapture, z_m: float) -> Iterator[str]:
    """Yield sentences about a capture's aperture, its resolution at a depth, the ambiguity of its
    tones, and its noise."""
    hz = np.unique(capture.vacuum_hz)
    wide_mm, high_mm = 1e3 * live_extents_m(capture)[:2]
    with np.errstate(divide="ignore"):
        cells_mm = 1e6 * shortest_m(capture) * z_m / 2 / np.array([wide_mm, high_mm])
    yield (
        f"aperture {wide_mm:.3g} × {high_mm:.3g} mm between the middles of transmitters and "
        f"receivers: resolves {cells_mm[0]:.3g} × {cells_mm[1]:.3g} mm at {z_m:g} m (λz/2D)"
    )
    if len(hz) > 1:
        pairs_hz = np.diff(hz).min(), np.ptp(hz)
        near_mm, far_mm = (1e3 * SPEED_OF_LIGHT_M_S / 4 / pair_hz for pair_hz in pairs_hz)
        yield (
            f"{len(hz)} tones from {hz[0] / 1e9:.6g} to {hz[-1] / 1e9:.6g} GHz: resolve "
            f"{1e3 * range_cell_m(hz):.3g} mm in depth (c/2B); phases are unambiguous within "
            f"±{near_mm:.3g} mm between the closest two, ±{far_mm:.2g} mm between the farthest "
            "(c/4Δf)"
        )
    frames = capture.samples[different_frames(capture.samples)]
    if len(frames) > 1:
        noise = frames[1:] - frames[:-1]
        noise_db = 10 * np.log10((np.abs(noise) ** 2).mean() / 2 / (np.abs(frames) ** 2).mean())
        yield f"noise {noise_db:.0f} dB of the samples, by the differences of {len(frames)} frames"
    else:
        yield "noise unknown: it needs two frames"


def methods_of_tones(capture: RadarCapture, settings: dict[str, MethodSettings]) -> Iterator[str]:
    """Yield a sentence about which methods the tones of a capture allow, and what its description
    needs for others. settings: of each method, by its id."""
    allowed, measured = [], measured_settings(capture.frequencies_hz)
    if "3fsk" in measured:
        measured["narrowband"] = {"tones_hz": measured["3fsk"]["tones_hz"]}
    for id, each in settings.items():
        try:
            needed_tones(capture, each)
            allowed.append(id)
        except HandbenchError:
            if own := measured.get(id):
                yield f"{id} needs, in capture.toml: methods.{id} = {_toml(own)}"
    yield f"methods that its tones allow: {', '.join(allowed) or 'none'}"


def _toml(value: Any) -> str:
    """Write a value as TOML does in one line."""
    if isinstance(value, dict):
        return f"{{ {', '.join(f'{key} = {_toml(each)}' for key, each in value.items())} }}"
    return json.dumps(value)

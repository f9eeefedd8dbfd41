"""Ablation of effects: what leaving each of them out of a coarse simulation changes."""

from dataclasses import replace

import numpy as np

from handbench.radar.data.capture import RadarCapture
from handbench.radar.data.grid import Axis
from handbench.radar.methods.fsk import Fsk, fsk
from handbench.radar.simulation.scene import Choice, EchoScene
from handbench.radar.simulation.simulate import SimulatedCapture, simulate_scene

TOLERANCE = 1e-3  # of samples and images, well below the error of the coarse surfaces
COARSER = 2.0  # edges of facets and mirrors relative to a full simulation
TONES = np.array([79.5, 81.8, 82.0]) / 82.0  # of 3-FSK, relative to the highest
PIXELS = 8000  # of a map, about
STEP_M = 1e-3, 2e-3  # least and largest side of a pixel
MARGIN_M = 6e-3  # of the map around the target


def explain(scene: EchoScene, choices: tuple[Choice, ...]) -> tuple[Choice, ...]:
    """Return the rows of the effects with the time that each takes in a coarse simulation at the
    tones of 3-FSK, and with what leaving it out changes."""
    tones_hz = TONES * scene.frequencies_hz.max()
    measured = np.abs(scene.frequencies_hz - tones_hz[:, None]).argmin(axis=1)
    coarse = replace(scene, frequencies_hz=tones_hz, time_s=scene.time_s[measured], coarser=COARSER)

    def simulated(without: str = "") -> SimulatedCapture:
        rows = (row.model_copy(update={"on": row.on and row.effect != without}) for row in choices)
        return simulate_scene(coarse, tuple(rows), tolerance=TOLERANCE)

    x, y, z_m = _box(coarse)
    config = Fsk(x=x, y=y, first_depth_m=z_m, tones_hz=tuple(tones_hz[::-1]))
    whole = simulated()
    changes = {
        row.effect: _changes(whole.capture, simulated(row.effect).capture, config)
        for row in choices
        if row.on
    }
    return tuple(row.model_copy(update=changes.get(row.effect, {})) for row in whole.rows[1:])


def _changes(whole: RadarCapture, without: RadarCapture, config: Fsk) -> dict[str, float | None]:
    """Return the difference of two captures as fields of `Choice`. level_db: power of the
    difference over that of `whole`; depth_mm: mean |Δz| of 3-FSK over the pixels of both maps.
    None: there is no difference, or no such pixel."""
    change = np.linalg.norm(without.samples - whole.samples) / np.linalg.norm(whole.samples)
    maps_m = [fsk(capture, config)[0].z_m for capture in (whole, without)]
    moved_m = np.abs(maps_m[1] - maps_m[0])
    moved_m = moved_m[np.isfinite(moved_m)]
    return {
        "level_db": 20 * float(np.log10(change)) if change else None,
        "depth_mm": 1e3 * float(moved_m.mean()) if len(moved_m) else None,
    }


def _box(scene: EchoScene) -> tuple[Axis, Axis, float]:
    """Return the axes x and y of a map around the target's facets and balls, and their mean z."""
    points_m = scene.points_m
    low_m = points_m.min(axis=0) - MARGIN_M
    size_m = points_m.max(axis=0) + MARGIN_M - low_m
    step_m = float(np.clip(np.sqrt(size_m[0] * size_m[1] / PIXELS), *STEP_M))
    high_m = low_m + step_m * np.ceil(size_m / step_m)
    x, y = (Axis(start_m=low_m[i], stop_m=high_m[i], step_m=step_m) for i in (0, 1))
    return x, y, float(points_m[:, 2].mean())

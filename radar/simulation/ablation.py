"""Ablation of effects: what leaving each of them out of a coarse simulation changes."""

from dataclasses import replace

import numpy as np

from handbench.radar.data.capture import RadarCapture
from handbench.radar.methods.fsk import Fsk, fsk
from handbench.radar.simulation.scene import Choice, EchoScene
from handbench.radar.simulation.simulate import SimulatedCapture, simulate_scene
from handbench.support.progress import track

TOLERANCE = 1e-3  # of samples and images, well below the error of the coarse surfaces
COARSER = 2.0  # edges of facets and mirrors relative to a full simulation
TONES = np.array([79.5, 81.8, 82.0]) / 82.0  # of 3-FSK, relative to the highest


def explain(scene: EchoScene, choices: tuple[Choice, ...]) -> tuple[Choice, ...]:
    """Return the rows of the effects with the time that each takes in a coarse simulation at the
    tones of 3-FSK, and with what leaving it out changes."""
    tones_hz = TONES * scene.frequencies_hz.max()
    measured = np.abs(scene.frequencies_hz - tones_hz[:, None]).argmin(axis=1)
    coarse = replace(scene, frequencies_hz=tones_hz, time_s=scene.time_s[measured], coarser=COARSER)

    def simulated(without: str = "") -> SimulatedCapture:
        rows = (row.model_copy(update={"on": row.on and row.effect != without}) for row in choices)
        return simulate_scene(coarse, tuple(rows), tolerance=TOLERANCE)

    middle_m = float(scene.points_m[:, 2].mean())
    config = Fsk(first_depth_m=middle_m, tones_hz=tuple(tones_hz[::-1]))
    whole = simulated()
    changes = {
        row.effect: _changes(whole.capture, simulated(row.effect).capture, config)
        for row in track([row for row in choices if row.on], "leaving out effects")
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

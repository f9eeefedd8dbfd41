"""Rows of a 3-FSK frame and of the simulation of the hand's echoes: exact, and at two tolerances."""

from collections.abc import Callable
from functools import partial

import numpy as np

from bench.studies.columns import Record
from bench.studies.engine.scope import Inputs
from bench.studies.engine.turns import Case, Measured, everything, interleaved, named
from radar.data.depthmap import DepthMap
from radar.imaging.api import image_points
from radar.methods.fsk import three_tone
from radar.simulation.forward import simulate

TOLERANCES = (None, 1e-3, 1e-5)
FRAMES = 10  # timed together: a radar images frame after frame


def frame_rows(inputs: Inputs) -> list[Record]:
    """One 3-FSK frame: both stages at all pixels and all points on target. The error is that of the three tones'
    images at the points on target."""
    capture, config, repeats = inputs.frame, inputs.scope.frame, inputs.scope.repeats
    configs = {tolerance: config.model_copy(update={"tolerance": tolerance}) for tolerance in TOLERANCES}
    cases = [
        Case(named("fast", t), partial(three_tone, capture, configs[t]), everything, repeats=repeats, calls=FRAMES)
        for t in TOLERANCES
    ]
    measured = interleaved("3-FSK frame", cases)
    depth: DepthMap = measured[named("fast", None)].first.kept
    on_target = np.isfinite(depth.z_m)
    points_m = config.grid().points_m(depth.z_m)[on_target]
    tones = capture.tones(config.ladder_hz)
    images = {t: image_points(*tones, capture.aperture, points_m, t, apart=True) for t in TOLERANCES}

    def known(tolerance: float | None, timings: Measured) -> Record:
        z_m = timings.first.kept.z_m
        return {
            "relative_error": relative_error(images[tolerance], images[None]),
            "depth_deviation_mm": 1e3 * float(np.nanmean(np.abs(z_m - depth.z_m))),
            "mask_difference_px": int(np.count_nonzero(np.isfinite(z_m) != on_target)),
            "frames_per_second": 1 / timings.seconds,
            "points": len(points_m),
        }

    return _rows("3-FSK frame", measured, known)


def simulation_rows(inputs: Inputs) -> list[Record]:
    """All tones' echoes of the hand's scatterers."""
    scatterers, repeats = inputs.scatterers, inputs.scope.repeats
    work = partial(simulate, scatterers, inputs.tones_hz, inputs.array)
    cases = [
        Case(named("fast", t), partial(work, tolerance=t), everything, repeats=repeats if t else 0) for t in TOLERANCES
    ]
    measured = interleaved("simulation", cases)
    exact = measured[named("fast", None)].first.kept

    def known(tolerance: float | None, timings: Measured) -> Record:
        gflops = 8e-9 * len(scatterers.position_m) * exact.size / timings.seconds
        return {
            "relative_error": relative_error(timings.first.kept, exact),
            "gflops": None if tolerance else gflops,
            "points": len(scatterers.position_m),
        }

    return _rows("simulation", measured, known)


def _rows(
    section: str, measured: dict[str, Measured], known: Callable[[float | None, Measured], Record]
) -> list[Record]:
    """A record for each tolerance; the exact path has no error, tolerance or plan of its own."""
    rows = []
    for tolerance in TOLERANCES:
        timings = measured[named("fast", tolerance)]
        about = known(tolerance, timings)
        met = about["relative_error"] <= tolerance if tolerance else None
        fast = {"tolerance": tolerance, "met": met, "plan_seconds": timings.plan_s} if tolerance else {}
        about["relative_error"] = about["relative_error"] if tolerance else None
        rows.append(timings.record(section, measured[named("fast", None)], **about, **fast))
    return rows


def relative_error(found: np.ndarray, exact: np.ndarray) -> float:
    """L2 of the difference over that of the exact values."""
    return float(np.linalg.norm(found.astype(np.complex128) - exact) / np.linalg.norm(exact))

"""Rows of a 3-FSK frame and of the simulation of the hand's echoes."""

from __future__ import annotations

from functools import partial

import numpy as np

from bench.studies.engine.rooms import Case, everything, interleaved
from bench.studies.engine.rows import Row, row
from bench.studies.engine.scope import Inputs
from radar.data.depthmap import DepthMap
from radar.imaging.api import image_points
from radar.methods.fsk import three_tone
from radar.simulation.forward import simulate

TOLERANCES = (None, 1e-3, 1e-5)
FRAMES = 10  # timed together: a radar images frame after frame


def frame_rows(inputs: Inputs) -> list[Row]:
    """One 3-FSK frame: both stages at all pixels and all points on target. The error is that of the three tones'
    images at the points on target."""
    capture, config = inputs.frame, inputs.scope.frame
    configs = {tolerance: config.model_copy(update={"tolerance": tolerance}) for tolerance in TOLERANCES}
    cases = {
        tolerance: Case(
            _name(tolerance), partial(three_tone, capture, each), everything,
            repeats=inputs.scope.repeats, calls=FRAMES,
        )
        for tolerance, each in configs.items()
    }  # fmt: skip
    measured = interleaved("3-FSK frame", list(cases.values()))
    exact = measured[_name(None)]
    depth: DepthMap = exact.first.kept
    on_target = np.isfinite(depth.z_m)
    points_m = config.grid().points_m(depth.z_m)[on_target]
    tones = capture.tones(config.ladder_hz)

    def images(tolerance: float | None) -> np.ndarray:
        return image_points(*tones, capture.aperture, points_m, tolerance, apart=True)

    rows, reference = [], images(None)
    for tolerance, case in cases.items():
        timings = measured[case.method]
        error = relative_error(images(tolerance), reference)
        rows.append(
            row(
                "3-FSK frame", timings, exact,
                relative_error=error if tolerance else None,
                depth_deviation_mm=1e3 * float(np.nanmean(np.abs(timings.first.kept.z_m - depth.z_m))),
                mask_difference_px=int(np.count_nonzero(np.isfinite(timings.first.kept.z_m) != on_target)),
                tolerance=tolerance,
                met=error <= tolerance if tolerance else None,
                plan_seconds=timings.plan_s if tolerance else None,
                frames_per_second=1 / timings.seconds,
                points=len(points_m),
            )
        )  # fmt: skip
    return rows


def simulation_rows(inputs: Inputs) -> list[Row]:
    """All tones' echoes of the hand's scatterers."""
    scatterers, known = inputs.scatterers, (inputs.tones_hz, inputs.array)
    cases = {
        tolerance: Case(
            _name(tolerance), partial(simulate, scatterers, *known, tolerance=tolerance), everything,
            repeats=inputs.scope.repeats if tolerance else 0,
        )
        for tolerance in TOLERANCES
    }  # fmt: skip
    measured = interleaved("simulation", list(cases.values()))
    exact = measured[_name(None)]
    operations = 8.0 * len(scatterers.position_m) * exact.first.kept.size
    rows = []
    for tolerance, case in cases.items():
        timings = measured[case.method]
        error = relative_error(timings.first.kept, exact.first.kept)
        rows.append(
            row(
                "simulation", timings, exact,
                relative_error=error if tolerance else None,
                gflops=None if tolerance else 1e-9 * operations / timings.seconds,
                tolerance=tolerance,
                met=error <= tolerance if tolerance else None,
                plan_seconds=timings.plan_s if tolerance else None,
                points=len(scatterers.position_m),
            )
        )  # fmt: skip
    return rows


def relative_error(found: np.ndarray, exact: np.ndarray) -> float:
    """L2 of the difference over that of the exact values."""
    return float(np.linalg.norm(found.astype(np.complex128) - exact) / np.linalg.norm(exact))


def _name(tolerance: float | None) -> str:
    return "exact" if tolerance is None else f"fast, {tolerance:.0e}".replace("e-0", "e-")

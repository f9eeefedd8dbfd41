"""Rows of the engine's benchmark: imaging of a volume (in comparison with the machine's limit,
textbook sums and exact sums), imaging of 3-FSK frames, and simulation of a hand's echoes."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np

from handbench.bench.studies.engine import textbook
from handbench.bench.studies.engine.reference import (
    EngineReference,
    column_peaks,
    column_points_m,
    reference,
)
from handbench.bench.studies.engine.scope import Inputs
from handbench.bench.studies.engine.turns import (
    EngineCase,
    Measured,
    everything,
    interleaved,
    named,
)
from handbench.bench.studies.study import Record, relative_error
from handbench.radar.data.arrays import AntennaArray
from handbench.radar.data.depthmap import DepthMap
from handbench.radar.data.grid import VoxelGrid
from handbench.radar.imaging.api import image_volume, project_volume
from handbench.radar.imaging.peaks import Peaks, strongest_voxels
from handbench.radar.methods.depth_uncertainty import fsk_with_uncertainty
from handbench.radar.simulation.forward import simulate
from handbench.support.cost import gemm

TOLERANCES = (None, 1e-3, 1e-5)
FRAMES = 10  # timed together: a radar images frame after frame


def frame_rows(inputs: Inputs) -> list[Record]:
    """Time 3-FSK frames, from echoes to depth map with uncertainty, by exact sums and by the fast
    imaging at each tolerance. Returns a record for each.

    The error is that of the images of the first two tones in one plane. Few points are on the
    target, so that exact sums cost less than preparing the fast imaging.
    """
    capture, config, repeats = inputs.frame, inputs.scope.frame, inputs.scope.repeats

    def case(tolerance: float | None) -> EngineCase:
        chosen = config.model_copy(update={"tolerance": tolerance})
        work = partial(fsk_with_uncertainty, capture, chosen)
        return EngineCase(named("fast", tolerance), work, everything, repeats=repeats, calls=FRAMES)

    measured = interleaved("3-FSK frame", [case(t) for t in TOLERANCES])
    depth: DepthMap = measured[named("fast", None)].first.kept
    on_target = np.isfinite(depth.z_m)
    plane = VoxelGrid(depth.x_m, depth.y_m, np.array([config.first_depth_m]))
    tones = capture.tones(config.ladder_hz[:2])
    images = {t: image_volume(*tones, capture.aperture, plane, t, apart=True) for t in TOLERANCES}

    def known(tolerance: float | None, timings: Measured) -> Record:
        z_m = timings.first.kept.z_m
        return {
            "relative_error": relative_error(images[tolerance], images[None]),
            "depth_deviation_mm": 1e3 * float(np.nanmean(np.abs(z_m - depth.z_m))),
            "mask_difference_px": int(np.count_nonzero(np.isfinite(z_m) != on_target)),
            "frames_per_second": 1 / timings.seconds,
            "points": int(np.count_nonzero(on_target)),
        }

    return _rows("3-FSK frame", measured, known)


def simulation_rows(inputs: Inputs) -> list[Record]:
    """Time the simulation of a hand's echoes, by exact sums and by the fast simulation at each
    tolerance. Returns a record for each."""
    scatterers, repeats = inputs.scatterers, inputs.scope.repeats
    work = partial(simulate, scatterers, inputs.tones_hz, inputs.array)
    cases = [
        EngineCase(
            named("fast", t), partial(work, tolerance=t), everything, repeats=repeats if t else 0
        )
        for t in TOLERANCES
    ]
    measured = interleaved("simulation", cases)
    exact, points = measured[named("fast", None)].first.kept, len(scatterers.position_m)

    def known(tolerance: float | None, timings: Measured) -> Record:
        gflops = None if tolerance else 8e-9 * points * exact.size / timings.seconds
        error = relative_error(timings.first.kept, exact)
        return {"relative_error": error, "gflops": gflops, "points": points}

    return _rows("simulation", measured, known)


def _rows(
    section: str, measured: dict[str, Measured], known: Callable[[float | None, Measured], Record]
) -> list[Record]:
    """Make a record for each tolerance; the tolerance None means exact sums, which have no error
    and no time of preparation.

    section: of the table. measured: timings by the computation's name. known: function of tolerance
    and timings that returns further columns.
    """
    rows = []
    for tolerance in TOLERANCES:
        timings = measured[named("fast", tolerance)]
        about = known(tolerance, timings)
        if tolerance is None:
            about["relative_error"] = None
        else:
            about |= {"tolerance": tolerance, "met": about["relative_error"] <= tolerance}
            about["plan_seconds"] = timings.plan_s
        rows.append(timings.record(section, measured[named("fast", None)], **about))
    return rows


SECTION = "volume"
GEMM, EXACT, NUMPY, NUMBA = (
    "float32 matrix product",
    "exact",
    "numpy, direct sum",
    "numba, direct sum",
)
COMPRESSED = "range-compressed, linear interpolation"


def volume_rows(inputs: Inputs) -> list[Record]:
    """Time several ways of imaging a volume, in turns. Returns a record for each.

    The ways are textbook sums, exact sums, and the fast imaging (complex volume, and projection to
    its strongest voxels along z) at each tolerance. A matrix product of the machine shows the limit
    of its speed.
    """
    scope, checked = inputs.scope, reference(inputs)
    ceiling = EngineCase(GEMM, partial(gemm, scope.gemm_size), repeats=scope.repeats)
    cases = [ceiling, *_slow_cases(inputs, checked), *_fast_cases(inputs, checked)]
    measured = interleaved(SECTION, cases)
    gflops = 2e-9 * scope.gemm_size**3 / measured[GEMM].seconds
    return [
        measured[GEMM].record(SECTION, gflops=gflops),
        *_slow_rows(inputs, checked, measured, gflops),
        *(row for t in scope.tolerances for row in _fast_rows(inputs, checked, measured, t)),
    ]


def _slow_cases(inputs: Inputs, checked: EngineReference) -> list[EngineCase]:
    """List the slow ways of imaging the volume, each timed on a part of it and extrapolated to the
    whole.

    Textbook sums are timed on some random voxels, exact sums on one plane. Interpolation of range
    profiles is faster for neighbouring voxels, so it is timed on one plane; the time for a single
    point, mostly that of the FFTs, is needed once and is not extrapolated.
    """
    grid, scope = inputs.grid, inputs.scope
    points_m = grid.points_at_m(checked.voxels)

    def case(
        method: str, image: Callable[..., Any], points_m: np.ndarray, fixed: int = 0
    ) -> EngineCase:
        first = partial(image, *_echoes(inputs), points_m[:fixed]) if fixed else None
        fraction = float(len(points_m) / np.prod(grid.shape))
        work = partial(image, *_echoes(inputs), points_m)
        return EngineCase(method, work, everything, fraction, first, scope.repeats)

    plane = VoxelGrid(grid.x_m, grid.y_m, grid.z_m[len(grid.z_m) // 2, None])
    exact = partial(image_volume, *_echoes(inputs), plane, None)
    return [
        case(NUMPY, textbook.numpy_sum, points_m[: scope.numpy_voxels]),
        case(NUMBA, textbook.numba_sum, points_m[: scope.numba_voxels]),
        case(COMPRESSED, textbook.range_compressed, plane.points_m().reshape(-1, 3), 1),
        EngineCase(EXACT, exact, fraction=1 / len(grid.z_m), repeats=scope.repeats),
    ]


def _fast_cases(inputs: Inputs, checked: EngineReference) -> list[EngineCase]:
    ways: tuple[tuple[str, Callable[..., Any], Callable[[Any], Any]], ...] = (
        ("fast volume", image_volume, partial(_checked, checked.voxels)),
        ("fast projection", project_volume, everything),
    )
    return [
        EngineCase(
            named(way, t),
            partial(image, *_echoes(inputs), inputs.grid, t),
            keep,
            repeats=inputs.scope.repeats,
        )
        for t in inputs.scope.tolerances
        for way, image, keep in ways
    ]


def _slow_rows(
    inputs: Inputs, checked: EngineReference, measured: dict[str, Measured], ceiling_gflops: float
) -> list[Record]:
    operations = 8e-9 * float(np.prod(inputs.grid.shape)) * inputs.samples["hand"].size
    known: dict[str, Record] = {
        name: {"gflops": operations / measured[name].seconds} for name in (NUMPY, NUMBA, EXACT)
    }
    known[NUMBA]["relative_error"] = checked.error(measured[NUMBA].first.kept, exact=checked.direct)
    known[EXACT] |= {
        "relative_error": checked.error(checked.exact["hand"], exact=checked.direct),
        "share_of_gemm": known[EXACT]["gflops"] / ceiling_gflops,
        "depth_deviation_mm": 0.0,
    }
    known[COMPRESSED] = _compressed_accuracy(inputs, checked)
    order = (NUMPY, NUMBA, COMPRESSED, EXACT)
    return [measured[name].record(SECTION, measured[EXACT], **known[name]) for name in order]


def _compressed_accuracy(inputs: Inputs, checked: EngineReference) -> Record:
    def image(source: str, points_m: np.ndarray) -> np.ndarray:
        return textbook.range_compressed(*_echoes(inputs, source), points_m)

    points_m = inputs.grid.points_at_m(checked.voxels)
    columns = image("hand", column_points_m(inputs.grid, checked.pixels))
    return {
        "relative_error": checked.error(image("hand", points_m)),
        "noise_error": checked.error(image("noise", points_m), "noise"),
        "depth_deviation_mm": checked.deviation_mm(column_peaks(columns, inputs.grid)),
    }


def _fast_rows(
    inputs: Inputs, checked: EngineReference, measured: dict[str, Measured], tolerance: float
) -> list[Record]:
    """Make the records of the fast volume and the fast projection at one tolerance. The projection
    uses the volume's preparation, and its error is taken to be the volume's."""
    ways = ("fast volume", "fast projection")
    volume, projection = (measured[named(way, tolerance)] for way in ways)
    values, peaks = volume.first.kept
    noisy = image_volume(*_echoes(inputs, "noise"), inputs.grid, tolerance)
    noise = noisy.ravel()[checked.voxels]
    errors = {"relative_error": checked.error(values), "noise_error": checked.error(noise, "noise")}
    known = {**errors, "tolerance": tolerance, "met": max(errors.values()) <= tolerance}
    return [
        one.record(
            SECTION, measured[EXACT], **known, plan_seconds=one.plan_s, **checked.deviation(found)
        )
        for one, found in ((volume, peaks), (projection, projection.first.kept))
    ]


def _echoes(inputs: Inputs, source: str = "hand") -> tuple[np.ndarray, np.ndarray, AntennaArray]:
    return inputs.samples[source], inputs.tones_hz, inputs.array


def _checked(voxels: np.ndarray, volume: np.ndarray) -> tuple[np.ndarray, Peaks]:
    return volume.ravel()[voxels], strongest_voxels(volume)

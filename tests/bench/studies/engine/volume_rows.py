"""Rows of the volume (the machine's ceiling, the textbook's ways, the exact path, the fast engine),
of a 3-FSK frame and of the simulation of the hand's echoes.
"""

from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np

from handbench.radar.data.depthmap import DepthMap
from handbench.radar.data.grid import VoxelGrid
from handbench.radar.imaging.api import image_volume, project_volume
from handbench.radar.imaging.peaks import Peaks, strongest_voxels
from handbench.radar.methods.depth_uncertainty import fsk_with_uncertainty
from handbench.radar.simulation.forward import simulate
from handbench.support.cost import gemm
from tests.bench.studies.columns import Record
from tests.bench.studies.engine import textbook
from tests.bench.studies.engine.reference import Reference, column_peaks, column_points_m, reference
from tests.bench.studies.engine.scope import Inputs
from tests.bench.studies.engine.turns import Case, Measured, Work, everything, interleaved, named
from tests.bench.studies.study import relative_error

TOLERANCES = (None, 1e-3, 1e-5)
FRAMES = 10  # timed together: a radar images frame after frame


def frame_rows(inputs: Inputs) -> list[Record]:
    """One 3-FSK frame: both stages at all pixels and all points on target. The error is that of the
    plane's images of the first two tones; the points on target are so few that their exact sums
    cost less than a plan."""
    capture, config, repeats = inputs.frame, inputs.scope.frame, inputs.scope.repeats
    configs = {
        tolerance: config.model_copy(update={"tolerance": tolerance}) for tolerance in TOLERANCES
    }
    cases = [
        Case(
            named("fast", t),
            partial(fsk_with_uncertainty, capture, configs[t]),
            everything,
            repeats=repeats,
            calls=FRAMES,
        )
        for t in TOLERANCES
    ]
    measured = interleaved("3-FSK frame", cases)
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
    """All tones' echoes of the hand's scatterers."""
    scatterers, repeats = inputs.scatterers, inputs.scope.repeats
    work = partial(simulate, scatterers, inputs.tones_hz, inputs.array)
    cases = [
        Case(named("fast", t), partial(work, tolerance=t), everything, repeats=repeats if t else 0)
        for t in TOLERANCES
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
        fast = (
            {"tolerance": tolerance, "met": met, "plan_seconds": timings.plan_s}
            if tolerance
            else {}
        )
        about["relative_error"] = about["relative_error"] if tolerance else None
        rows.append(timings.record(section, measured[named("fast", None)], **about, **fast))
    return rows


SECTION = "volume"
GEMM, EXACT, COMPRESSED = (
    "float32 matrix product",
    "exact",
    "range-compressed, linear interpolation",
)
NUMPY, NUMBA = "numpy, direct sum", "numba, direct sum"


def volume_rows(inputs: Inputs) -> list[Record]:
    """All rows of the volume, timed in turns."""
    scope, checked = inputs.scope, reference(inputs)
    ceiling = Case(GEMM, partial(gemm, scope.gemm_size), repeats=scope.repeats)
    measured = interleaved(
        SECTION, [ceiling, *_textbook(inputs, checked), _exact(inputs), *_fast(inputs, checked)]
    )
    gflops = 2e-9 * scope.gemm_size**3 / measured[GEMM].seconds
    slow = [
        _slow_row(inputs, checked, measured, name, gflops)
        for name in (NUMPY, NUMBA, COMPRESSED, EXACT)
    ]
    fast = [
        row
        for tolerance in scope.tolerances
        for row in _fast_rows(inputs, checked, measured, tolerance)
    ]
    return [measured[GEMM].record(SECTION, gflops=gflops), *slow, *fast]


def _textbook(inputs: Inputs, checked: Reference) -> list[Case]:
    """On the first of the checked voxels; interpolation on one plane, since it lives on
    neighbouring voxels."""
    grid, scope = inputs.grid, inputs.scope
    plane = _planes(grid, 1).points_m().reshape(-1, 3)
    points_m = grid.points_at_m(checked.voxels)

    def case(method: str, image: Callable[..., Any], points_m: np.ndarray, fixed: int = 0) -> Case:
        """fixed: points that tell what is done for none."""
        work = partial(
            image,
            samples=inputs.samples["hand"],
            frequencies_hz=inputs.tones_hz,
            array=inputs.array,
        )
        fraction, part = (
            len(points_m) / np.prod(grid.shape),
            partial(work, points_m=points_m[:fixed]),
        )
        whole = partial(work, points_m=points_m)
        return Case(
            method, whole, everything, float(fraction), part if fixed else None, scope.repeats
        )

    return [
        case(NUMPY, textbook.numpy_sum, points_m[: scope.numpy_voxels]),
        case(NUMBA, textbook.numba_sum, points_m[: scope.numba_voxels]),
        case(COMPRESSED, textbook.range_compressed, plane, fixed=1),
    ]


def _exact(inputs: Inputs) -> Case:
    """The exact path on whole planes, or on the whole volume, once."""
    planes = inputs.scope.exact_planes
    grid = inputs.grid if planes is None else _planes(inputs.grid, planes)
    fraction, repeats = (
        len(grid.z_m) / len(inputs.grid.z_m),
        0 if planes is None else inputs.scope.repeats,
    )
    return Case(
        EXACT,
        _imaging(image_volume, inputs, "hand", None, grid),
        fraction=fraction,
        repeats=repeats,
    )


def _fast(inputs: Inputs, checked: Reference) -> list[Case]:
    keep_checked = partial(_checked, checked.voxels)
    ways: tuple[tuple[str, Callable[..., Any], Callable[[Any], Any]], ...]
    ways = ("volume", image_volume, keep_checked), ("projection", project_volume, everything)
    return [
        Case(
            named(f"fast {what}", t),
            _imaging(image, inputs, "hand", t),
            keep,
            repeats=inputs.scope.repeats,
        )
        for t in inputs.scope.tolerances
        for what, image, keep in ways
    ]


def _slow_row(
    inputs: Inputs,
    checked: Reference,
    measured: dict[str, Measured],
    method: str,
    ceiling_gflops: float,
) -> Record:
    timings = measured[method]
    gflops = float(
        8e-9 * np.prod(inputs.grid.shape) * inputs.samples["hand"].size / timings.seconds
    )
    known = {"gflops": gflops} if method != COMPRESSED else _compressed_accuracy(inputs, checked)
    if method == NUMBA:
        known["relative_error"] = checked.error(timings.first.kept, exact=checked.direct)
    if method == EXACT:
        known |= {
            "relative_error": checked.error(checked.exact["hand"], exact=checked.direct),
            "depth_deviation_mm": 0.0,
        }
        known |= {"depth_deviation_voxel_mm": 0.0, "share_of_gemm": gflops / ceiling_gflops}
    return timings.record(SECTION, measured[EXACT], **known)


def _compressed_accuracy(inputs: Inputs, checked: Reference) -> Record:
    def image(source: str, points_m: np.ndarray) -> np.ndarray:
        return textbook.range_compressed(
            inputs.samples[source], inputs.tones_hz, inputs.array, points_m
        )

    points_m = inputs.grid.points_at_m(checked.voxels)
    columns = image("hand", column_points_m(inputs.grid, checked.pixels))
    return {
        "relative_error": checked.error(image("hand", points_m)),
        "noise_error": checked.error(image("noise", points_m), "noise"),
        **checked.column_deviation(column_peaks(columns, inputs.grid)),
    }


def _fast_rows(
    inputs: Inputs, checked: Reference, measured: dict[str, Measured], tolerance: float
) -> list[Record]:
    """Volume and projection; the projection's error is the volume's, whose plan it shares."""
    volume, projection = (
        measured[named(f"fast {what}", tolerance)] for what in ("volume", "projection")
    )
    values, peaks = volume.first.kept
    noise = _imaging(image_volume, inputs, "noise", tolerance)().ravel()[checked.voxels]
    errors = {"relative_error": checked.error(values), "noise_error": checked.error(noise, "noise")}
    known = {**errors, "tolerance": tolerance, "met": max(errors.values()) <= tolerance}
    return [
        timings.record(
            SECTION,
            measured[EXACT],
            **known,
            plan_seconds=timings.plan_s,
            **checked.deviation(found),
        )
        for timings, found in ((volume, peaks), (projection, projection.first.kept))
    ]


def _imaging(
    image: Callable[..., Any],
    inputs: Inputs,
    source: str,
    tolerance: float | None,
    grid: VoxelGrid | None = None,
) -> Work:
    return partial(
        image, inputs.samples[source], inputs.tones_hz, inputs.array, grid or inputs.grid, tolerance
    )


def _planes(grid: VoxelGrid, count: int) -> VoxelGrid:
    """The middle planes of a grid."""
    start = (len(grid.z_m) - count) // 2
    return VoxelGrid(grid.x_m, grid.y_m, grid.z_m[start : start + count])


def _checked(voxels: np.ndarray, volume: np.ndarray) -> tuple[np.ndarray, Peaks]:
    return volume.ravel()[voxels], strongest_voxels(volume)

"""Rows of the volume: the machine's ceiling, the textbook's ways, the exact path, and the fast engine."""

from __future__ import annotations

from functools import partial

import numpy as np

from bench.studies.engine import textbook
from bench.studies.engine.reference import Reference, column_peaks, column_points_m, reference, voxel_points_m
from bench.studies.engine.rooms import Case, Measured, everything, interleaved
from bench.studies.engine.rows import Row, row
from bench.studies.engine.scope import Inputs
from radar.data.grid import VoxelGrid
from radar.imaging.api import image_volume, project_volume
from radar.methods.projection import Peaks, peaks_of

SECTION = "volume"
GEMM, EXACT, COMPRESSED = "float32 matrix product", "exact", "range-compressed, linear interpolation"
NUMPY, NUMBA = "numpy, direct sum", "numba, direct sum"


def volume_rows(inputs: Inputs) -> list[Row]:
    """All rows of the volume, timed in turns."""
    checked = reference(inputs)
    cases = [_ceiling(inputs), *_textbook(inputs, checked), _exact(inputs), *_fast(inputs, checked)]
    measured = interleaved(SECTION, cases)
    gflops = 2e-9 * inputs.scope.gemm_size**3 / measured[GEMM].seconds
    ceiling = row(SECTION, measured[GEMM], gflops=gflops)
    slow = [_slow_row(inputs, checked, measured, name, gflops) for name in (NUMPY, NUMBA, COMPRESSED, EXACT)]
    fast = [r for tolerance in inputs.scope.tolerances for r in _fast_rows(inputs, checked, measured, tolerance)]
    return [ceiling, *slow, *fast]


def _ceiling(inputs: Inputs) -> Case:
    return Case(GEMM, partial(textbook.gemm, inputs.scope.gemm_size), repeats=inputs.scope.repeats)


def _textbook(inputs: Inputs, checked: Reference) -> list[Case]:
    """On the first of the checked voxels; interpolation on one plane, since it lives on neighbouring voxels."""
    grid, scope, voxels = inputs.grid, inputs.scope, int(np.prod(inputs.grid.shape))
    plane = _planes(grid, 1).points_m().reshape(-1, 3)

    def case(method: str, image: partial, points_m: np.ndarray, fixed: partial | None = None) -> Case:
        work, fraction = partial(image, points_m=points_m), len(points_m) / voxels
        return Case(method, work, everything, fraction, fixed, scope.repeats)

    known = {"samples": inputs.samples["hand"], "frequencies_hz": inputs.tones_hz, "array": inputs.array}
    points_m = voxel_points_m(grid, checked.voxels)
    compressed = partial(textbook.range_compressed, **known)
    return [
        case(NUMPY, partial(textbook.numpy_sum, **known), points_m[: scope.numpy_voxels]),
        case(NUMBA, partial(textbook.numba_sum, **known), points_m[: scope.numba_voxels]),
        case(COMPRESSED, compressed, plane, fixed=partial(compressed, points_m=plane[:1])),
    ]


def _exact(inputs: Inputs) -> Case:
    """The exact path on whole planes, or on the whole volume, once."""
    planes = inputs.scope.exact_planes
    whole = planes is None
    grid = inputs.grid if whole else _planes(inputs.grid, planes)
    return Case(
        EXACT, _imaging(image_volume, inputs, "hand", None, grid),
        fraction=len(grid.z_m) / len(inputs.grid.z_m), repeats=0 if whole else inputs.scope.repeats,
    )  # fmt: skip


def _fast(inputs: Inputs, checked: Reference) -> list[Case]:
    cases = []
    for tolerance in inputs.scope.tolerances:
        volume = _imaging(image_volume, inputs, "hand", tolerance)
        projection = _imaging(project_volume, inputs, "hand", tolerance)
        cases += [
            Case(_name("volume", tolerance), volume, partial(_checked, checked.voxels), repeats=inputs.scope.repeats),
            Case(_name("projection", tolerance), projection, everything, repeats=inputs.scope.repeats),
        ]
    return cases


def _slow_row(
    inputs: Inputs, checked: Reference, measured: dict[str, Measured], method: str, ceiling_gflops: float
) -> Row:
    timings = measured[method]
    gflops = 8e-9 * np.prod(inputs.grid.shape) * inputs.samples["hand"].size / timings.seconds
    known = {"gflops": gflops} if method != COMPRESSED else _compressed_accuracy(inputs, checked)
    if method == NUMBA:
        known["relative_error"] = checked.direct_error(timings.first.kept)
    if method == EXACT:
        known |= {"relative_error": checked.direct_error(checked.exact["hand"]), "depth_deviation_mm": 0.0}
        known |= {"depth_deviation_voxel_mm": 0.0, "share_of_gemm": gflops / ceiling_gflops}
    return row(SECTION, timings, measured[EXACT], **known)


def _compressed_accuracy(inputs: Inputs, checked: Reference) -> dict[str, float]:
    def image(source: str, points_m: np.ndarray) -> np.ndarray:
        return textbook.range_compressed(inputs.samples[source], inputs.tones_hz, inputs.array, points_m)

    points_m = voxel_points_m(inputs.grid, checked.voxels)
    columns = image("hand", column_points_m(inputs.grid, checked.pixels))
    subvoxel_mm, voxel_mm = checked.column_deviation(column_peaks(columns, inputs.grid))
    return {
        "relative_error": checked.error(image("hand", points_m)),
        "noise_error": checked.error(image("noise", points_m), "noise"),
        "depth_deviation_mm": subvoxel_mm,
        "depth_deviation_voxel_mm": voxel_mm,
    }


def _fast_rows(inputs: Inputs, checked: Reference, measured: dict[str, Measured], tolerance: float) -> list[Row]:
    """Volume and projection; the projection's error is the volume's, whose plan it shares."""
    volume, projection = (measured[_name(what, tolerance)] for what in ("volume", "projection"))
    values, peaks = volume.first.kept
    noise = _imaging(image_volume, inputs, "noise", tolerance)().ravel()[checked.voxels]
    errors = {"relative_error": checked.error(values), "noise_error": checked.error(noise, "noise")}
    rows = []
    for timings, found in ((volume, peaks), (projection, Peaks(*projection.first.kept))):
        deviation = checked.deviation(found)
        rows.append(
            row(
                SECTION, timings, measured[EXACT], **errors,
                tolerance=tolerance,
                met=max(errors.values()) <= tolerance,
                plan_seconds=timings.plan_s,
                depth_deviation_mm=deviation.subvoxel_mm,
                depth_deviation_voxel_mm=deviation.voxel_mm,
                mask_difference_px=deviation.mask_px,
            )
        )  # fmt: skip
    return rows


def _imaging(
    image: partial, inputs: Inputs, source: str, tolerance: float | None, grid: VoxelGrid | None = None
) -> partial:
    return partial(image, inputs.samples[source], inputs.tones_hz, inputs.array, grid or inputs.grid, tolerance)


def _planes(grid: VoxelGrid, count: int) -> VoxelGrid:
    """The middle planes of a grid."""
    start = (len(grid.z_m) - count) // 2
    return VoxelGrid(grid.x_m, grid.y_m, grid.z_m[start : start + count])


def _checked(voxels: np.ndarray, volume: np.ndarray) -> tuple[np.ndarray, Peaks]:
    return volume.ravel()[voxels], peaks_of(volume)


def _name(what: str, tolerance: float) -> str:
    return f"fast {what}, {tolerance:.0e}".replace("e-0", "e-")

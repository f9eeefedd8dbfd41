"""One row of the result."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any

from bench.studies.engine.rooms import Measured

ALWAYS = (
    "method", "seconds", "ratio_to_exact", "relative_error", "depth_deviation_mm", "gflops", "peak_memory_mb"
)  # fmt: skip


@dataclass(frozen=True)
class Row:
    """What one method costs and how far it is from exact; None where that means nothing.

    section: what the row is about; seconds: median of the repeats for the whole work, without the plan;
    plan_seconds: what the first call took longer; ratio_to_exact: the exact path's seconds over these;
    relative_error: L2, for the hand, noise_error: for white noise; met: whether both are within the tolerance;
    depth_deviation_mm: mean |Δz| of depths between voxels, depth_deviation_voxel_mm: of whole voxels;
    mask_difference_px: pixels that one mask alone holds; gflops: of the sums as they stand, 8 operations per voxel,
    channel and tone; peak_memory_mb: by how much the first call raised the process's resident memory at most.
    """

    section: str
    method: str
    seconds: float
    seconds_range: tuple[float, float]
    extrapolated: bool
    ratio_to_exact: float | None = None
    relative_error: float | None = None
    depth_deviation_mm: float | None = None
    gflops: float | None = None
    peak_memory_mb: float | None = None
    fraction: float | None = None
    plan_seconds: float | None = None
    tolerance: float | None = None
    met: bool | None = None
    noise_error: float | None = None
    depth_deviation_voxel_mm: float | None = None
    mask_difference_px: int | None = None
    share_of_gemm: float | None = None
    frames_per_second: float | None = None
    points: int | None = None

    def as_dict(self) -> dict[str, Any]:
        """For the JSON file: the keys that every row has, and the others where they are known."""
        return {key: value for key, value in asdict(self).items() if key in ALWAYS or value is not None}


def row(section: str, measured: Measured, exact: Measured | None = None, **known: Any) -> Row:
    """A row of a case's timings; `exact`: those of the exact path."""
    fraction = measured.case.fraction
    return Row(
        section=section,
        method=measured.case.method,
        seconds=measured.seconds,
        seconds_range=measured.range_s,
        extrapolated=fraction < 1,
        fraction=fraction if fraction < 1 else None,
        ratio_to_exact=exact.seconds / measured.seconds if exact else None,
        peak_memory_mb=measured.first.peak_mb,
        **known,
    )

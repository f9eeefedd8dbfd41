"""The ground-truth floor: the mean absolute error that a perfect radar would show because the
reference itself has errors.

With an error e ~ N(0, σ²) at every pixel, the expected mean of |e| is √(2/π)·mean σ, whatever the
correlation of the pixels' errors. The scatter about that mean does depend on the correlation: the
registration moves all pixels of all captures that share it by one rigid motion, and the errors of a
mesh are correlated over patches.
"""

from collections.abc import Iterable, Iterator
from typing import Any

import numpy as np

from handbench.bench.evaluation.depth_errors import ErrorMap
from handbench.bench.evaluation.intervals import RESAMPLES, TAILS, Interval
from handbench.groundtruth.mesh.depth import Reference

ABSOLUTE = np.sqrt(2 / np.pi)  # mean of |e| over σ, for a normal e
PARTS = ("mesh", "registration")
BLOCK_M = 0.015  # correlation length of a mesh's errors: three lateral resolutions
SPAN = 1 << 20  # more blocks than a row can have


def floor_mm(maps: Iterable[ErrorMap], references: Iterable[Reference]) -> float | None:
    """Compute the ground-truth floor, mm: the mean absolute error that a perfect radar would show.
    It is √(2/π) times the mean σ of the reference over the observed pixels of a map, averaged over
    the maps that observe any. references: one for each map, in the same order. None if no pixel was
    observed or if σ is unknown."""
    seen = _observed(maps, references)
    floors_m = [
        (r.sigma_m if m.sigma_m is None else m.sigma_m)[observed].mean() for m, r, observed in seen
    ]
    mean_m = float(np.mean(floors_m)) if floors_m else np.nan
    return 1e3 * float(ABSOLUTE) * mean_m if np.isfinite(mean_m) else None


def _observed(
    maps: Iterable[ErrorMap], references: Iterable[Reference]
) -> Iterator[tuple[ErrorMap, Reference, np.ndarray]]:
    """Yield each map with at least one observed pixel, together with its reference and the mask of
    its observed pixels [ny, nx]."""
    for m, r in zip(maps, references, strict=True):
        observed = np.isfinite(m.error_m)
        if observed.any():
            yield m, r, observed


def floor_interval(
    maps: Iterable[ErrorMap],
    references: Iterable[Reference],
    seed: int = 0,
    value: float | None = None,
) -> Interval | None:
    """Compute the 95 % interval, mm, of the mean absolute error that a perfect radar would show.
    The errors of the reference (mesh and registration) are drawn many times. references: one for
    each map, in the same order. value: the floor, if already known; then maps and references are
    read only once. None if the floor is zero or unknown."""
    value = floor_mm(maps, references) if value is None else value
    if not value:
        return None
    rng, again, sum_m, n = (
        np.random.default_rng(seed),
        np.random.default_rng(),
        np.zeros(RESAMPLES),
        0,
    )
    starts: dict[
        bytes, Any
    ] = {}  # captures that share a registration share its error: drawn from the same state
    for m, r, observed in _observed(maps, references):
        # σ is known, so they are too
        assert r.registration is not None and r.registration.covariance is not None
        key, covariance = r.registration.matrix.tobytes(), r.registration.covariance
        drawing = again if key in starts else rng
        again.bit_generator.state = starts.setdefault(key, rng.bit_generator.state)
        motions = drawing.multivariate_normal(
            np.zeros(len(covariance)), covariance, RESAMPLES, check_valid="ignore"
        )
        sum_m += _absolute_sum_m(m, r, motions, rng) / observed.sum()
        n += 1
    low, high = np.quantile(1e3 * (sum_m / n), TAILS)
    return Interval(float(min(low, value)), float(max(high, value)))


def _absolute_sum_m(
    m: ErrorMap, r: Reference, motions: np.ndarray, rng: np.random.Generator
) -> np.ndarray:
    """Draw errors of the reference, and return for each draw the sum of |e| over the observed
    pixels of one capture: [draws], metres.
    m: error map, r: reference of the capture. motions [draws, 6 or 7]: errors of the registration,
    already drawn. The errors of the mesh are drawn here, one for each square of 15 × 15 mm
    (BLOCK_M)."""
    observed = np.isfinite(m.error_m)
    column, row = (np.floor(axis / BLOCK_M + 1e-9).astype(np.int64) for axis in (m.x_m, m.y_m))
    names, block = np.unique((SPAN * row[:, None] + column)[observed], return_inverse=True)
    patches = rng.standard_normal((len(motions), len(names)))
    assert r.leverage is not None  # comes with the registration
    leverage, mesh_sigma_m = r.leverage[observed].T, r.mesh_sigma_m[observed]
    draws = zip(motions, patches, strict=True)
    return np.array(
        [np.abs(motion @ leverage + patch[block] * mesh_sigma_m).sum() for motion, patch in draws]
    )


def budget(reference: Reference) -> dict[str, float | list[str] | None]:
    """Return the uncertainty of a reference by source: mesh_mm, registration_mm and together_mm.
    Each is the root mean square, mm, of σ along z over the pixels of the reference. It is None if
    unknown, and the unknown sources are then listed under "unknown"."""
    surface = np.isfinite(reference.z_m)
    sigmas_m = (reference.mesh_sigma_m, reference.registration_sigma_m, reference.sigma_m)
    named = zip((*PARTS, "together"), sigmas_m, strict=True)
    parts = {f"{name}_mm": _rms_mm(sigma_m[surface]) for name, sigma_m in named}
    unknown = [name for name in PARTS if parts[f"{name}_mm"] is None]
    return {**parts, **({"unknown": unknown} if unknown else {})}


def _rms_mm(sigma_m: np.ndarray) -> float | None:
    if not len(sigma_m) or not np.isfinite(sigma_m).all():
        return None
    return float(1e3 * np.sqrt((sigma_m**2).mean()))

"""The ground-truth floor: the mean absolute error that a perfect radar would show because the
reference itself has errors.

With an error e ~ N(0, σ²) at every pixel, the expected mean of |e| is √(2/π)·mean σ, whatever the
correlation of the pixels' errors.
"""

import numpy as np

from handbench.bench.evaluation.depth_errors import ErrorMap
from handbench.groundtruth.mesh.depth import Reference

ABSOLUTE = np.sqrt(2 / np.pi)  # mean of |e| over σ, for a normal e
PARTS = ("mesh", "registration")


def floor_mm(errors: ErrorMap, reference: Reference) -> float | None:
    """Compute the ground-truth floor of one map, mm: √(2/π) times the mean σ of the reference over
    the observed pixels. None if no pixel was observed or if σ is unknown."""
    observed = np.isfinite(errors.error_m)
    sigma_m = reference.sigma_m if errors.sigma_m is None else errors.sigma_m
    mean_m = float(sigma_m[observed].mean()) if observed.any() else np.nan
    return 1e3 * float(ABSOLUTE) * mean_m if np.isfinite(mean_m) else None


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

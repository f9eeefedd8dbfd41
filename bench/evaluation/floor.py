"""The uncertainty of a reference by its sources."""

import numpy as np

from handbench.groundtruth.mesh.depth import Reference

PARTS = ("mesh", "registration")


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

"""Comparison of a depth map's radial velocities with those of the true surface."""

import numpy as np

from handbench.bench.evaluation.metrics import BAND, VELOCITY, Values
from handbench.groundtruth.mesh.depth import Reference
from handbench.radar.data.depthmap import DepthMap


def velocity_figures(depth: DepthMap, scored: np.ndarray, reference: Reference) -> Values:
    """Compute the metrics of a depth map's radial velocities: metric → value, None if undefined.
    Empty if the map or the reference has no velocities.

    scored [ny, nx]: the pixels with a scored depth; those where map and reference have a velocity
    are compared."""
    if depth.velocity_m_s is None or reference.velocity_m_s is None:
        return {}
    at = scored & np.isfinite(depth.velocity_m_s) & np.isfinite(reference.velocity_m_s)
    if not at.any():
        return dict.fromkeys(VELOCITY)
    true_m_s = reference.velocity_m_s[at]
    error_m_s = depth.velocity_m_s[at].astype(np.float64) - true_m_s
    sigma_m_s, limit_m_s = depth.velocity_sigma_m_s, depth.velocity_limit_m_s
    inside = None if sigma_m_s is None else np.abs(error_m_s) <= BAND * sigma_m_s[at]
    beyond = None if limit_m_s is None else np.abs(true_m_s) > limit_m_s
    shares = (None if of is None else float(100 * of.mean()) for of in (inside, beyond))
    values = (float(1e3 * np.abs(error_m_s).mean()), float(1e3 * error_m_s.mean()), *shares)
    return dict(zip(VELOCITY, values, strict=True))


def mean_speed_m_s(reference: Reference) -> float | None:
    """Return the mean |radial velocity| of a reference's surface, metres per second; None if it is
    unknown."""
    if reference.velocity_m_s is None or not np.isfinite(reference.velocity_m_s).any():
        return None
    return float(np.nanmean(np.abs(reference.velocity_m_s)))

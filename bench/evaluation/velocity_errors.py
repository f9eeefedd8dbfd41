"""Comparison of a depth map's radial velocities with those of the true surface."""

from typing import NamedTuple

import numpy as np

from handbench.groundtruth.mesh.depth import Reference
from handbench.radar.data.depthmap import DepthMap

BAND = 1.96  # standard deviations that contain 95 % of a normal error


class VelocityErrors(NamedTuple):
    """Errors of radial velocities at the n compared pixels, m/s. within [n]: 1 for an error inside
    the map's own 95 % interval, 0 for another; beyond [n]: 1 for a true velocity beyond the map's
    unambiguous one; both NaN if the map does not say."""

    error_m_s: np.ndarray
    within: np.ndarray
    beyond: np.ndarray


def velocity_errors(
    depth: DepthMap, scored: np.ndarray, reference: Reference
) -> VelocityErrors | None:
    """Compare a depth map's radial velocities with those of a surface; None if either has none.
    scored [ny, nx]: the pixels with a scored depth; those where map and reference have a velocity
    are compared."""
    if depth.velocity_m_s is None or reference.velocity_m_s is None:
        return None
    at = scored & np.isfinite(depth.velocity_m_s) & np.isfinite(reference.velocity_m_s)
    true_m_s = reference.velocity_m_s[at]
    error_m_s = depth.velocity_m_s[at].astype(np.float64) - true_m_s
    unknown = np.full(len(error_m_s), np.nan)
    sigma_m_s, limit_m_s = depth.velocity_sigma_m_s, depth.velocity_limit_m_s
    return VelocityErrors(
        error_m_s,
        unknown if sigma_m_s is None else np.abs(error_m_s) <= BAND * sigma_m_s[at],
        unknown if limit_m_s is None else np.abs(true_m_s) > limit_m_s,
    )


def mean_speed_m_s(reference: Reference) -> float | None:
    """Return the mean |radial velocity| of a reference's surface, metres per second; None if it is
    unknown."""
    if reference.velocity_m_s is None or not np.isfinite(reference.velocity_m_s).any():
        return None
    return float(np.nanmean(np.abs(reference.velocity_m_s)))

"""The transform between the photographs' frame and the radar's, from one target that both have seen.

Both sensors' candidates are matched to the target's elements; the elements that both have seen give the transform in
closed form (Umeyama 1991), and weighted Gauss–Newton refines it with every centre's own covariance. The target's
drawing serves only to tell the elements apart: what is registered are the two measurements.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.spatial.transform import Rotation
from scipy.stats import chi2

from calibration.echoes import EchoSearch, common_covariance, find_balls
from calibration.matching import TOLERANCE_M, match
from calibration.optical import find_spheres
from calibration.target import Candidate, Target
from calibration.transforms import Transform, perturbation_jacobian, umeyama
from radar.capture import RadarCapture
from radar.errors import HandbenchError

HUBER = float(np.sqrt(chi2.ppf(0.99, 3)))  # residuals beyond this many standard deviations lose weight
LINE = 0.05  # ratio of the second to the first extent of the centres below which they count as a line


def calibrate(
    points_m: np.ndarray,
    normals: np.ndarray | None,
    capture: RadarCapture,
    target: Target,
    with_scale: bool = False,
    search: EchoSearch | None = None,
) -> Transform:
    """`radar_from_photo` from a cloud of the target ([n, 3], metres, photo frame; normals outward or None) and its
    echoes (radar frame)."""
    spheres = find_spheres(points_m, normals, target)
    balls = find_balls(capture, target, search)
    common_m2 = common_covariance(target, capture.frequencies_hz)
    return register(spheres, balls, target, with_scale, common_m2)


def register(
    optical: Sequence[Candidate],
    radar: Sequence[Candidate],
    target: Target,
    with_scale: bool = False,
    common_m2: np.ndarray | None = None,
    tolerance_m: float = TOLERANCE_M,
) -> Transform:
    """`radar_from_photo` from both sensors' candidates.

    common_m2 [3, 3]: covariance of an error that all centres of the radar share, which no residual can show.

    Returns a Transform with its covariance (6×6, or 7×7 with scale) and one residual per common element. Raises
    HandbenchError when a sensor's candidates cannot be matched to the target in exactly one way, when fewer than three
    elements are common, or when these lie on a line.
    """
    seen = match(optical, target, "photographs", tolerance_m)
    heard = match(radar, target, "echoes", tolerance_m)
    common = sorted(seen.keys() & heard.keys())
    transform = align([seen[i] for i in common], [heard[i] for i in common], with_scale)
    if common_m2 is not None:
        transform.covariance[:3, :3] += common_m2  # all centres move together: a translation
    return transform


def align(source: Sequence[Candidate], target: Sequence[Candidate], with_scale: bool = False) -> Transform:
    """The similarity that carries source centres to target centres, pair by pair, by maximum likelihood.

    Gauss–Newton on Σ dᵀC⁻¹d with d = q − s·R·p − t and C = s²·R·C_p·Rᵀ + C_q, Huber's weights against an outlier. The
    covariance is the inverse normal matrix, enlarged by χ²/dof when the residuals contradict it (99 %).
    """
    p_m = np.array([c.centre_m for c in source]).reshape(-1, 3)
    q_m = np.array([c.centre_m for c in target]).reshape(-1, 3)
    _check_geometry(p_m)
    matrix = umeyama(p_m, q_m, with_scale)
    unknowns = 7 if with_scale else 6
    for _ in range(50):
        linear, carried_m = matrix[:3, :3], p_m @ matrix[:3, :3].T + matrix[:3, 3]
        offset_m = q_m - carried_m
        information = np.linalg.inv([
            linear @ a.covariance_m2 @ linear.T + b.covariance_m2 for a, b in zip(source, target, strict=True)
        ])
        distance2 = np.einsum("ni,nij,nj->n", offset_m, information, offset_m)
        information *= np.minimum(1, HUBER / np.sqrt(np.maximum(distance2, 1e-30)))[:, None, None]
        jacobian = perturbation_jacobian(carried_m)[:, :, :unknowns]
        normal = np.einsum("nia,nij,njb->ab", jacobian, information, jacobian)
        step = np.linalg.solve(normal, np.einsum("nia,nij,nj->a", jacobian, information, offset_m))
        matrix = _perturb(matrix, step)
        if np.abs(step).max() < 1e-12:
            break
    freedom = 3 * len(p_m) - unknowns
    contradiction = distance2.sum() / chi2.ppf(0.99, freedom) if freedom > 0 else 0.0
    inflation = max(1.0, distance2.sum() / freedom) if contradiction > 1 else 1.0
    residuals_m = np.linalg.norm(q_m - p_m @ matrix[:3, :3].T - matrix[:3, 3], axis=1)
    return Transform("photo", "radar", matrix, inflation * np.linalg.inv(normal), residuals_m)


def _perturb(matrix: np.ndarray, step: np.ndarray) -> np.ndarray:
    """Apply [translation, rotation vector(, log scale)] in the target frame."""
    change = np.eye(4)
    change[:3, :3] = np.exp(step[6] if len(step) == 7 else 0.0) * Rotation.from_rotvec(step[3:6]).as_matrix()
    change[:3, 3] = step[:3]
    return change @ matrix


def _check_geometry(points_m: np.ndarray) -> None:
    if len(points_m) < 3:
        raise HandbenchError(f"target: photographs and echoes share {len(points_m)} elements; expected 3 or more")
    extents = np.linalg.svd(points_m - points_m.mean(axis=0), compute_uv=False)
    if extents[1] < LINE * extents[0]:
        raise HandbenchError(
            f"target: the {len(points_m)} common elements lie on a line, so that the rotation about it stays open; "
            "expected elements that span a plane"
        )

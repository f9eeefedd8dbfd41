"""Detection of the target's foam spheres in a point cloud from photographs.

Each point votes for the centre one radius behind it along its normal (a Hough transform with known
radius); at maxima of the votes, robust least squares of |p − c| − R refine the sphere. A sphere is
visible from one side only and may be partly hidden, so that a cap of 8 % of its surface is enough.
On such a cap, depth and radius are strongly correlated; the radius is therefore constrained by its
manufacturing tolerance.
"""

from collections.abc import Iterator
from itertools import product

import numpy as np
from scipy.spatial import cKDTree

from handbench.calibration.target import Candidate, Target
from handbench.support.points import mean_by, voxels

VOXELS_PER_RADIUS = 15  # of the smallest sphere
LEAST_POINTS = 16  # of a sphere, and votes for its centre
MAX_MODES = 40  # maxima of the votes that are tried for each radius
MAX_STEPS = 30
GATE = 0.15  # largest distance of a vote or point from a sphere, relative to the radius
MAX_NORMAL_ANGLE_RAD = np.radians(35)
MIN_COVERAGE = 0.08  # least visible share of the sphere's surface
# largest standard deviation of the points about the sphere, relative to its radius
MAX_ROUGHNESS = 0.03
RADIUS_TOLERANCE = 0.06  # largest relative difference of the freely fitted radius
TUKEY = 4.685  # 95 % efficient for Gaussian noise
# Dense matching puts convex surfaces too far inside, more so at steep angles. Resulting errors in
# pixels that more points do not reduce: of each sphere (per axis), and common to all spheres,
# towards the cameras. Root mean square of 20 rendered spheres at draft quality (15 at normal
# quality: 0.029 and 0.051).
WHOLE_PX, TOWARDS_CAMERAS_PX = 0.053, 0.062
# least mean square cosine to any direction for a determined centre: that of a cap of 6 %
LEAST_HELD = 1e-3
# side, relative to the radius, of the patches whose sums reveal errors that neighbours share
PATCH = 0.5


def find_spheres(
    points_m: np.ndarray, normals: np.ndarray, target: Target, pixel_m: float = 0.0
) -> list[Candidate]:
    """Find all spheres in a point cloud that have the radius of an element of the target, the
    largest first.

    points_m, normals: [n, 3], normals outward (towards the cameras); pixel_m: size on the surface
    of a pixel of the cloud's depth maps, which enlarges the covariances by the errors of dense
    matching.
    """
    radii_m = sorted({e.sphere_radius_m for e in target.element}, reverse=True)
    points_m, normals = thin_cloud(points_m, normals, min(radii_m) / VOXELS_PER_RADIUS)
    whole_m2 = (WHOLE_PX * pixel_m) ** 2 * np.eye(3)
    spheres: list[Candidate] = []
    for radius_m in radii_m:
        elements = tuple(i for i, e in enumerate(target.element) if e.sphere_radius_m == radius_m)
        for start_m in meeting_points(points_m, normals, radius_m):
            near = np.linalg.norm(points_m - start_m, axis=1) < (1 + 2 * GATE) * radius_m
            fit = fit_sphere(
                points_m[near], normals[near], start_m, radius_m, target.sphere_radius_sigma_m
            )
            # foam spheres cannot share more than a little of their space
            if fit is not None and all(
                np.linalg.norm(fit[0] - other.centre_m)
                > 0.5 * (radius_m + target.element[other.elements[0]].sphere_radius_m)
                for other in spheres
            ):
                spheres.append(Candidate(fit[0], fit[1] + whole_m2, elements))
    return spheres


def thin_cloud(
    points_m: np.ndarray, normals: np.ndarray, voxel_m: float
) -> tuple[np.ndarray, np.ndarray]:
    """Replace all points in a voxel of side voxel_m by their mean, with the mean of their normals,
    so that all parts of a surface have the same weight: (points [n, 3], unit normals [n, 3]).
    Voxels whose normals cancel belong to no surface and are dropped."""
    voxel = voxels(points_m, voxel_m)
    normal = mean_by(voxel, normals)
    length = np.linalg.norm(normal, axis=1)
    flat = length > 0.5
    return mean_by(voxel, points_m)[flat], normal[flat] / length[flat, None]


def meeting_points(
    points_m: np.ndarray, normals: np.ndarray, radius_m: float
) -> Iterator[np.ndarray]:
    """Yield likely centres [3] of spheres of this radius, the likeliest first: the maxima of the
    density of the points' votes for the position one radius behind them along their normal."""
    votes = points_m - radius_m * normals
    tree = cKDTree(votes)
    count = tree.query_ball_point(votes, GATE * radius_m, return_length=True)
    for _ in range(MAX_MODES):
        if count.max(initial=0) < LEAST_POINTS:
            return
        best = count.argmax()
        yield votes[tree.query_ball_point(votes[best], GATE * radius_m)].mean(axis=0)
        count[tree.query_ball_point(votes[best], 2 * GATE * radius_m)] = 0


def fit_sphere(
    points_m: np.ndarray,
    normals: np.ndarray,
    centre_m: np.ndarray,
    radius_m: float,
    radius_sigma_m: float = 0.0,
) -> tuple[np.ndarray, np.ndarray] | None:
    """Fit a sphere to the points near a first guess of its centre: (centre [3], covariance [3, 3]);
    None if the points do not support it.

    It is an M-estimate (Tukey's biweight w, iteratively reweighted Gauss–Newton) of the centre and
    of the radius' deviation from radius_m, which has the prior standard deviation radius_sigma_m:
    Σ w·e² of e = |p − c| − R. The covariance is the sandwich A⁻¹BA⁻¹, with B enlarged for
    correlated errors of neighbouring points.
    """
    extra_m = 0.0
    for _ in range(MAX_STEPS):
        offset_m = points_m - centre_m
        distance_m = np.maximum(np.linalg.norm(offset_m, axis=1), np.finfo(float).tiny)
        outward = offset_m / distance_m[:, None]
        near = np.abs(distance_m - radius_m) < GATE * radius_m
        near &= (outward * normals).sum(axis=1) > np.cos(MAX_NORMAL_ANGLE_RAD)
        if near.sum() < LEAST_POINTS:
            return None
        residual_m = distance_m[near] - radius_m - extra_m
        design = np.column_stack([outward[near], np.ones(near.sum())])
        sigma_m = max(1.4826 * np.median(np.abs(residual_m)), 1e-6)
        u2 = np.minimum((residual_m / (TUKEY * sigma_m)) ** 2, 1)
        weight = (1 - u2) ** 2
        score = weight * residual_m
        shared = _shared(points_m[near], score, PATCH * radius_m)
        # of the points' residuals, as far as their sums over neighbours show it
        variance_m2 = shared * (score**2).sum() / weight.sum()
        prior = np.zeros((4, 4))  # information on the radius, in the units of the normal matrix
        prior[3, 3] = max(variance_m2, 1e-18) / max(radius_sigma_m, 1e-9) ** 2
        free = (weight[:, None] * design).T @ design  # normal matrix without the prior
        if not _held(free + prior, weight.sum()):
            return None
        step_m = np.linalg.solve(free + prior, design.T @ score - prior[:, 3] * extra_m)
        centre_m, extra_m = centre_m + step_m[:3], extra_m + step_m[3]
        if np.linalg.norm(step_m) < 1e-8:
            break
    # a cap of this share of the sphere has unit vectors with a mean of length 1 − share
    coverage = 1 - np.linalg.norm(design[u2 < 1, :3].mean(axis=0))
    free_radius_m = radius_m + extra_m + np.linalg.lstsq(free, design.T @ score)[0][3]
    if (
        sigma_m > MAX_ROUGHNESS * radius_m
        or coverage < MIN_COVERAGE
        or abs(free_radius_m / radius_m - 1) > RADIUS_TOLERANCE
    ):
        return None
    inverse = np.linalg.pinv(((1 - u2) * (1 - 5 * u2) * design.T) @ design + prior)
    spread = shared * (score**2 * design.T) @ design + prior * prior[3, 3] * radius_sigma_m**2
    return centre_m, (inverse @ spread @ inverse)[:3, :3]


def _held(normal: np.ndarray, weight: float) -> bool:
    """Return True if the points determine the sphere's centre in every direction, also with an
    unknown radius. Points on a circle do not: to first order, they leave the direction across their
    plane open.

    normal [4, 4]: normal matrix of centre and radius; weight: sum of the points' weights.
    """
    centre = normal[:3, :3] - np.outer(normal[:3, 3], normal[3, :3]) / normal[3, 3]
    return bool(np.linalg.eigvalsh(centre)[0] > LEAST_HELD * weight)


def _shared(points_m: np.ndarray, score: np.ndarray, patch_m: float) -> float:
    """Estimate how strongly the errors of neighbouring points are correlated: 1 for independent
    errors, else about the number of points with a common error.

    It is the variance of sums of the points' scores (weighted residuals) over patches of side
    patch_m, relative to that for independent errors; a mean over shifted patches, corrected for 3
    fitted unknowns.
    """
    if not score.any():
        return 1.0
    ratios = []
    for shift in product((0.0, 0.5), repeat=3):
        patch = voxels(points_m, patch_m, np.array(shift))
        # number of patches, if they were equally full
        patches = len(patch) ** 2 / (np.bincount(patch) ** 2).sum()
        sums = (np.bincount(patch, score) ** 2).sum() / (score**2).sum()
        ratios.append(sums * patches / max(patches - 3, 1))
    return max(1.0, float(np.mean(ratios)))

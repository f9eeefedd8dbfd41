"""Detection of the target's foam spheres in a point cloud from photographs.

Each point votes for the centre one radius behind it along its normal (a Hough transform with known
radius); at maxima of the votes, robust least squares of |p − c| − R refine the sphere. A sphere is
visible from one side only and may be partly hidden, so that a cap of 12 % of its surface is enough.
On such a cap, depth and radius are strongly correlated; the radius is therefore constrained by its
manufacturing tolerance.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import product

import numpy as np
from scipy.spatial import cKDTree

from handbench.calibration.spheres.description import Candidate, Target
from handbench.support.errors import HandbenchError
from handbench.support.voxels import mean_by, voxels

VOXELS_PER_RADIUS = 15  # of the smallest sphere
NEIGHBOURS = 16  # of the local plane that gives a normal
MAX_MODES = 40  # maxima of the votes that are tried for each radius
GATE = 0.15  # largest distance of a vote or point from a sphere, relative to the radius
MAX_NORMAL_ANGLE_RAD = np.radians(35)
MIN_COVERAGE = 0.12  # least visible share of the sphere's surface
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


@dataclass(frozen=True)
class Sphere(Candidate):
    """A foam sphere detected in a point cloud. radius_m: its radius if that is fitted freely, as a
    check; inliers: number of points on it, after thinning of the cloud; coverage: share of its
    surface that they cover."""

    radius_m: float
    inliers: int
    coverage: float


@dataclass(frozen=True)
class OrientedPoints:
    """Points [n, 3] of a cloud with unit normals [n, 3]. oriented: True if the normals point
    outward, False if their sign is arbitrary."""

    points_m: np.ndarray
    normals: np.ndarray
    oriented: bool

    def __getitem__(self, chosen: np.ndarray) -> "OrientedPoints":
        return OrientedPoints(self.points_m[chosen], self.normals[chosen], self.oriented)


def find_spheres(
    points_m: np.ndarray, normals: np.ndarray | None, target: Target, pixel_m: float = 0.0
) -> list[Sphere]:
    """Find all spheres in a point cloud that have the radius of an element of the target, those
    with most points first.

    points_m: [n, 3], metres; normals: [n, 3], outward (towards the cameras), or None to estimate
    them; pixel_m: size on the surface of a pixel of the cloud's depth maps, which enlarges the
    covariances by the errors of dense matching. Raises HandbenchError for a malformed cloud.
    """
    _check(points_m, normals)
    radii_m = sorted({e.sphere_radius_m for e in target.element}, reverse=True)
    cloud = thin_cloud(points_m, normals, min(radii_m) / VOXELS_PER_RADIUS)
    found: list[Sphere] = []
    if len(cloud.points_m) < NEIGHBOURS:
        return found
    for radius_m in radii_m:
        elements = tuple(i for i, e in enumerate(target.element) if e.sphere_radius_m == radius_m)
        for centre_m in meeting_points(cloud, radius_m):
            near = cloud[
                np.abs(distances(cloud.points_m, centre_m) - radius_m) < 2 * GATE * radius_m
            ]
            sphere = fit_sphere(near, centre_m, radius_m, elements, target.sphere_radius_sigma_m)
            if (
                sphere is not None
                and all(  # foam spheres cannot share more than a little of their space
                    np.linalg.norm(sphere.centre_m - other.centre_m)
                    > 0.5 * (sphere.radius_m + other.radius_m)
                    for other in found
                )
            ):
                whole_m2 = (WHOLE_PX * pixel_m) ** 2 * np.eye(3)
                found.append(replace(sphere, covariance_m2=sphere.covariance_m2 + whole_m2))
    return sorted(found, key=lambda sphere: -sphere.inliers)


def thin_cloud(points_m: np.ndarray, normals: np.ndarray | None, voxel_m: float) -> OrientedPoints:
    """Replace all points in a voxel of side voxel_m by their mean, with the mean of their normals,
    so that all parts of a surface have the same weight. Voxels whose normals cancel are dropped. If
    normals is None, they are estimated from local planes, with an arbitrary sign."""
    voxel = voxels(points_m, voxel_m)
    mean = mean_by(voxel, points_m)
    if normals is None:
        # a range, since k = 1 would drop an axis
        nearest = range(1, min(NEIGHBOURS, len(mean)) + 1)
        near = mean[cKDTree(mean).query(mean, k=nearest)[1]]
        spread = near - near.mean(axis=1, keepdims=True)
        return OrientedPoints(
            mean,
            np.linalg.eigh(np.einsum("nki,nkj->nij", spread, spread))[1][:, :, 0],
            oriented=False,
        )
    normal = mean_by(voxel, normals)
    length = np.linalg.norm(normal, axis=1)
    flat = length > 0.5  # normals that cancel belong to no surface
    return OrientedPoints(mean[flat], normal[flat] / length[flat, None], oriented=True)


def meeting_points(cloud: OrientedPoints, radius_m: float) -> Iterator[np.ndarray]:
    """Yield likely centres [3] of spheres of this radius, the likeliest first.

    Each point votes for the position one radius behind it along its normal (and in front of it, if
    the normal's sign is unknown); the centres are the maxima of the votes' density.
    """
    votes = cloud.points_m - radius_m * cloud.normals
    if not cloud.oriented:
        votes = np.concatenate([votes, cloud.points_m + radius_m * cloud.normals])
    tree = cKDTree(votes)
    count = tree.query_ball_point(votes, GATE * radius_m, return_length=True)
    for _ in range(MAX_MODES):
        best = int(np.argmax(count))
        if count[best] < NEIGHBOURS:
            return
        yield votes[tree.query_ball_point(votes[best], GATE * radius_m)].mean(axis=0)
        count[tree.query_ball_point(votes[best], 2 * GATE * radius_m)] = 0


def fit_sphere(
    cloud: OrientedPoints,
    centre_m: np.ndarray,
    radius_m: float,
    elements: tuple[int, ...],
    radius_sigma_m: float = 0.0,
) -> Sphere | None:
    """Fit a sphere to the points near a first guess of its centre; None if the points do not
    support it.

    It is an M-estimate (Tukey's biweight, iteratively reweighted Gauss–Newton) of the centre and of
    the radius' deviation from radius_m, which has the prior standard deviation radius_sigma_m.
    elements: indices of the target's elements with this radius, copied to the result. The
    covariance is the sandwich A⁻¹BA⁻¹, with B enlarged for correlated errors of neighbouring
    points.
    """
    extra_m, shared = 0.0, 1.0
    for _ in range(30):
        on_it = _consistent(cloud, centre_m, radius_m)
        if on_it.sum() < NEIGHBOURS:
            return None
        points_m = cloud.points_m[on_it]
        residual = distances(points_m, centre_m) - radius_m - extra_m
        outward = (points_m - centre_m) / distances(points_m, centre_m)[:, None]
        design = np.concatenate([outward, np.ones((len(outward), 1))], axis=1)
        sigma_m = max(1.4826 * np.median(np.abs(residual)), 1e-6)
        u2 = np.minimum((residual / (TUKEY * sigma_m)) ** 2, 1)
        weight = (1 - u2) ** 2
        score = weight * residual
        shared = _shared(points_m, score, PATCH * radius_m)
        # the points' own, of sums over neighbours
        variance_m2 = shared * (score**2).sum() / weight.sum()
        prior = np.zeros((4, 4))  # information on the radius, in the units of the normal matrix
        prior[3, 3] = max(variance_m2, 1e-18) / max(radius_sigma_m, 1e-9) ** 2
        normal = (weight[:, None] * design).T @ design + prior
        if not _held(normal, weight.sum()):
            return None
        step = np.linalg.solve(normal, design.T @ score - prior[:, 3] * extra_m)
        centre_m, extra_m = centre_m + step[:3], extra_m + step[3]
        if np.linalg.norm(step) < 1e-8:
            break
    if sigma_m > MAX_ROUGHNESS * radius_m:
        return None
    coverage, inliers = _coverage(outward[u2 < 1]), int((u2 < 1).sum())
    free_radius_m = _free_radius(points_m, weight, centre_m, radius_m)
    if coverage < MIN_COVERAGE or abs(free_radius_m / radius_m - 1) > RADIUS_TOLERANCE:
        return None
    inverse = np.linalg.pinv(((1 - u2) * (1 - 5 * u2) * design.T) @ design + prior)
    spread = shared * (score**2 * design.T) @ design + prior * prior[3, 3] * radius_sigma_m**2
    covariance_m2 = (inverse @ spread @ inverse)[:3, :3]
    return Sphere(centre_m, covariance_m2, elements, free_radius_m, inliers, coverage)


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
    ratios = []
    if not score.any():
        return 1.0
    for shift in product((0.0, 0.5), repeat=3):
        patch = voxels(points_m, patch_m, np.array(shift))
        # that count, for they are not equally full
        patches = len(patch) ** 2 / (np.bincount(patch) ** 2).sum()
        ratios.append(
            (np.bincount(patch, score) ** 2).sum()
            / (score**2).sum()
            * patches
            / max(patches - 3, 1)
        )
    return max(1.0, float(np.mean(ratios)))


def distances(points_m: np.ndarray, centre_m: np.ndarray) -> np.ndarray:
    """Compute the distances [n] of points [n, 3] from a centre [3]."""
    return np.linalg.norm(points_m - centre_m, axis=1)


def _consistent(cloud: OrientedPoints, centre_m: np.ndarray, radius_m: float) -> np.ndarray:
    """Return a boolean mask [n], True for points that are near the sphere's surface and whose
    normals agree with it."""
    offset = cloud.points_m - centre_m
    distance = np.linalg.norm(offset, axis=1)
    cosine = np.einsum("nk,nk->n", offset, cloud.normals) / np.maximum(
        distance, np.finfo(float).tiny
    )
    cosine = cosine if cloud.oriented else np.abs(cosine)
    return (np.abs(distance - radius_m) < GATE * radius_m) & (cosine > np.cos(MAX_NORMAL_ANGLE_RAD))


def _free_radius(
    points_m: np.ndarray, weight: np.ndarray, centre_m: np.ndarray, radius_m: float
) -> float:
    """Compute the radius of the sphere that fits weighted points best if the radius is unknown, by
    least squares of |p|² − 2 p·c = R² − |c|², which is linear in c and R² − |c|². centre_m,
    radius_m: only shift and scale the coordinates, for numerical accuracy."""
    p = (points_m - centre_m) / radius_m
    root = np.sqrt(weight)[:, None]
    design = np.concatenate([2 * p, np.ones((len(p), 1))], axis=1)
    *c, rest = np.linalg.lstsq(root * design, root[:, 0] * (p**2).sum(axis=1))[0]
    return float(radius_m * np.sqrt(max(rest + np.dot(c, c), 0)))


def _coverage(outward: np.ndarray) -> float:
    """Compute the share of a sphere's surface that points cover. outward [n, 3]: unit vectors from
    the centre to the points.

    It is the share of 200 evenly spread directions that are the nearest one to some point.
    """
    n = 200
    i = np.arange(n) + 0.5
    z, azimuth = 1 - 2 * i / n, np.pi * (1 + np.sqrt(5)) * i
    lattice = np.stack(
        [np.sqrt(1 - z**2) * np.cos(azimuth), np.sqrt(1 - z**2) * np.sin(azimuth), z], axis=1
    )
    return len(np.unique(cKDTree(lattice).query(outward)[1])) / n


def _check(points_m: np.ndarray, normals: np.ndarray | None) -> None:
    if points_m.ndim != 2 or points_m.shape[1] != 3 or len(points_m) < NEIGHBOURS:
        raise HandbenchError(
            f"points_m: has shape {points_m.shape}; expected [n, 3] with n ≥ {NEIGHBOURS}, in "
            "metres"
        )
    if not np.isfinite(points_m).all():
        raise HandbenchError("points_m: has NaN or infinite numbers; remove these points first")
    if normals is not None and (normals.shape != points_m.shape or not np.isfinite(normals).all()):
        raise HandbenchError(
            f"normals: have shape {normals.shape} or NaN or infinite values; expected finite "
            f"numbers of shape {points_m.shape}"
        )

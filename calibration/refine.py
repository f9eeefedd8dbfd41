"""Registration of a mesh to a radar depth map, for captures without a calibration target.

Point-to-plane ICP along z (Chen & Medioni 1992): every pixel where both radar and mesh have a depth
gives one distance e = (z_radar − z_mesh)·n_z from the mesh's tangent plane, with the unit normal
n ∝ (−∂z/∂x, −∂z/∂y, 1). A small motion of the mesh, dp = τ + ω×(p − c) about the centre c of the
pixels, changes e by −n·dp. Each Gauss–Newton step minimises Σ e² over the pixels that are no
outliers. The factor n_z lowers the weight of steep surfaces, whose z changes strongly with any
sideways error.

The covariance is s²·k·(JᵀJ)⁻¹ with J = [n, (p − c)×n], the variance s² of the distances, and the
number k of pixels that err together. It assumes that errors have the correlation exp(−r²/2ℓ²) at
the distance r, the same everywhere. A bias of the radar over larger areas becomes part of the
motion and is not covered.
"""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from scipy.ndimage import gaussian_filter
from scipy.spatial.transform import Rotation

from handbench.calibration.registration import motion
from handbench.calibration.transforms import Transform, adjoint
from handbench.radar.data.depthmap import DepthMap
from handbench.support.errors import HandbenchError

# cosine to z (60°) below which a pixel is left out: its radar cell holds many depths
STEEPEST = 0.5
OUTLIER = 3.0  # standard deviations of the distances beyond which a pixel is left out
# a direction that answers with a smaller share of the best one's distance is not determined
LEAST_ANSWER = 1 / 17
STEPS = 60  # at most
STILL_M = 1e-5  # motion of the pixels (rms) that ends the iteration
FINEST_M = 1e-6  # the ray caster's own error
PROBE_M = 0.008  # q, over which the correlation of the distances is measured
LARGEST_CORRELATION = 0.9  # more is too small a surface
FARTHEST_M = 0.015  # beyond, another surface is as likely as this one
FARTHEST_RAD = np.radians(10)
FEWEST_PIXELS = 100
SMALLEST_M2 = 6e-4  # common area: some 25 cells of the lateral resolution
DIRECTIONS = ("x", "y", "z", "rotation about x", "rotation about y", "rotation about z")
SHARE = 1 / 6  # of a direction that is not determined, beyond which it is named


def refine(
    mesh_depths: Callable[[Transform], np.ndarray], depth: DepthMap, start: Transform
) -> Transform:
    """Find the transform of a mesh into the radar frame, near `start`, with which the mesh fits the
    radar's depths best. The scale is kept.

    mesh_depths: returns the depths z [ny, nx], metres, of the mesh moved by a transform, on the
    pixels of `depth`; NaN where there is no surface. The entry `refined` of the result says how
    well the mesh fitted before and after, which directions the surface does not determine (they are
    free), and why to distrust the result.

    Along free directions the transform and its covariance are those of the start; if the start has
    no covariance, the result has none. Raises HandbenchError if radar and mesh have too few pixels
    in common, if the iteration does not converge, if the mesh moves by more than 15 mm or 10°, or
    if it fits worse than before.
    """
    if min(depth.z_m.shape) < 2:
        raise HandbenchError(
            f"refine: the depth map has {depth.z_m.shape} pixels; expected at least (2, 2); "
            "image more pixels"
        )
    distance_m, used, jacobian = _pixels(mesh_depths(start), depth)
    before_m, moved = distance_m, start
    points_m = _points(depth.z_m, depth)[used]
    centre_m, extent_m = points_m.mean(axis=0), np.sqrt(points_m.var(axis=0).sum())
    # of a motion [τ, ω·extent] about the centre, to [translation, rotation] about the origin
    to_origin = adjoint(-centre_m) @ np.diag(np.repeat([1, 1 / extent_m], 3))
    for _ in range(STEPS):
        central = jacobian @ to_origin
        inverse = np.linalg.pinv(central, LEAST_ANSWER)
        free = np.eye(6) - inverse @ central  # projects on directions that are not determined
        step = inverse @ distance_m[used]
        moved = replace(moved, matrix=motion(to_origin @ step) @ moved.matrix)
        distance_m, used, jacobian = _pixels(mesh_depths(moved), depth)
        last = np.linalg.norm(step)
        if last < STILL_M:
            break
    variance_m2 = _variance(distance_m, used, depth)
    unsteady = last > max(STILL_M, np.sqrt(variance_m2 * (inverse**2).sum()))
    change = moved.matrix @ np.linalg.inv(start.matrix)
    shift = np.linalg.norm(change[:3] @ [*centre_m, 1] - centre_m)
    turn = Rotation.from_matrix(change[:3, :3]).magnitude()
    both = used & np.isfinite(before_m)
    before_mm, after_mm = (
        1e3 * np.sqrt(np.mean(each_m[both] ** 2)) for each_m in (before_m, distance_m)
    )
    worse = not after_mm <= before_mm + 1e3 * FINEST_M
    if unsteady or worse or shift > FARTHEST_M or turn > FARTHEST_RAD:
        raise HandbenchError(
            f"refine: would move the mesh by {1e3 * shift:.1f} mm and {np.degrees(turn):.1f}°, "
            f"{1e3 * last:.2f} mm of it in the last step, with RMS distances of {before_mm:.2f} mm "
            f"before and {after_mm:.2f} mm after; only motions up to {1e3 * FARTHEST_M:.0f} mm and "
            f"{np.degrees(FARTHEST_RAD):.0f}° that end and fit better are reliable; start with a "
            "better transform (--transform), or calibrate with a target"
        )
    names = [name for name, share in zip(DIRECTIONS, free.diagonal(), strict=True) if share > SHARE]
    refined = (
        f"aligned to the radar's own depth map, over {used.sum()} pixels, from an RMS distance of "
        f"{before_mm:.3f} mm to {after_mm:.3f} mm; "
        f"not determined: {', '.join(names) or 'nothing'}; "
        "the map's bias cannot show, and no covariance has it"
    )
    steps = to_origin @ inverse
    covariance = variance_m2 * steps @ steps.T
    if names:
        unmoved = to_origin @ free @ np.linalg.inv(to_origin)
        of_start = start.covariance
        covariance = None if of_start is None else covariance + unmoved @ of_start @ unmoved.T
    return replace(moved, covariance=covariance, refined=refined)


def _points(z_m: np.ndarray, depth: DepthMap) -> np.ndarray:
    """Return the points [ny, nx, 3] with the depths z_m [ny, nx] on the pixels of a depth map."""
    return np.stack([*np.meshgrid(depth.x_m, depth.y_m), z_m], axis=2)


def _pixels(z_m: np.ndarray, depth: DepthMap) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Compare the depths z_m [ny, nx] of a mesh, metres, with those of the radar.

    Returns the distance of the radar's points from the mesh along the normal [ny, nx], metres; a
    mask [ny, nx] of the n pixels that are no outliers; and their J [n, 6] about the origin. NaN
    are pixels that may be wrapped in phase, steep surface, and silhouettes, where the slope (a
    central difference) is undefined or a jump. Raises HandbenchError if too few pixels remain."""
    slope_y, slope_x = np.gradient(z_m, depth.y_m, depth.x_m)
    normal = np.stack([-slope_x, -slope_y, np.ones_like(z_m)], axis=2)
    normal /= np.linalg.norm(normal, axis=2, keepdims=True)
    distance_m = (depth.z_m - z_m) * normal[..., 2]
    distance_m[~(normal[..., 2] > STEEPEST)] = np.nan  # NaN is not larger
    if depth.wrapped is not None:
        distance_m[depth.wrapped] = np.nan
    shared_m = distance_m[np.isfinite(distance_m)]
    area_m2 = len(shared_m) * _pitch_m(depth).prod()
    if len(shared_m) < FEWEST_PIXELS or area_m2 < SMALLEST_M2:
        raise HandbenchError(
            f"refine: mesh and depth map share {len(shared_m)} pixels, {1e4 * area_m2:.1f} cm², "
            f"where the surface is not steep; expected at least {FEWEST_PIXELS} pixels and "
            f"{1e4 * SMALLEST_M2:.0f} cm²; check --transform, and that both show the same object"
        )
    # about zero, so that a distant start does not make all pixels outliers
    scale_m = max(1.4826 * np.median(np.abs(shared_m)), FINEST_M)
    used = np.abs(distance_m) <= OUTLIER * scale_m
    turning = np.cross(_points(z_m, depth), normal)
    return distance_m, used, np.hstack([normal[used], turning[used]])


def _pitch_m(depth: DepthMap) -> np.ndarray:
    """Return the mean distances [2] of the pixels of a depth map along y and x, metres."""
    return np.array([np.ptp(axis_m) / (len(axis_m) - 1) for axis_m in (depth.y_m, depth.x_m)])


def _variance(distance_m: np.ndarray, used: np.ndarray, depth: DepthMap) -> float:
    """Compute s²·k, m²: the variance of the distances times the number of pixels that err together.
    The mean of e_i·e_j over all pairs of pixels, weighted by exp(−r²/2q²), is s²·τ with
    τ = ℓ²/(ℓ² + q²); k is 2πℓ² over the area of a pixel. Six unknowns have absorbed 6k of n
    squares."""
    pitch_m = _pitch_m(depth)
    maps = np.where(used, distance_m, 0), used.astype(float)
    near_m, near = (gaussian_filter(each, PROBE_M / pitch_m, mode="constant") for each in maps)
    e_m, n = distance_m[used], used.sum()
    variance_m2 = e_m @ e_m / n
    correlation = e_m @ near_m[used] / near[used].sum() / variance_m2
    correlation = np.clip(correlation, 0, LARGEST_CORRELATION)
    cell_m2 = 2 * np.pi * PROBE_M**2 * correlation / (1 - correlation)
    together = max(cell_m2 / pitch_m.prod(), 1.0)
    return float(variance_m2 * together / max(1 - 6 * together / n, 1 - LARGEST_CORRELATION))

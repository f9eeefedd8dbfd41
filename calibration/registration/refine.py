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
from typing import NamedTuple

import numpy as np
from scipy.ndimage import gaussian_filter
from scipy.spatial.transform import Rotation

from handbench.calibration.registration.rigid_fit import motion
from handbench.calibration.transforms import Transform, adjoint
from handbench.radar.data.depthmap import DepthMap
from handbench.support.errors import HandbenchError

REASON = "aligned to the radar's own depth map: its bias cannot show, and no covariance has it"
# cosine to z (60°) below which a pixel is left out: its radar cell holds many depths
STEEPEST = 0.5
OUTLIER = 3.0  # standard deviations of the distances beyond which a pixel is left out
# a direction that answers with less than 1/17 of the best one's distance is not determined
CONDITION = 300.0
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


class _Pixels(NamedTuple):
    """The pixels where both radar and mesh have a depth, and the n of them that are no outliers.

    distance_m [ny, nx]: distance of the radar's point from the mesh along the normal, NaN for other
    pixels; used [ny, nx]: True for the n pixels. centre_m [3]: middle of their points on the mesh;
    to_origin [6, 6]: changes a motion [τ, ω·ρ] about it, with the points' root-mean-square extent
    ρ, to [translation, rotation] about the origin. jacobian [n, 6]: J, for motions [τ, ω·ρ].
    inverse [6, 6]: the pseudo-inverse of JᵀJ; free [6, k]: orthogonal directions of motion, unit
    vectors, that the surface does not determine. Lengths are in metres."""

    distance_m: np.ndarray
    used: np.ndarray
    centre_m: np.ndarray
    to_origin: np.ndarray
    jacobian: np.ndarray
    inverse: np.ndarray
    free: np.ndarray


def refine(
    mesh_depths: Callable[[Transform], np.ndarray], depth: DepthMap, start: Transform
) -> Transform:
    """Find the transform of a mesh into the radar frame, near `start`, with which the mesh fits the
    radar's depths best. The scale is kept.

    mesh_depths: returns the depths z [ny, nx], metres, of the mesh moved by a transform, on the
    pixels of `depth`; NaN where there is no surface. The entry `refined` of the result has the
    reason to distrust it, the numbers of pixels used and left_out (outliers), rms_before_mm and
    rms_after_mm of the distances, the motion as translation_mm [3] of the pixels' centre and
    rotation_deg [3] (a rotation vector), and the directions that the surface does not determine
    (free).

    Along free directions the transform and its covariance are those of the start; if the start has
    no covariance, the result has none. Raises HandbenchError if radar and mesh have too few pixels
    in common, if the iteration does not converge, if the mesh moves by more than 15 mm or 10°, or
    if it fits worse than before.
    """
    if min(depth.z_m.shape) < 2:
        raise HandbenchError(
            f"refine: the depth map has {depth.z_m.shape} pixels; expected at least 2 × 2"
        )
    before = pixels = _pixels(mesh_depths(start), depth)
    moved = start
    for _ in range(STEPS):
        step = pixels.inverse @ pixels.jacobian.T @ pixels.distance_m[pixels.used]
        moved = replace(moved, matrix=motion(pixels.to_origin @ step) @ moved.matrix)
        pixels = _pixels(mesh_depths(moved), depth)
        if np.linalg.norm(step) < STILL_M:
            break
    variance_m2 = _variance(pixels, depth)
    last = np.linalg.norm(step)
    unsteady = last > max(STILL_M, np.sqrt(variance_m2 * np.trace(pixels.inverse)))
    change = moved.matrix @ np.linalg.inv(start.matrix)
    # of the point that came to the centre
    shift_m = pixels.centre_m - np.linalg.inv(change)[:3] @ [*pixels.centre_m, 1]
    turn_rad = Rotation.from_matrix(change[:3, :3]).as_rotvec()
    shift, turn = np.linalg.norm(shift_m), np.linalg.norm(turn_rad)
    both = pixels.used & np.isfinite(before.distance_m)
    before_mm, after_mm = (
        1e3 * float(np.sqrt(np.mean(each.distance_m[both] ** 2))) for each in (before, pixels)
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
    shares = zip(DIRECTIONS, (pixels.free**2).sum(axis=1), strict=True)
    refined = {
        "reason": REASON,
        "pixels": int(pixels.used.sum()),
        "left_out": int((np.isfinite(pixels.distance_m) & ~pixels.used).sum()),
        "rms_before_mm": before_mm,
        "rms_after_mm": after_mm,
        "translation_mm": 1e3 * shift_m,
        "rotation_deg": np.degrees(turn_rad),
        "free": [name for name, share in shares if share > 1 / len(DIRECTIONS)],
    }
    covariance = _covariance(pixels, variance_m2, start.covariance)
    return replace(moved, covariance=covariance, refined=refined)


def _pixels(z_m: np.ndarray, depth: DepthMap) -> _Pixels:
    """Compare the depths z_m [ny, nx] of a mesh, metres, with those of the radar.
    Left out are pixels that may be wrapped in phase, steep surface, and silhouettes, where the
    slope (a central difference) is undefined or a jump. Raises HandbenchError if too few pixels
    remain."""
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
    scale_m = max(1.4826 * float(np.median(np.abs(shared_m))), FINEST_M)
    used = np.abs(distance_m) <= OUTLIER * scale_m
    row, column = np.nonzero(used)
    points_m = np.stack([depth.x_m[column], depth.y_m[row], z_m[used]], axis=1)
    centre_m = points_m.mean(axis=0)
    radius_m = float(np.sqrt(((points_m - centre_m) ** 2).sum(axis=1).mean()))
    jacobian = np.hstack([normal[used], np.cross(points_m - centre_m, normal[used]) / radius_m])
    value, vector = np.linalg.eigh(jacobian.T @ jacobian)
    held = value * CONDITION >= value[-1]
    inverse = vector[:, held] / value[held] @ vector[:, held].T
    to_origin = adjoint(-centre_m) @ np.diag(np.repeat([1, 1 / radius_m], 3))
    return _Pixels(distance_m, used, centre_m, to_origin, jacobian, inverse, vector[:, ~held])


def _pitch_m(depth: DepthMap) -> np.ndarray:
    """Return the mean distances [2] of the pixels of a depth map along y and x, metres."""
    return np.array([np.ptp(axis_m) / (len(axis_m) - 1) for axis_m in (depth.y_m, depth.x_m)])


def _variance(pixels: _Pixels, depth: DepthMap) -> float:
    """Compute s²·k, m²: the variance of the distances times the number of pixels that err together.
    The mean of e_i·e_j over all pairs of pixels, weighted by exp(−r²/2q²), is s²·τ with
    τ = ℓ²/(ℓ² + q²); k is 2πℓ² over the area of a pixel. Six unknowns have absorbed 6k of n
    squares."""
    pitch_m = _pitch_m(depth)
    maps = np.where(pixels.used, pixels.distance_m, 0), pixels.used.astype(float)
    near_m, near = (gaussian_filter(each, PROBE_M / pitch_m, mode="constant") for each in maps)
    e_m, n = pixels.distance_m[pixels.used], pixels.used.sum()
    variance_m2 = e_m @ e_m / n
    correlation = e_m @ near_m[pixels.used] / near[pixels.used].sum() / variance_m2
    correlation = np.clip(correlation, 0, LARGEST_CORRELATION)
    cell_m2 = 2 * np.pi * PROBE_M**2 * correlation / (1 - correlation)
    together = max(cell_m2 / pitch_m.prod(), 1.0)
    return float(variance_m2 * together / max(1 - 6 * together / n, 1 - LARGEST_CORRELATION))


def _covariance(pixels: _Pixels, variance_m2: float, start: np.ndarray | None) -> np.ndarray | None:
    """Compute the covariance [6, 6] of [translation, rotation] about the origin; None if the
    surface does not determine a direction and the start has no covariance.
    variance_m2: s²·k; start: covariance of the start."""
    if pixels.free.size and start is None:
        return None
    to_origin = pixels.to_origin
    covariance: np.ndarray = variance_m2 * to_origin @ pixels.inverse @ to_origin.T
    if start is not None:
        unmoved = to_origin @ pixels.free @ pixels.free.T @ np.linalg.inv(to_origin)
        covariance += unmoved @ start[:6, :6] @ unmoved.T
    return covariance

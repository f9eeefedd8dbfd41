"""A mesh brought onto a radar depth map, for captures without a calibration target.

Point-to-plane ICP along z (Chen & Medioni 1992): every pixel that the radar and the mesh share gives one distance
e = (z_radar − z_mesh)·n_z, with the mesh's depth cast anew at each step. A small motion of the mesh, dp = τ + ω×(p − c)
about the pixels' centre c, changes e by −n·dp, where n = (−∂z/∂x, −∂z/∂y, 1)/√(1 + |∇z|²). The factor n_z makes a steep
surface count less, whose z swings with any sideways error. Tukey's weights keep strangers out.

What it aligns to is the radar itself: a bias of the radar is taken for a motion and cannot show afterwards. No metric
calls this; whoever does says so in the transform that comes of it.
"""

from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from bench.evaluation.floor import BLOCK_M
from calibration.transforms import Transform, adjoint, identity, load_transform, perturbation_jacobian
from groundtruth.mesh.depth import reference_on_grid
from groundtruth.mesh.surface import Surface, read_surface
from radar.data.depthmap import DepthMap, load_depthmap
from radar.support.errors import HandbenchError

REASON = "aligned to the radar's own depth map: its bias cannot show"
STEEPEST = 0.5  # cosine to z (60°) below which a pixel is left out: its radar cell holds many depths
TUKEY = 4.685  # 95 % efficient for Gaussian noise
FINEST_M = 1e-6  # scale of the distances below which nothing is an outlier: the ray caster's own error
CONDITION = 100.0  # a direction that answers with less than 1/10 of the best one's distance is not held
STEPS, STILL_M = 60, 1e-6  # Gauss–Newton steps at most, and the motion (rms of the pixels) that ends them
FARTHEST_M, FARTHEST_RAD = 0.015, np.radians(10)  # beyond: another surface is as likely as this one
FEWEST_PIXELS, FEWEST_BLOCKS = 100, 8  # six unknowns want more cells than unknowns that err apart
DIRECTIONS = ("x", "y", "z", "about x", "about y", "about z")


class _Pixels(NamedTuple):
    """The n pixels that radar and mesh share. pixel: which [n] of the grid's; block [n]: its cell of BLOCK_M, from 0;
    distance_m [n]: e; jacobian [n, 6]: n·dp by [τ, ω·radius_m], in metres; centre_m [3], radius_m: their extent."""

    pixel: np.ndarray
    block: np.ndarray
    distance_m: np.ndarray
    jacobian: np.ndarray
    centre_m: np.ndarray
    radius_m: float


def refine_files(depth_file: Path, mesh_file: Path, start_file: Path | None) -> Transform:
    """`refine` from files, which adds the depth map's name; without a start, the mesh lies in the radar frame."""
    start = identity("radar")
    if start_file is not None:
        start = load_transform(start_file)
        start.require(start.source, "radar", start_file)
    transform = refine(read_surface(mesh_file), load_depthmap(depth_file), start)
    return replace(transform, refined={"depth": Path(depth_file).name, **(transform.refined or {})})


def refine(surface: Surface, depth: DepthMap, start: Transform) -> Transform:
    """The mesh's transform into the radar frame for which its depth fits the radar's, near `start`; the scale is kept.

    Its `refined` tells what was changed: reason, pixels, left_out (strangers), blocks, rms_before_mm and rms_after_mm
    (of e, over the pixels that the fit kept), translation_mm [3] of and rotation_deg [3] (a vector) about centre_mm,
    held and free directions in words, start. The covariance (6×6, for the scale as given) takes the errors within a
    resolution cell for one; along free directions it is the start's, and there is none where the start has none. It
    says how well the radar's scatter fixes the motion, and knows nothing of a bias of the radar, which may be far
    larger. Raises HandbenchError when the two share too little, or when the motion does not end or leaves the capture
    range (15 mm, 10°).
    """
    matrix = start.matrix
    for _ in range(STEPS):
        pixels = _shared(surface, depth, Transform(start.source, "radar", matrix))
        weight, curvature = _tukey(pixels.distance_m)
        vectors, condition = _directions(pixels.jacobian, weight)
        holds = condition <= CONDITION
        step = _solve(pixels, weight, vectors[:, holds])
        matrix = _motion(step, pixels) @ matrix
        if np.linalg.norm(step) < STILL_M:
            break
    else:
        raise HandbenchError(
            f"refine: still moving by {1e3 * np.linalg.norm(step):.3f} mm after {STEPS} steps; mesh and depth map do "
            "not settle: start nearer, or calibrate with a target"
        )
    change = matrix @ np.linalg.inv(start.matrix)
    shift_m = pixels.centre_m - np.linalg.inv(change)[:3] @ [*pixels.centre_m, 1]  # of the point that came there
    turn_rad = Rotation.from_matrix(change[:3, :3]).as_rotvec()
    shift, turn = float(np.linalg.norm(shift_m)), float(np.linalg.norm(turn_rad))
    if shift > FARTHEST_M or turn > FARTHEST_RAD:
        raise HandbenchError(
            f"refine: the mesh would move by {1e3 * shift:.1f} mm and {np.degrees(turn):.1f}°; at most "
            f"{1e3 * FARTHEST_M:.0f} mm and {np.degrees(FARTHEST_RAD):.0f}° can be trusted: start nearer "
            "(--transform), or calibrate with a target"
        )
    before = _shared(surface, depth, start)
    kept = weight > 0
    _, first, last = np.intersect1d(before.pixel, pixels.pixel[kept], return_indices=True)
    named = np.array([f"{_name(v)} (condition {c:.3g})" for v, c in zip(vectors.T, condition, strict=True)])
    covariance = _covariance(pixels, weight, curvature, vectors[:, holds], vectors[:, ~holds], start.covariance)
    refined = {
        "reason": REASON,
        "pixels": int(kept.sum()),
        "left_out": int((~kept).sum()),
        "blocks": int(pixels.block.max() + 1),
        "rms_before_mm": 1e3 * float(np.sqrt((before.distance_m[first] ** 2).mean())),
        "rms_after_mm": 1e3 * float(np.sqrt((pixels.distance_m[kept][last] ** 2).mean())),
        "translation_mm": 1e3 * shift_m,
        "rotation_deg": np.degrees(turn_rad),
        "centre_mm": 1e3 * pixels.centre_m,
        "held": named[holds].tolist(),
        "free": named[~holds].tolist(),
        "start": start.matrix,
    }
    return Transform(start.source, "radar", matrix, covariance, refined=refined)


def _shared(surface: Surface, depth: DepthMap, radar_from_mesh: Transform) -> _Pixels:
    """Distances and their derivatives where both have a depth. Left out: where a phase may have wrapped, steep surface,
    and silhouettes, on which the slope (a central difference over the neighbours) does not exist or is a jump."""
    if min(depth.z_m.shape) < 3:
        raise HandbenchError(f"refine: the depth map has {depth.z_m.shape} pixels; expected a map of 3 × 3 or more")
    z_m = reference_on_grid(surface.moved(radar_from_mesh), depth.x_m, depth.y_m).z_m
    slope_y, slope_x = np.gradient(z_m, depth.y_m, depth.x_m)
    n_z = 1 / np.sqrt(1 + slope_x**2 + slope_y**2)
    trusted = np.isfinite(depth.z_m) & (n_z > STEEPEST)  # NaN is not larger
    if depth.wrapped is not None:
        trusted &= ~depth.wrapped
    row, column = np.nonzero(trusted)
    block = _blocks(depth.x_m[column], depth.y_m[row])
    if len(row) < FEWEST_PIXELS or block.max() + 1 < FEWEST_BLOCKS:
        raise HandbenchError(
            f"refine: mesh and depth map share {len(row)} pixels that are not steep, in {block.max() + 1} cells of "
            f"{1e3 * BLOCK_M:.0f} mm; expected {FEWEST_PIXELS} in {FEWEST_BLOCKS} or more: check --transform, and that "
            "both show the same object"
        )
    points_m = np.stack([depth.x_m[column], depth.y_m[row], z_m[row, column]], axis=1).astype(np.float64)
    n_z, slope = n_z[row, column], np.stack([slope_x[row, column], slope_y[row, column]])
    normal = np.stack([-slope[0] * n_z, -slope[1] * n_z, n_z], axis=1)
    centre_m = points_m.mean(axis=0)
    radius_m = float(np.sqrt(((points_m - centre_m) ** 2).sum(axis=1).mean()))
    jacobian = np.einsum("ni,nij->nj", normal, perturbation_jacobian(points_m - centre_m)[:, :, :6])
    jacobian[:, 3:] /= radius_m
    distance_m = (depth.z_m[row, column] - points_m[:, 2]) * n_z
    return _Pixels(np.flatnonzero(trusted), block, distance_m, jacobian, centre_m, radius_m)


def _tukey(distance_m: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Tukey's weights ψ(e)/e and slopes ψ'(e), both [n], for the scale that the median of |e| gives: about zero, so
    that a start far off loses nothing."""
    scale_m = max(1.4826 * float(np.median(np.abs(distance_m))), FINEST_M)
    u2 = np.minimum((distance_m / (TUKEY * scale_m)) ** 2, 1)
    return (1 - u2) ** 2, (1 - u2) * (1 - 5 * u2)


def _directions(jacobian: np.ndarray, weight: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Eigenvectors [6, 6] of the normal matrix, in metres of the pixels' motion, and the condition [6] of each: the
    largest eigenvalue over its own, rising. The surface holds those with a condition up to CONDITION."""
    value, vector = np.linalg.eigh(jacobian.T @ (weight[:, None] * jacobian))
    value, vector = value[::-1], vector[:, ::-1]
    return vector, value[0] / np.maximum(value, 1e-12 * value[0])


def _solve(pixels: _Pixels, weight: np.ndarray, held: np.ndarray) -> np.ndarray:
    """The Gauss–Newton step [6] = [τ, ω·radius_m] within the held directions."""
    jacobian = pixels.jacobian @ held
    normal = jacobian.T @ (weight[:, None] * jacobian)
    return held @ np.linalg.solve(normal, jacobian.T @ (weight * pixels.distance_m))


def _motion(step: np.ndarray, pixels: _Pixels) -> np.ndarray:
    """The step as a 4×4 matrix: a turn about the pixels' centre, then a shift."""
    motion = np.eye(4)
    motion[:3, :3] = Rotation.from_rotvec(step[3:] / pixels.radius_m).as_matrix()
    motion[:3, 3] = pixels.centre_m + step[:3] - motion[:3, :3] @ pixels.centre_m
    return motion


def _covariance(
    pixels: _Pixels,
    weight: np.ndarray,
    curvature: np.ndarray,
    held: np.ndarray,
    free: np.ndarray,
    start: np.ndarray | None,
) -> np.ndarray | None:
    """Covariance [6, 6] of [translation, rotation] about the origin, from the held [6, k] and the free directions:
    M⁻¹ (Σ_b g_b g_bᵀ) M⁻¹ with M = Σ ψ' JᵀJ and one gradient g_b = Σ ψ J per block (Liang & Zeger 1986), times
    b/(b − k) for k unknowns from b blocks. Errors that reach over the blocks' edges make it small: by a fifth in σ
    where they reach as far as a resolution cell, 5 mm."""
    if free.shape[1] and start is None:
        return None
    jacobian = pixels.jacobian @ held
    blocks, unknowns = pixels.block.max() + 1, jacobian.shape[1]
    gradient = np.zeros((blocks, unknowns))
    np.add.at(gradient, pixels.block, (weight * pixels.distance_m)[:, None] * jacobian)
    bread = np.linalg.inv(jacobian.T @ (curvature[:, None] * jacobian))
    to_origin = adjoint(-pixels.centre_m, 6) @ np.diag(np.repeat([1, 1 / pixels.radius_m], 3))  # from [τ, ω·radius_m]
    root = to_origin @ held @ bread @ gradient.T
    covariance: np.ndarray = blocks / (blocks - unknowns) * root @ root.T
    if start is not None:
        unmoved = to_origin @ free @ free.T @ np.linalg.inv(to_origin)
        covariance += unmoved @ start[:6, :6] @ unmoved.T
    return covariance


def _blocks(x_m: np.ndarray, y_m: np.ndarray) -> np.ndarray:
    """The block of BLOCK_M × BLOCK_M [n] that each place (x, y) [n] lies in, numbered from 0."""
    if not len(x_m):
        return np.full(1, -1)
    cell = np.stack([np.floor((axis - axis.min()) / BLOCK_M + 1e-9) for axis in (y_m, x_m)])
    return np.unique(cell, axis=1, return_inverse=True)[1].ravel()


def _name(vector: np.ndarray) -> str:
    """A direction's parts above 0.3, the largest first, as "+0.95 z −0.31 about x"."""
    vector = vector * np.sign(vector[np.abs(vector).argmax()])
    parts = [i for i in np.argsort(-np.abs(vector)) if abs(vector[i]) > 0.3]
    return " ".join(f"{'−' if vector[i] < 0 else '+'}{abs(vector[i]):.2f} {DIRECTIONS[i]}" for i in parts)

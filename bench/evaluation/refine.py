"""Registration of a mesh to a radar depth map, for captures without a calibration target.

Point-to-plane ICP along z (Chen & Medioni 1992): every pixel where both radar and mesh have a depth
gives one distance e = (z_radar − z_mesh)·n_z; rays are cast at the moved mesh again in each step. A
small motion of the mesh, dp = τ + ω×(p − c) about the centre c of the pixels, changes e by −n·dp,
where n = (−∂z/∂x, −∂z/∂y, 1)/√(1 + |∇z|²). The factor n_z lowers the weight of steep surfaces,
whose z changes strongly with any sideways error. Tukey's weights remove outliers.

The errors of the pixels are correlated. At short range, within a resolution cell, the cause is
speckle and the methods' filters; this is visible in the residual distances. At longer range it is a
bias of the radar, which the fit absorbs as motion. The covariance contains both, as Gaussian
functions of the distance between pixels: the first with the strength and range of the residuals,
the second as measured on simulated hands with known pose.

The mesh is aligned to the radar itself, so a bias of the radar becomes part of the motion and
cannot show afterwards. No metric uses this registration; the resulting transform records that it
was refined.
"""

from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from handbench.calibration.transforms import Transform, adjoint, identity, perturbation_jacobian
from handbench.groundtruth.mesh.depth import reference_on_grid
from handbench.groundtruth.mesh.surface import Surface, read_surface
from handbench.radar.data.depthmap import DepthMap, load_depthmap
from handbench.support.errors import HandbenchError

REASON = "aligned to the radar's own depth map: its bias cannot show"
# cosine to z (60°) below which a pixel is left out: its radar cell holds many depths
STEEPEST = 0.5
BLOCK_M = 0.015  # correlation length of the errors: three lateral resolutions
TUKEY = 4.685  # 95 % efficient for Gaussian noise
# scale of the distances below which nothing is an outlier: the ray caster's own error
FINEST_M = 1e-6
# a direction that answers with less than 1/17 of the best one's distance is not held
CONDITION = 300.0
# Gauss–Newton steps at most, and the motion (rms of the pixels) that ends them
STEPS, STILL_M = (60, 1e-6)
LEFT, FASTEST, ROUND = 0.02, 0.95, 6  # standard deviations left to walk that end it; see _left
# over which the left-over distances are asked how far they reach: three cells of a 5 × 5 mm filter
PROBE_M = 0.008
# 1σ of the radar's bias along z, and its reach: measured on simulated hands
BIAS_M, BIAS_REACH_M = (1.2e-4, 0.025)
# of the distances' variance by the fit; more is too small a surface for its cells
MOST_ABSORBED = 0.9
FARTHEST_M, FARTHEST_RAD = 0.015, np.radians(10)  # beyond: another surface is as likely as this one
FEWEST_PIXELS, FEWEST_BLOCKS = 100, 8  # six unknowns want more cells than unknowns that err apart
DIRECTIONS = ("x", "y", "z", "about x", "about y", "about z")


class _Pixels(NamedTuple):
    """The n pixels where both radar and mesh have a depth.
    pixel [n]: flat index on the grid; place_m [2, n]: x and y; distance_m [n]: distance of the
    radar's point from the mesh along the normal, e; jacobian [n, 6]: change of n·dp by a motion [τ,
    ω·radius_m]; centre_m [3], radius_m: centre and root-mean-square extent of the points. All
    lengths are in metres."""

    pixel: np.ndarray
    place_m: np.ndarray
    distance_m: np.ndarray
    jacobian: np.ndarray
    centre_m: np.ndarray
    radius_m: float


def refine_files(depth_file: Path, mesh_file: Path, start: Transform | None = None) -> Transform:
    """Align a mesh file to the file of a depth map. Returns the transform of the mesh into the
    radar frame.
    start: transform with which the alignment begins; None: the mesh is in the radar frame already.
    The entry `refined` of the result describes the alignment and names the depth map."""
    transform = refine(
        read_surface(mesh_file), load_depthmap(depth_file), start or identity("radar")
    )
    return replace(transform, refined={"depth": Path(depth_file).name, **(transform.refined or {})})


def refine(surface: Surface, depth: DepthMap, start: Transform) -> Transform:
    """Find the transform of a mesh into the radar frame, near `start`, with which the mesh fits the
    radar's depths best. The scale is kept.

    The entry `refined` of the result records: the reason; the numbers of pixels, of outliers
    (left_out) and of blocks of 15 × 15 mm that the pixels cover; rms_before_mm and rms_after_mm of
    the distances; the motion as translation_mm [3] and rotation_deg [3] (a rotation vector) about
    centre_mm [3]; the uncertainty; in words, the motions that the surface determines (held) and
    those that it does not (free); and the start.

    The covariance (6×6, for the given scale) contains the scatter of the distances and the typical
    bias of a radar on a hand (BIAS_M, 0.12 mm). A larger bias, for example from a wrong delay, is
    not included. Along free motions the covariance is that of the start; if the start has none, the
    result has none. Raises HandbenchError if radar and mesh have too few pixels in common, if the
    iteration does not converge, or if the mesh moves by more than 15 mm or 10°.
    """
    matrix, walk, left = start.matrix, list[np.ndarray](), np.inf
    while True:
        pixels = _shared(surface, depth, Transform(start.source, "radar", matrix))
        weight, curvature = _tukey(pixels.distance_m)
        vectors, condition = _directions(pixels.jacobian, weight)
        held, free = vectors[:, condition <= CONDITION], vectors[:, condition > CONDITION]
        scatter = _scatter(pixels, weight, curvature, held)
        left = _left([held.T @ step for step in walk], scatter)
        if left < LEFT or len(walk) == STEPS:
            break
        walk.append(_solve(pixels, weight, held))
        matrix = _motion(walk[-1], pixels) @ matrix
    if left > 1:
        raise HandbenchError(
            f"refine: the mesh still moved by {1e3 * np.linalg.norm(walk[-1]):.3f} mm after "
            f"{STEPS} steps, so it cannot be aligned to the depth map; start with a better "
            "transform, or calibrate with a target"
        )
    change = matrix @ np.linalg.inv(start.matrix)
    # of the point that came there
    shift_m = pixels.centre_m - np.linalg.inv(change)[:3] @ [*pixels.centre_m, 1]
    turn_rad = Rotation.from_matrix(change[:3, :3]).as_rotvec()
    shift, turn = float(np.linalg.norm(shift_m)), float(np.linalg.norm(turn_rad))
    if shift > FARTHEST_M or turn > FARTHEST_RAD:
        raise HandbenchError(
            f"refine: would move the mesh by {1e3 * shift:.1f} mm and {np.degrees(turn):.1f}°, "
            f"but only {1e3 * FARTHEST_M:.0f} mm and {np.degrees(FARTHEST_RAD):.0f}° are "
            f"reliable; start with a better transform (--transform), or calibrate "
            "with a target"
        )
    before = _shared(surface, depth, start)
    kept = weight > 0
    _, first, last = np.intersect1d(before.pixel, pixels.pixel[kept], return_indices=True)
    named = [f"{_name(v)} (condition {c:.3g})" for v, c in zip(vectors.T, condition, strict=True)]
    covariance = _covariance(pixels, (1 + left**2) * scatter, held, free, start.covariance)
    moved = Transform(start.source, "radar", matrix, covariance)
    refined = {
        "reason": REASON,
        "pixels": int(kept.sum()),
        "left_out": int((~kept).sum()),
        "blocks": int(_blocks(*pixels.place_m).max() + 1),
        "rms_before_mm": 1e3 * float(np.sqrt((before.distance_m[first] ** 2).mean())),
        "rms_after_mm": 1e3 * float(np.sqrt((pixels.distance_m[kept][last] ** 2).mean())),
        "translation_mm": 1e3 * shift_m,
        "rotation_deg": np.degrees(turn_rad),
        "centre_mm": 1e3 * pixels.centre_m,
        "uncertainty": _uncertainty(moved, pixels, named[held.shape[1] :]),
        "held": named[: held.shape[1]],
        "free": named[held.shape[1] :],
        "start": start.matrix,
    }
    return replace(moved, refined=refined)


def _shared(surface: Surface, depth: DepthMap, radar_from_mesh: Transform) -> _Pixels:
    """Find the pixels where both mesh and depth map have a depth; return their distances and
    derivatives.
    radar_from_mesh: current transform of the mesh. Left out are pixels that may be wrapped in
    phase, steep surface, and silhouettes, where the slope (a central difference) is undefined or a
    jump. Raises HandbenchError if too few pixels remain."""
    if min(depth.z_m.shape) < 3:
        raise HandbenchError(
            f"refine: the depth map has {depth.z_m.shape} pixels; expected at least 3 × 3"
        )
    z_m = reference_on_grid(surface.moved(radar_from_mesh), depth.x_m, depth.y_m).z_m
    slope_y, slope_x = np.gradient(z_m, depth.y_m, depth.x_m)
    n_z = 1 / np.sqrt(1 + slope_x**2 + slope_y**2)
    trusted = np.isfinite(depth.z_m) & (n_z > STEEPEST)  # NaN is not larger
    if depth.wrapped is not None:
        trusted &= ~depth.wrapped
    row, column = np.nonzero(trusted)
    place_m = np.stack([depth.x_m[column], depth.y_m[row]])
    blocks = _blocks(*place_m).max() + 1
    if len(row) < FEWEST_PIXELS or blocks < FEWEST_BLOCKS:
        raise HandbenchError(
            f"refine: mesh and depth map share {len(row)} pixels where the surface is not steep, "
            f"in {blocks} squares of {1e3 * BLOCK_M:.0f} mm; expected at least {FEWEST_PIXELS} "
            f"pixels in {FEWEST_BLOCKS} squares; check --transform, and that both "
            "show the same object"
        )
    points_m = np.stack([*place_m, z_m[row, column]], axis=1).astype(np.float64)
    n_z, slope = n_z[row, column], np.stack([slope_x[row, column], slope_y[row, column]])
    normal = np.stack([-slope[0] * n_z, -slope[1] * n_z, n_z], axis=1)
    centre_m = points_m.mean(axis=0)
    radius_m = float(np.sqrt(((points_m - centre_m) ** 2).sum(axis=1).mean()))
    jacobian = np.einsum("ni,nij->nj", normal, perturbation_jacobian(points_m - centre_m)[:, :, :6])
    jacobian[:, 3:] /= radius_m
    distance_m = (depth.z_m[row, column] - points_m[:, 2]) * n_z
    return _Pixels(np.flatnonzero(trusted), place_m, distance_m, jacobian, centre_m, radius_m)


def _tukey(distance_m: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Compute Tukey's weights ψ(e)/e and slopes ψ'(e) for distances e [n], metres. Both are [n].
    The scale is 1.4826 times the median of |e|, taken about zero so that a distant start does not
    make all pixels outliers."""
    scale_m = max(1.4826 * float(np.median(np.abs(distance_m))), FINEST_M)
    u2 = np.minimum((distance_m / (TUKEY * scale_m)) ** 2, 1)
    return (1 - u2) ** 2, (1 - u2) * (1 - 5 * u2)


def _directions(jacobian: np.ndarray, weight: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Find which rigid motions the surface determines: eigenvectors [6, 6] of the normal matrix, as
    columns, and their condition numbers [6], ascending.
    jacobian [n, 6], weight [n]: derivatives and weights of the pixels' distances. A condition
    number is the largest eigenvalue divided by that of the vector; up to 300 (CONDITION), the
    surface determines the motion. The size of a motion is how far it moves the pixels, metres."""
    value, vector = np.linalg.eigh(jacobian.T @ (weight[:, None] * jacobian))
    value, vector = value[::-1], vector[:, ::-1]
    return vector, value[0] / np.maximum(value, 1e-12 * value[0])


def _solve(pixels: _Pixels, weight: np.ndarray, held: np.ndarray) -> np.ndarray:
    """Return the Gauss–Newton step [6] = [τ, ω·radius_m], metres, that reduces the pixels'
    distances.
    weight [n]: weights of the pixels; held [6, k]: the directions that the surface determines, to
    which the step is restricted."""
    jacobian = pixels.jacobian @ held
    normal = jacobian.T @ (weight[:, None] * jacobian)
    return held @ np.linalg.solve(normal, jacobian.T @ (weight * pixels.distance_m))


def _motion(step: np.ndarray, pixels: _Pixels) -> np.ndarray:
    """Return a step [τ, ω·radius_m] as a 4×4 matrix: a rotation about the centre of the pixels,
    followed by a translation."""
    motion = np.eye(4)
    motion[:3, :3] = Rotation.from_rotvec(step[3:] / pixels.radius_m).as_matrix()
    motion[:3, 3] = pixels.centre_m + step[:3] - motion[:3, :3] @ pixels.centre_m
    return motion


def _scatter(
    pixels: _Pixels, weight: np.ndarray, curvature: np.ndarray, held: np.ndarray
) -> np.ndarray:
    """Compute the covariance [k, k] of the fitted motion along the directions that the surface
    determines, held [6, k].
    It is M⁻¹ (s² Σ J_i J_jᵀ ρ(r_ij; ℓ) + β² Σ b_i b_jᵀ ρ(r_ij; L)) M⁻¹ (Conley 1999), summed over
    all pairs of pixels, with M = Σ ψ' JᵀJ, b = w·n_z·J, and the correlation ρ(r; ℓ) = exp(−r²/2ℓ²).
    e [n] is the residual along z, J its derivative by the motion, n_z the
    z component of the unit normal, r_ij the distance between two pixels. weight [n] is w, curvature
    [n] is ψ'.
    s² is the mean square of u = w·e, divided by the share of it that the fit has not absorbed. ℓ
    follows from τ, the mean of u_i u_j/s² over the pairs with weights ρ(r_ij; q): ℓ² = q²τ/(1 − τ),
    since the integral of ρ(r; ℓ)ρ(r; q) gives τ = ℓ²/(ℓ² + q²). β is the radar's bias (BIAS_M), L
    its correlation length (BIAS_REACH_M), and q a fixed length (PROBE_M)."""
    jacobian, left_m = pixels.jacobian @ held, weight * pixels.distance_m
    variance_m2 = float((left_m**2).mean()) + FINEST_M**2
    probed_m2 = _paired(left_m[:, None], pixels, PROBE_M) / _paired(
        np.ones((len(left_m), 1)), pixels, PROBE_M
    )
    shared = np.clip(float(probed_m2[0, 0]) / variance_m2, 1e-3, MOST_ABSORBED)
    cells = _paired(jacobian, pixels, PROBE_M * np.sqrt(shared / (1 - shared)))
    bread = np.linalg.inv(jacobian.T @ (curvature[:, None] * jacobian))
    absorbed = np.clip(np.trace(bread @ cells) / len(left_m), 0, MOST_ABSORBED)
    bias = BIAS_M**2 * _paired(
        (weight * pixels.jacobian[:, 2])[:, None] * jacobian, pixels, BIAS_REACH_M
    )
    scatter: np.ndarray = bread @ (variance_m2 / (1 - absorbed) * cells + bias) @ bread
    return scatter


def _paired(values: np.ndarray, pixels: _Pixels, reach_m: float) -> np.ndarray:
    """Compute Σ v_i v_jᵀ exp(−r_ij²/2ℓ²) [k, k] over all pairs of pixels, where r_ij is their
    distance and ℓ is reach_m.
    values [n, k]: the vectors v. The Gaussian is applied along y, then along x."""
    (x_m, column), (y_m, row) = (np.unique(axis, return_inverse=True) for axis in pixels.place_m)
    grid = np.zeros((values.shape[1], len(y_m), len(x_m)))
    grid[:, row, column] = values.T
    near_y, near_x = (np.exp(-(((a[:, None] - a) / reach_m) ** 2) / 2) for a in (y_m, x_m))
    return np.einsum("iyx,jyx->ij", grid, near_y @ grid @ near_x)


def _left(walk: list[np.ndarray], scatter: np.ndarray) -> float:
    """Estimate how far the iteration still has to move the mesh, in standard deviations of the fit.
    walk: the steps so far; scatter: covariance of the fit. If a motion a was followed by a motion
    b, there remain |b|²/(|a| − |b|) (Aitken). This is evaluated for single steps and for sums of
    six steps (ROUND); the sums detect an iteration that circles because pixels at outlines come and
    go. The smaller estimate is returned; 0 once a step is below 1 µm (STILL_M)."""
    left = 0.0 if walk and np.linalg.norm(walk[-1]) < STILL_M else np.inf
    for stride in (1, ROUND):
        if len(walk) >= 2 * stride:
            motions = np.sum(walk[-stride:], axis=0), np.sum(walk[-2 * stride : -stride], axis=0)
            last, before = (float(np.sqrt(m @ np.linalg.solve(scatter, m))) for m in motions)
            rate = min(last / max(before, 1e-300), FASTEST)
            left = min(left, last * rate / (1 - rate))
    return left


def _covariance(
    pixels: _Pixels,
    scatter: np.ndarray,
    held: np.ndarray,
    free: np.ndarray,
    start: np.ndarray | None,
) -> np.ndarray | None:
    """Compute the covariance [6, 6] of [translation, rotation] about the origin.
    Along the directions that the surface determines, held [6, k], it is that of the fit, scatter
    [k, k]. Along the others, free [6, 6 − k], it is that of the start. None if there are free
    directions and the start has no covariance."""
    if free.shape[1] and start is None:
        return None
    # from [τ, ω·radius_m]
    to_origin = adjoint(-pixels.centre_m) @ np.diag(np.repeat([1, 1 / pixels.radius_m], 3))
    covariance: np.ndarray = to_origin @ held @ scatter @ held.T @ to_origin.T
    if start is not None:
        unmoved = to_origin @ free @ free.T @ np.linalg.inv(to_origin)
        covariance += unmoved @ start[:6, :6] @ unmoved.T
    return covariance


def _uncertainty(moved: Transform, pixels: _Pixels, free: list[str]) -> str:
    """Return a sentence with the standard deviations at the centre of the pixels, or with the
    reason why there are none.
    free: names of the directions that the surface does not determine."""
    if moved.covariance is None:
        return (
            f"no covariance: the surface does not hold {', '.join(free)}, and the start "
            "states no error along it"
        )
    sigmas = (
        1e3 * np.diag(moved.point_covariance(pixels.centre_m)) ** 0.5,
        np.degrees(np.diag(moved.covariance) ** 0.5),
    )
    mm, degrees = (" × ".join(f"{sigma:.2f}" for sigma in three[-3:]) for three in sigmas)
    return (
        f"one σ at the surface's middle {mm} mm, {degrees}° (x × y × z), if the radar errs as "
        "it does on hands"
    )


def _blocks(x_m: np.ndarray, y_m: np.ndarray) -> np.ndarray:
    """Return for each place (x, y) the number of the square of 15 × 15 mm (BLOCK_M) that contains
    it: [n], from 0. The array [−1] if there are no places."""
    if not len(x_m):
        return np.full(1, -1)
    cell = np.stack([np.floor((axis - axis.min()) / BLOCK_M + 1e-9) for axis in (y_m, x_m)])
    return np.unique(cell, axis=1, return_inverse=True)[1].ravel()


def _name(vector: np.ndarray) -> str:
    """Describe a direction of motion [6] by its components above 0.3, the largest first, such as
    "+0.95 z −0.31 about x"."""
    vector = vector * np.sign(vector[np.abs(vector).argmax()])
    parts = [i for i in np.argsort(-np.abs(vector)) if abs(vector[i]) > 0.3]
    return " ".join(
        f"{'−' if vector[i] < 0 else '+'}{abs(vector[i]):.2f} {DIRECTIONS[i]}" for i in parts
    )

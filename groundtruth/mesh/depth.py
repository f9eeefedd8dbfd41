"""Depth of a surface on the radar's pixel grid: the reference for the radar's depth maps."""

from typing import NamedTuple

import numpy as np

from handbench.calibration.transforms import Transform, perturbation_jacobian
from handbench.groundtruth.mesh.surface import Surface
from handbench.support.errors import HandbenchError
from handbench.support.rays import embree

CLEARANCE_M = 1e-3
# largest extent in x, y and z, for which single precision has errors below 0.06 mm
LARGEST_M = np.array([50.0, 50.0, 250.0])
EDGE_ON = 1e-4  # triangles whose normal has a smaller cosine to z are ignored by rays along z
# least cosine between a surface's normal and z in the conversion of its uncertainty
STEEPEST = 0.1


class Reference(NamedTuple):
    """Reference depth z_m [ny, nx] of a surface on the radar's grid, metres, with its uncertainty
    along z; NaN where there is no observed surface.

    mesh_sigma_m [ny, nx]: standard deviation from the errors of the mesh, NaN if unknown.
    registration: the transform that moved the surface to the radar frame; its error is common to
    all pixels. leverage [ny, nx, 6 or 7]: derivatives of the depth with respect to the transform's
    parameters. Both are None if the transform's covariance is unknown. met [ny, nx]: True where a
    ray along z meets any surface, observed or interpolated (None: unknown). velocity_m_s [ny, nx]:
    radial velocity of the surface, positive away from the radar frame's origin (None: unknown).
    """

    z_m: np.ndarray
    mesh_sigma_m: np.ndarray
    leverage: np.ndarray | None
    registration: Transform | None
    met: np.ndarray | None = None
    velocity_m_s: np.ndarray | None = None

    @property
    def registration_sigma_m(self) -> np.ndarray:
        """Standard deviation [ny, nx] of the depth from the uncertainty of the registration,
        metres; NaN if unknown. It is √(g·C·gᵀ), with the depth's derivatives g (leverage) and the
        registration's covariance C."""
        if self.leverage is None or self.registration is None:
            return np.full(self.z_m.shape, np.nan)
        variance = np.einsum(
            "yxi,yxi->yx", self.leverage @ self.registration.require_covariance(), self.leverage
        )
        # rounding may leave a covariance not quite positive
        return np.sqrt(np.maximum(variance, 0))

    @property
    def sigma_m(self) -> np.ndarray:
        """Standard deviation [ny, nx] of the depth, metres, from the errors of mesh and
        registration, which are independent; NaN if either is unknown."""
        return np.hypot(self.mesh_sigma_m, self.registration_sigma_m)


def reference_on_grid(
    surface: Surface, x_m: np.ndarray, y_m: np.ndarray, registration: Transform | None = None
) -> Reference:
    """Compute the orthographic depth of a surface in the radar frame, seen from −z, at the columns
    x_m [nx] and rows y_m [ny], with its uncertainty. The depth is NaN where a ray along +z meets no
    surface, or interpolated surface first; triangles parallel to the ray are ignored. The ray
    caster works in single precision: rays start just in front of the mesh, and the depth is
    recomputed in double precision on the triangle that was hit.

    registration: the transform that moved the surface to the radar frame; its covariance enters the
    uncertainty. When a surface with normal n moves by δ, the depth of a pixel changes by n·δ/n_z.
    So an error σ along the normal gives σ/|n_z|, and an error ξ of the registration's parameters
    gives n·J(p)·ξ/n_z to first order, with the Jacobian J at the point p. The radial velocity at p
    is v·p/|p|, with the velocity v of the surface there. Raises HandbenchError for an implausibly
    large surface, e.g. one in millimetres.
    """
    met, triangle = _cast(surface.vertices_m, surface.faces, x_m, y_m)
    faces = surface.faces[triangle]
    seen = surface.observed[faces].all(axis=1)
    hit, faces = _spread(met, seen, False), faces[seen]
    x, y = (axis[hit] for axis in np.meshgrid(x_m, y_m))
    corners = surface.vertices_m[faces]
    z, normal = _interpolate(corners[..., 2:], corners, x, y)[:, 0], _normal(corners)
    least = STEEPEST * np.linalg.norm(normal, axis=1, keepdims=True)
    # n/n_z, ≤ 1/STEEPEST long
    slant = normal / np.copysign(np.maximum(np.abs(normal[:, 2:]), least), normal[:, 2:])
    mesh_sigma_m = surface.sigma_m[faces].mean(axis=1) * np.linalg.norm(slant, axis=1)
    points_m = np.stack([x, y, z], axis=1)
    found = Reference(_spread(hit, z, np.nan), _spread(hit, mesh_sigma_m, np.nan), None, None, met)
    if surface.velocity_m_s is not None:
        v_m_s = _interpolate(surface.velocity_m_s[faces], corners, x, y)
        radial_m_s = (v_m_s * points_m).sum(axis=1) / np.linalg.norm(points_m, axis=1)
        found = found._replace(velocity_m_s=_spread(hit, radial_m_s, np.nan))
    if registration is None or registration.covariance is None:
        return found
    leverage = np.einsum("ni,nij->nj", slant, perturbation_jacobian(points_m))
    return found._replace(leverage=_spread(hit, leverage, np.nan), registration=registration)


def _cast(
    vertices_m: np.ndarray, faces: np.ndarray, x_m: np.ndarray, y_m: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Cast a ray along +z at each point of the grid.

    Returns the mask [ny, nx] of the rays that meet a triangle and, for these rays in the mask's
    order, the index [n] of the first triangle. Raises HandbenchError for an implausibly large mesh.
    """
    # A triangle parallel to the rays has no depth: rounding would choose it before its neighbours,
    # at any z.
    normal = _normal(vertices_m[faces])
    shown = np.flatnonzero(np.abs(normal[:, 2]) > EDGE_ON * np.linalg.norm(normal, axis=1))
    used_m = vertices_m[faces[shown].ravel()]
    if len(shown) == 0:
        return np.zeros((len(y_m), len(x_m)), bool), shown
    spans_m = np.ptp(used_m, axis=0)
    if (spans_m > LARGEST_M).any():
        raise HandbenchError(
            f"mesh: is {spans_m.max():.3g} m long; expected at most {LARGEST_M.min():g} m; if it "
            "is in millimetres, convert it with `handbench groundtruth --unit mm`"
        )
    # In single precision, coordinates are relative to the middle of the grid and the front of the
    # mesh.
    origin_m = np.array([np.mean(x_m), np.mean(y_m), used_m[:, 2].min()])
    rays = np.zeros((len(y_m), len(x_m), 6), np.float32)
    rays[..., 0], rays[..., 1] = np.meshgrid(x_m - origin_m[0], y_m - origin_m[1])
    rays[..., 2] = -CLEARANCE_M
    rays[..., 5] = 1
    found = embree(vertices_m - origin_m, faces[shown]).cast_rays(rays)
    hit = np.isfinite(found["t_hit"].numpy())
    return hit, shown[found["primitive_ids"].numpy().astype(np.int64)[hit]]


def _normal(corners: np.ndarray) -> np.ndarray:
    """Compute the normals [n, 3] of triangles [n, 3, 3]; each is twice the triangle's area long."""
    return np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])


def _spread(hit: np.ndarray, values: np.ndarray, elsewhere: float) -> np.ndarray:
    """Make a map [ny, nx, ...] that has `values` [n, ...] at the n pixels where the mask `hit` [ny,
    nx] is True, and `elsewhere` at all other pixels."""
    grid = np.full((*hit.shape, *values.shape[1:]), elsewhere)
    grid[hit] = values
    return grid


def _interpolate(
    values: np.ndarray, corners: np.ndarray, x: np.ndarray, y: np.ndarray
) -> np.ndarray:
    """Interpolate the values [n, 3, k] at the corners [n, 3, 3] of triangles linearly to the points
    (x, y) [n], seen along z; returns [n, k].

    The result is limited to the range of the corners' values, since rounding errors are large on
    steep triangles.
    """
    to_corner = corners[..., :2] - np.stack([x, y], axis=1)[:, None]
    following, last = (np.roll(to_corner, -shift, axis=1) for shift in (1, 2))
    # the area of the triangle of the point and the two other corners
    weight = following[..., 0] * last[..., 1] - following[..., 1] * last[..., 0]
    mean = np.einsum("nc,nck->nk", weight / weight.sum(axis=1, keepdims=True), values)
    return np.clip(mean, values.min(axis=1), values.max(axis=1))

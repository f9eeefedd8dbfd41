"""Triangles of a plane and of a sphere, whose depth is known in closed form, and what their cases share."""

import numpy as np

from groundtruth.mesh.depth import reference_on_grid
from groundtruth.mesh.surface import Surface

SLOPES, DEPTH_M = np.array([0.5, -0.3]), 0.3


def between(cells: int, half_m: float) -> np.ndarray:
    """Middles [cells] of as many steps from −half_m to half_m."""
    return np.convolve(np.linspace(-half_m, half_m, cells + 1), [0.5, 0.5], "valid")


def on_plane(xy_m: np.ndarray, slopes: np.ndarray = SLOPES) -> np.ndarray:
    """Vertices [n, 3] of the plane z = 0.3 m + slopes·xy above xy_m [n, 2]."""
    return np.column_stack([xy_m, DEPTH_M + xy_m @ slopes])


def sheet(cells: int, half_m: float = 0.1, slopes: np.ndarray = SLOPES) -> tuple[np.ndarray, np.ndarray]:
    """A square of the plane as cells² squares of two triangles: vertices [n, 3], faces [m, 3]."""
    x, y = np.meshgrid(*[np.linspace(-half_m, half_m, cells + 1)] * 2)
    corner = np.arange(cells * (cells + 1)).reshape(cells, cells + 1)[:, :-1].ravel()
    right, up = 1, cells + 1
    faces = [
        np.stack([corner, corner + right + up, corner + up], 1),
        np.stack([corner, corner + right, corner + right + up], 1),
    ]
    return on_plane(np.stack([x.ravel(), y.ravel()], 1), slopes), np.concatenate(faces)


def ball(
    rings: int, radius_m: float = 0.05, centre_m: tuple[float, float, float] = (0, 0, DEPTH_M)
) -> tuple[np.ndarray, np.ndarray]:
    """A sphere of `rings` rings of 2·rings quadrangles, the poles along z."""
    polar = np.linspace(0, np.pi, rings + 1)[:, None]
    around = np.arange(2 * rings) * np.pi / rings
    sine = np.sin(polar)
    sine[-1] = 0.0  # sin π is 1e-16 in double: a hole at the pole, which single precision finds
    axes = sine * np.cos(around), sine * np.sin(around), np.cos(polar) + 0 * around
    ring, place = np.meshgrid(np.arange(rings), np.arange(2 * rings), indexing="ij")
    here, beside = (ring * 2 * rings + p for p in (place, (place + 1) % (2 * rings)))
    quads = np.stack([here, here + 2 * rings, beside + 2 * rings, beside], -1).reshape(-1, 4)
    faces = np.concatenate([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]])
    return radius_m * np.stack(axes, -1).reshape(-1, 3) + centre_m, faces


def surface(vertices_m: np.ndarray, faces: np.ndarray) -> Surface:
    """As the product takes it: known without error, and seen everywhere."""
    return Surface(
        np.asarray(vertices_m, float), np.asarray(faces), np.zeros(len(vertices_m)), np.ones(len(vertices_m), bool)
    )


def depth(vertices_m: np.ndarray, faces: np.ndarray, x_m: np.ndarray, y_m: np.ndarray) -> np.ndarray:
    """The product's depth of triangles on a grid [ny, nx]."""
    return reference_on_grid(surface(vertices_m, faces), np.atleast_1d(x_m), np.atleast_1d(y_m)).z_m


def plane_error_m(z_m: np.ndarray, x_m: np.ndarray, y_m: np.ndarray, slopes: np.ndarray = SLOPES) -> float:
    """Largest error of depths [ny, nx] of the plane; infinite where one is missing."""
    x, y = np.meshgrid(x_m, y_m)
    error = np.abs(z_m - (DEPTH_M + slopes[0] * x + slopes[1] * y))
    return float(np.where(np.isnan(error), np.inf, error).max())

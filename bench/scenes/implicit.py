"""Implicit surfaces, given by signed distances: primitives, smooth unions, and the zero set as a
mesh of well-shaped triangles."""

import math
from collections.abc import Callable

import numpy as np
from numpy.typing import ArrayLike

from handbench.support.compiled import FAST, njit
from handbench.support.parallel import for_each

# points [n, 3] to signed distances [n], metres, negative inside
Field = Callable[[np.ndarray], np.ndarray]

CHUNK = 8192  # points that fit the cache together with the temporaries of one primitive
COARSE = 3  # steps of the lattice between the places at which it is computed first
NEAR = 1.2  # of those: values below this are computed
STEP = 1.07  # of the lattice, in edges of the relaxed triangles
SMOOTHINGS = 3  # of all vertices
RELAXATIONS = 4  # of triangles in narrow grooves; more do not help
SLIVER = 0.3
NEWTON_STEPS = 20  # three suffice but at the groove between touching bodies
ON_SURFACE_M = 5e-7
DIFFERENCE_M = 2e-6


def round_cone(
    start_m: ArrayLike, end_m: ArrayLike, start_radius_m: float, end_radius_m: float
) -> Field:
    """Return the exact signed distance to a round cone, as a function of points [n, 3].

    A round cone is the convex hull of two spheres, given by their centres [3] and radii; neither
    contains the other.
    """
    start = np.asarray(start_m, np.float64)
    axis = np.asarray(end_m, np.float64) - start
    length = float(np.linalg.norm(axis))
    unit = axis / length
    sine = (start_radius_m - end_radius_m) / length
    assert abs(sine) < 1  # neither sphere contains the other
    slope = float(sine / np.sqrt(1 - sine**2))

    return lambda points: _to_cone(points, start, unit, length, slope, sine, start_radius_m)


@njit(**FAST)
def _to_cone(points, start, unit, length, slope, sine, radius_m):  # type: ignore[no-untyped-def]
    """Compute the signed distance [n] of points [n, 3] to a round cone.

    start [3], radius_m: the first sphere. unit [3], length: direction and distance to the second
    sphere's centre. sine, slope: sine and tangent of half the cone's opening angle.
    """
    distance = np.empty(len(points))
    for n in range(len(points)):
        x, y, z = points[n, 0] - start[0], points[n, 1] - start[1], points[n, 2] - start[2]
        along = x * unit[0] + y * unit[1] + z * unit[2]
        across = math.sqrt(max(x * x + y * y + z * z - along * along, 0.0))
        # The nearest sphere of the hull is the one whose centre the cone's normal through the point
        # meets.
        centre = min(max(along - across * slope, 0.0), length)
        off = along - centre
        distance[n] = math.sqrt(off * off + across * across) - (radius_m - sine * centre)
    return distance


def smooth_minimum(a: np.ndarray, b: np.ndarray, blend_m: float | np.ndarray) -> np.ndarray:
    """Return min(a, b) with a smooth transition. Applied to the distances to two bodies, it joins
    the bodies with a fillet.

    The result equals min(a, b) where |a − b| > blend_m; it is cubic in between, with two continuous
    derivatives.
    """
    h = np.maximum(blend_m - np.abs(a - b), 0) / blend_m
    return np.minimum(a, b) - h * h * h * blend_m / 6


def smooth_union(fields: list[Field], blend_m: float) -> Field:
    """Return the signed distance to several bodies together, as a function of points. fields:
    signed distances to the bodies; blend_m: width of the fillets that join them."""

    def distance(points: np.ndarray) -> np.ndarray:
        result = fields[0](points)
        for field in fields[1:]:
            result = smooth_minimum(result, field(points), blend_m)
        return result

    return distance


def evaluate(field: Field, points_m: np.ndarray) -> np.ndarray:
    """Evaluate a signed distance at points [n, 3] on all cores. Returns values [n], metres."""
    points_m, values = np.ascontiguousarray(points_m), np.empty(len(points_m))

    def work(start: int) -> None:
        values[start : start + CHUNK] = field(points_m[start : start + CHUNK])

    for_each(work, range(0, len(points_m), CHUNK))
    return values


def project(field: Field, points_m: np.ndarray) -> np.ndarray:
    """Move points [n, 3] that are near the zero set of a signed distance onto the zero set, along
    the gradient (Newton's method). Returns the moved points."""
    points_m = points_m.copy()
    off = np.arange(len(points_m))
    for _ in range(NEWTON_STEPS):
        values = evaluate(field, points_m[off])
        beside = np.abs(values) > ON_SURFACE_M
        off, values = off[beside], values[beside]
        steps = (evaluate(field, points_m[off] + step) for step in DIFFERENCE_M * np.eye(3))
        slope = np.stack([(value - values) / DIFFERENCE_M for value in steps], axis=1)
        # a flat spot must throw no point far away
        steepness = np.maximum(np.einsum("ij,ij->i", slope, slope), 0.05)
        points_m[off] -= (values / steepness)[:, None] * slope
    return points_m


def lattice(field: Field, lower_m: np.ndarray, upper_m: np.ndarray, step_m: float) -> np.ndarray:
    """Evaluate a signed distance on a regular grid with step step_m from lower_m [3] to at least
    upper_m [3].

    Returns values [nx, ny, nz]. To save time, they are exact near the zero set only, and
    interpolated from a coarser grid elsewhere.
    """
    coarse_m = COARSE * step_m
    shape = np.ceil((upper_m - lower_m) / coarse_m).astype(int) + 1
    places = np.indices(tuple(shape)).reshape(3, -1).T
    values = evaluate(field, lower_m + coarse_m * places).reshape(shape)
    for count in shape:  # linear interpolation along x, y and z in turn
        fine = np.arange(COARSE * (count - 1) + 1) / COARSE
        share = np.maximum(1 - np.abs(fine[:, None] - np.arange(count)), 0)
        values = np.tensordot(values, share, (0, 1))
    near = np.argwhere(np.abs(values) < NEAR * coarse_m)
    values[tuple(near.T)] = evaluate(field, lower_m + step_m * near)
    return values


def zero_set(
    field: Field, lower_m: np.ndarray, upper_m: np.ndarray, edge_m: float
) -> tuple[np.ndarray, np.ndarray]:
    """Compute the surface on which a signed distance is zero, as vertices [n, 3] and outward
    triangles [m, 3] with edges of about edge_m. Of several surfaces, the one with more than half
    of the triangles counts.

    lower_m, upper_m [3]: corners of a box around the surface. After marching cubes, every vertex is
    moved to the mean of its neighbours a few times, which makes the triangles even, and back onto
    the zero set. Triangles that are slivers or folded then, in narrow grooves, are treated so a few
    times more.
    """
    from scipy import sparse
    from skimage import measure

    marching_cubes: Callable[..., tuple[np.ndarray, ...]] = measure.marching_cubes
    step_m = STEP * edge_m
    values = lattice(field, lower_m, upper_m, step_m)
    corners, faces, _, _ = marching_cubes(values, 0.0, gradient_direction="descent")
    corners, faces = largest(corners.astype(np.float64), faces)
    # each edge of a closed mesh is met once in either direction
    ends = faces.T.ravel(), np.roll(faces, -1, axis=1).T.ravel()
    joined = sparse.coo_array((np.ones(len(ends[0])), ends), (len(corners),) * 2).tocsr()
    mean = sparse.diags_array(1 / joined.sum(axis=1)) @ joined
    vertices_m = lower_m + step_m * corners
    for _ in range(SMOOTHINGS):
        vertices_m = mean @ vertices_m
    vertices_m = project(field, vertices_m)
    for _ in range(RELAXATIONS):
        crooked = np.unique(faces[triangle_quality(vertices_m[faces]) < SLIVER])
        if len(crooked) == 0:
            break
        vertices_m[crooked] = project(field, mean[crooked] @ vertices_m)
    return vertices_m, faces


def largest(vertices: np.ndarray, faces: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the vertices [n, 3] and triangles [m, 3] of the piece of a mesh with more than half
    of the triangles."""
    import pymeshlab

    pieces = pymeshlab.MeshSet(verbose=False)
    pieces.add_mesh(pymeshlab.Mesh(vertices, faces))
    pieces.meshing_remove_connected_component_by_face_number(mincomponentsize=len(faces) // 2)
    piece = pieces.current_mesh()
    return piece.vertex_matrix(), piece.face_matrix()


def triangle_quality(triangles_m: np.ndarray) -> np.ndarray:
    """Compute the shape quality [n] of triangles [n, 3, 3]: 4·√3·area over the sum of squared
    edges, which is 1 for an equilateral triangle and 0 for a degenerate one."""
    edges_m = np.roll(triangles_m, -1, axis=1) - triangles_m
    twice_area = np.linalg.norm(np.cross(edges_m[:, 0], edges_m[:, 1]), axis=1)
    return 2 * np.sqrt(3) * twice_area / (edges_m**2).sum(axis=(1, 2))

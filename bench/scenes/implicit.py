"""Implicit surfaces, given by signed distances: primitives, smooth unions, and the zero set as a
mesh of well-shaped triangles."""

from collections.abc import Callable

import numpy as np
from numpy.typing import ArrayLike

from handbench.support.compiled import njit
from handbench.support.parallel import for_each

# points [n, 3] to signed distances [n], metres, negative inside
Field = Callable[[np.ndarray], np.ndarray]

CHUNK = 32_768  # points that fit the cache together with the temporaries of one primitive
NEWTON_STEPS = 20  # three suffice but at the groove between touching bodies
RELAXATIONS = 12  # two suffice but for a few folds
SLIVER = 0.3
ON_SURFACE_M = 1e-7
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


@njit(nogil=True, cache=True)
def _to_cone(
    points: np.ndarray,
    start: np.ndarray,
    unit: np.ndarray,
    length: float,
    slope: float,
    sine: float,
    radius_m: float,
) -> np.ndarray:
    """Compute the signed distance [n] of points [n, 3] to a round cone (convex hull of two
    spheres).

    start [3], radius_m: the first sphere. unit [3], length: direction and distance to the second
    sphere's centre. sine, slope: sine and tangent of half the cone's opening angle.
    """
    distance = np.empty(len(points))
    for n in range(len(points)):
        x, y, z = points[n, 0] - start[0], points[n, 1] - start[1], points[n, 2] - start[2]
        along = x * unit[0] + y * unit[1] + z * unit[2]
        across = np.sqrt(max(x * x + y * y + z * z - along * along, 0.0))
        # The nearest sphere of the hull is the one whose centre the cone's normal through the point
        # meets.
        centre = min(max(along - across * slope, 0.0), length)
        off = along - centre
        distance[n] = np.sqrt(off * off + across * across) - (radius_m - sine * centre)
    return distance


@njit(nogil=True, cache=True)
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
    values = np.empty(len(points_m))

    def work(start: int) -> None:
        values[start : start + CHUNK] = field(points_m[start : start + CHUNK])

    for_each(work, range(0, len(points_m), CHUNK))
    return values


def gradient(field: Field, points_m: np.ndarray) -> np.ndarray:
    """Compute the gradient [n, 3] of a signed distance at points [n, 3], by central differences."""
    steps = DIFFERENCE_M * np.eye(3)
    columns = [evaluate(field, points_m + s) - evaluate(field, points_m - s) for s in steps]
    return np.stack(columns, axis=1) / (2 * DIFFERENCE_M)


def project(field: Field, points_m: np.ndarray) -> np.ndarray:
    """Move points [n, 3] that are near the zero set of a signed distance onto the zero set, along
    the gradient (Newton's method). Returns the moved points."""
    points_m = points_m.copy()
    off = np.arange(len(points_m))
    for _ in range(NEWTON_STEPS):
        values = evaluate(field, points_m[off])
        beside = np.abs(values) > ON_SURFACE_M
        off, values = off[beside], values[beside]
        slope = gradient(field, points_m[off])
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
    from scipy.ndimage import zoom

    coarse = 3
    shape = np.ceil((upper_m - lower_m) / (coarse * step_m)).astype(int) + 1
    places = np.indices(tuple(shape)).reshape(3, -1).T
    rough = evaluate(field, lower_m + coarse * step_m * places).reshape(shape)
    values = zoom(rough, (coarse * (shape - 1) + 1) / shape, order=1, grid_mode=False)
    near = np.argwhere(np.abs(values) < 2.5 * coarse * step_m)
    values[tuple(near.T)] = evaluate(field, lower_m + step_m * near)
    return values


def zero_set(
    field: Field, lower_m: np.ndarray, upper_m: np.ndarray, edge_m: float
) -> tuple[np.ndarray, np.ndarray]:
    """Compute the surface on which a signed distance is zero, as vertices [n, 3] and outward
    triangles [m, 3] with edges of about edge_m.

    lower_m, upper_m [3]: corners of a box around the surface. Marching cubes are followed by
    remeshing to even triangles, and every vertex is moved onto the zero set. Narrow grooves can
    leave slivers or folded triangles: then vertices are moved to the mean of their neighbours and
    back onto the zero set, until all triangles are well shaped.
    """
    from skimage import measure

    marching_cubes: Callable[..., tuple[np.ndarray, ...]] = measure.marching_cubes
    step_m = 0.9 * edge_m
    values = lattice(field, lower_m, upper_m, step_m)
    vertices, faces, _, _ = marching_cubes(values, 0.0, gradient_direction="descent")
    vertices, faces = remesh(lower_m + step_m * vertices.astype(np.float64), faces, edge_m)
    vertices = project(field, vertices)
    for _ in range(RELAXATIONS):
        vertices = project(field, neighbour_mean(vertices, faces))
        if triangle_quality(vertices[faces]).min() > SLIVER:
            break
    return vertices, faces


def triangle_quality(triangles_m: np.ndarray) -> np.ndarray:
    """Compute the shape quality [n] of triangles [n, 3, 3]: 4·√3·area over the sum of squared
    edges, which is 1 for an equilateral triangle and 0 for a degenerate one."""
    edges_m = np.roll(triangles_m, -1, axis=1) - triangles_m
    twice_area = np.linalg.norm(np.cross(edges_m[:, 0], edges_m[:, 1]), axis=1)
    return 2 * np.sqrt(3) * twice_area / (edges_m**2).sum(axis=(1, 2))


def neighbour_mean(vertices_m: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """Compute, for every vertex of a closed mesh, the mean [n, 3] of the vertices that an edge
    connects to it. vertices_m [n, 3]; faces [m, 3]: vertex indices."""
    # in a closed mesh the triangles' edges run along each edge once per direction
    start, end = faces.T.ravel(), np.roll(faces, -1, axis=1).T.ravel()
    total = np.stack([np.bincount(start, column) for column in vertices_m[end].T], axis=1)
    return total / np.bincount(start)[:, None]


def remesh(
    vertices_m: np.ndarray, faces: np.ndarray, edge_m: float
) -> tuple[np.ndarray, np.ndarray]:
    """Remesh the largest connected part of a mesh with nearly equilateral triangles whose edges are
    about edge_m long. Returns the new vertices [n, 3] and triangles [m, 3]."""
    import pymeshlab

    meshes = pymeshlab.MeshSet(verbose=False)
    meshes.add_mesh(pymeshlab.Mesh(vertices_m, faces))
    meshes.meshing_remove_connected_component_by_face_number(mincomponentsize=len(faces) // 2)
    meshes.meshing_isotropic_explicit_remeshing(
        iterations=6, targetlen=pymeshlab.PureValue(edge_m), adaptive=False, checksurfdist=False
    )
    result = meshes.current_mesh()
    return result.vertex_matrix(), result.face_matrix()

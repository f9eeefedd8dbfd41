"""Hard meshes: grazing planes, slivers, fins, soups, holes, few faces, far origins, stray faces, other units."""

from __future__ import annotations

from itertools import product

import numpy as np
from scipy.spatial.transform import Rotation

from bench.studies.stability import meshes_files as meshes_files
from bench.studies.stability import meshes_rays as meshes_rays
from bench.studies.stability.cases import Seen, Works, case, refusal
from bench.studies.stability.meshes_shapes import DEPTH_M, SLOPES, ball, between, depth, on_plane, plane_error_m, sheet

U = 2.0**-53
GRID_M = np.linspace(-0.09, 0.09, 37)
ROUNDED = "a plane's depth is formed in double on the triangle that is hit: a few 2⁻⁵³ of 0.5 m"
SAGITTA = (
    "corners lie on the sphere, faces within it by r(1 − cos π/√2n) at most for n rings, seen under the "
    "sphere's slope: over its cosine, 0.31 at 0.95 r, and as much again for how the slope changes there"
)


@case("meshes", "grazing planes", "m", 1e-14)
def _grazing() -> Seen:
    """Error of depth, slopes to 10⁴ and past what is shown. Against: the plane; beyond, nothing. Because: {ROUNDED};
    steeper than 10⁴ a triangle is on edge, and no depth of it is told."""
    for slope in (1.0, 1e2, 9e3, 1.1e4, 1e6, 1e8):
        half_m, slopes = 0.1 / slope, np.array([slope, 0.0])
        xy = np.array([[-half_m, -0.1], [half_m, -0.1], [half_m, 0.1], [-half_m, 0.1]])
        z_m = depth(on_plane(xy, slopes), np.array([[0, 1, 2], [0, 2, 3]]), GRID_M / slope, GRID_M)
        beyond = 0.0 if np.isnan(z_m).all() else np.inf
        yield f"slope {slope:g}", beyond if slope > 1e4 else plane_error_m(z_m, GRID_M / slope, GRID_M, slopes)


@case("meshes", "fins that share an edge with a sheet", "m", 1e4 * 2.0**-24 * 0.13)
def _fins() -> Seen:
    """Error of depth where a ray may choose a steep face. Against: the plane. Because: a ray's place rounds by 2⁻²⁴ of
    0.13 m, times the steepest slope that is shown, 10⁴."""
    vertices, faces = sheet(30)
    axis = np.linspace(-0.1, 0.1, 61)[1:-1]  # vertices and middles of edges
    for top_m in ([0, 0, 0.9], [0.01, 0.003, 5.0], [1e-6, 1e-5, 50.0]):
        fins = np.stack([faces[:, 0], faces[:, 1], np.full(len(faces), len(vertices))], 1)  # three faces on an edge
        mesh = np.concatenate([vertices, [top_m]]), np.concatenate([faces, fins])
        yield f"fins up to {top_m}", plane_error_m(depth(*mesh, axis, axis), axis, axis)


@case("meshes", "slivers", "m", 8 * U)
def _slivers() -> Seen:
    """Error of depth on triangles of aspect 10² to 10⁸, over the aspect. Against: the plane. Because: their normal is a
    difference of products that are larger by the aspect: 2⁻⁵³ times it, a few times, over lengths of 0.2 m."""
    for aspect in (1e2, 1e4, 1e6, 1e8):
        height_m, turn = 0.2 / aspect, Rotation.from_euler("z", 30, degrees=True).as_matrix()[:2, :2]
        rows = np.array([-0.1, -height_m / 2, height_m / 2, 0.1])
        xy = np.array([(x, y) for y in rows for x in (-0.1, 0.1)]) @ turn.T
        faces = [[2 * i + a for a in corners] for i in range(3) for corners in ((0, 1, 3), (0, 3, 2))]
        across_m = height_m * np.linspace(-0.45, 0.45, 7)
        places = np.array([(x, y) for x in (-0.06, 0.01, 0.055) for y in across_m]) @ turn.T
        error_m = max(plane_error_m(depth(on_plane(xy), faces, x, y), x, y) for x, y in places)
        yield f"aspect {aspect:g}", error_m / aspect


@case("meshes", "soups, doubles and turned faces", "m", 1e-15)
def _soups() -> Seen:
    """Error of depth of a mesh that no rule of meshes holds for. Against: the plane. Because: {ROUNDED}; which of two
    equal triangles is hit changes nothing."""
    vertices, faces = sheet(30)
    generator = np.random.default_rng(1)
    turned = np.where(generator.random(len(faces))[:, None] < 0.5, faces[:, ::-1], faces)
    corner = np.arange(len(vertices))
    meshes = {
        "half of the faces turned": (vertices, turned),
        "all turned": (vertices, faces[:, ::-1]),
        "every vertex once a face": (vertices[faces.ravel()], np.arange(faces.size).reshape(-1, 3)),
        "every face twice, one turned": (vertices, np.concatenate([faces, faces[:, ::-1]])),
        "faces without area": (vertices, np.concatenate([faces, np.stack([corner] * 3, 1), faces[:, [0, 0, 1]]])),
        "vertices without a face": (np.concatenate([vertices, [[0, 0, -1e6]]]), faces),
    }
    return ((name, plane_error_m(depth(*mesh, GRID_M, GRID_M), GRID_M, GRID_M)) for name, mesh in meshes.items())


@case("meshes", "holes", "pixels", 0.0)
def _holes() -> Seen:
    """Pixels whose depth is invented, lost or of the wrong layer. Against: which squares are left. Because: a ray
    through a hole has no depth, or that of what lies behind."""
    cells = 36
    vertices, faces = sheet(cells, 0.09)
    middles = between(cells, 0.09) + 3e-4  # off the diagonal
    plane = DEPTH_M + SLOPES[0] * middles + SLOPES[1] * middles[:, None]
    for share, behind_m in product((0.01, 0.5, 0.99), (np.nan, 1e-3, 1e-5)):
        kept = np.random.default_rng(2).random(cells**2) >= share
        expected = np.where(kept.reshape(cells, cells), plane, plane + behind_m)
        nothing, left = np.isnan(behind_m), faces[np.tile(kept, 2)]
        both = np.concatenate([vertices, vertices + [0, 0, behind_m]]), np.concatenate([left, faces + len(vertices)])
        z_m = depth(*((vertices, left) if nothing else both), middles, middles)
        place = f"{share:.0%} of the squares missing, {'nothing' if nothing else f'{1e3 * behind_m:g} mm'} behind"
        yield place, int((~np.isclose(z_m, expected, 0, 1e-12, equal_nan=True)).sum())


@case("meshes", "a ball in many or few faces", "of the bound on it", 1.0)
def _ball() -> Seen:
    """Error of depth over the faces' own distance from the sphere. Against: the sphere. Because: {SAGITTA}."""
    for rings, (name, flip) in product((16, 40, 100), (("outward", 1), ("turned", -1))):
        yield f"{rings} rings, {name}", _ball_share(rings, flip, 0.0)


def _ball_share(rings: int, flip: int, offset_m: float) -> float:
    radius_m, (vertices, faces) = 0.05, ball(rings)
    axis = radius_m * np.linspace(-0.95, 0.95, 41)
    x, y = np.meshgrid(axis, axis)
    inside = np.hypot(x, y) < 0.95 * radius_m
    exact = DEPTH_M + offset_m - np.sqrt(radius_m**2 - np.where(inside, x**2 + y**2, 0))
    z_m = depth(vertices + offset_m, faces[:, ::flip], axis + offset_m, axis + offset_m)
    largest_m = 2 * radius_m * (1 - np.cos(np.pi / np.sqrt(2) / rings)) / np.sqrt(1 - 0.95**2)
    error = np.abs(z_m - exact)[inside]
    return float(np.where(np.isnan(error), np.inf, error).max() / largest_m)


@case("meshes", "mesh and grid far from the origin", "of the bound on it", 1.0)
def _far() -> Seen:
    """Error of a ball's depth, mesh and grid moved together. Against: the sphere. Because: {SAGITTA}; rays count from
    the grid, so that single precision does not choose another face."""
    return ((f"offset {offset_m:g} m", _ball_share(40, 1, offset_m)) for offset_m in (1.0, 1e3, 1e5, 1e6))


@case("meshes", "layers behind a stray face", "m", 250 * 2.0**-22)
def _layers() -> Seen:
    """Error of depth of the nearer of two layers. Against: the nearer plane. Because: rays start before the stray face
    and meet the layers after 250 m at most, rounded by a few 2⁻²⁴ of that: layers nearer to each other are not told
    apart; a mesh that spans more is refused."""
    vertices, faces = sheet(4)
    for far_m, gap_m in product((1.0, 30.0, 249.0), (1e-2, 1e-3, 1e-4, 1e-5)):
        stray = [[0.3, 0.3, -far_m], [0.31, 0.3, -far_m], [0.3, 0.31, -far_m]]
        count = len(vertices)
        mesh = np.concatenate([vertices + [0, 0, gap_m], vertices, stray])
        every = np.concatenate([faces, faces + count, [[2 * count, 2 * count + 1, 2 * count + 2]]])
        error_m = plane_error_m(depth(mesh, every, GRID_M, GRID_M), GRID_M, GRID_M)
        yield f"stray by {far_m:g} m, layers {1e3 * gap_m:g} mm apart", error_m


@refusal("meshes", "a mesh in millimetres", "in millimetres?", "200 ×")
def _millimetres() -> Works:
    """Its depth would be off by 300 m, or all pixels unobserved: no mean should say so."""
    vertices, faces = sheet(10)
    yield "1000 times as large", lambda: depth(1e3 * vertices, faces, GRID_M, GRID_M)

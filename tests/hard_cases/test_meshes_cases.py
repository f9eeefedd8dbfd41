"""Hard meshes: grazing planes, slivers, fins, soups, holes, few faces, far origins, stray faces,
other units; rays that meet a mesh at its vertices and edges, obliquely, from far away, or on their
own surface."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from handbench.groundtruth.mesh.depth import EDGE_ON, LARGEST_M, reference_on_grid
from handbench.groundtruth.mesh.surface import Surface
from handbench.support.rays import Rays, load_open3d
from tests.references.balls import U_SINGLE, U, balls, off
from tests.refusals import refuse

SLOPES, DEPTH_M = np.array([0.5, -0.3]), 0.3
GRID_M = np.linspace(-0.09, 0.09, 37)
# A plane's depth is formed in double on the triangle that is hit: edges, products and differences
# of two components of the normal, then an offset, a product, a sum, a quotient and a difference,
# twelve roundings of 0.5 m; a vertex is rounded too.
ROUNDED_M = (2 * 3 + 5 + 1) * U * 0.5


def between(cells, half_m):
    """Middles [cells] of as many steps from −half_m to half_m."""
    return np.convolve(np.linspace(-half_m, half_m, cells + 1), [0.5, 0.5], "valid")


def on_plane(xy_m, slopes=SLOPES):
    """Vertices [n, 3] of the plane z = 0.3 m + slopes·xy above xy_m [n, 2]."""
    return np.column_stack([xy_m, DEPTH_M + xy_m @ slopes])


def sheet(cells, half_m=0.1):
    """A square of the plane as cells² squares of two triangles: vertices [n, 3], faces [m, 3]."""
    x, y = np.meshgrid(*[np.linspace(-half_m, half_m, cells + 1)] * 2)
    corner = np.arange(cells * (cells + 1)).reshape(cells, cells + 1)[:, :-1].ravel()
    right, up = corner + 1, corner + cells + 1
    faces = np.concatenate(
        [np.stack(f, 1) for f in ((corner, up + 1, up), (corner, right, up + 1))]
    )
    return on_plane(np.stack([x.ravel(), y.ravel()], 1)), faces


def ball(rings, centre_m=(0, 0, DEPTH_M)):
    """A sphere of 5 cm of `rings` rings of 2·rings quadrangles, the poles along z."""
    sphere = load_open3d().geometry.TriangleMesh.create_sphere(0.05, rings)
    return np.asarray(sphere.vertices) + centre_m, np.asarray(sphere.triangles)


def depth(vertices_m, faces, x_m, y_m):
    """The product's depth [ny, nx] of triangles."""
    z_m = vertices_m[:, 2]
    surface = Surface(vertices_m, faces, z_m, z_m < np.inf)
    return reference_on_grid(surface, np.atleast_1d(x_m), np.atleast_1d(y_m)).z_m


def plane_error_m(vertices_m, faces, x_m=GRID_M, y_m=GRID_M, slopes=SLOPES):
    """Largest error of depths of the plane, in balls; infinite where one is missing."""
    x, y = balls(np.atleast_1d(x_m)), balls(np.atleast_1d(y_m))[:, None]
    exact = DEPTH_M + x * float(slopes[0]) + y * float(slopes[1])
    return off(depth(vertices_m, faces, x_m, y_m), exact).max()


@pytest.mark.parametrize("slope", [1.0, 1e2, 9e3, 1.1e4, 1e6, 1e8])
def test_a_grazing_plane_has_its_depth_or_none(slope, within):
    """Steeper than 10⁴ a triangle is on edge."""
    half_m, slopes = 0.1 / slope, np.array([slope, 0.0])
    xy = np.array([[-half_m, -0.1], [half_m, -0.1], [half_m, 0.1], [-half_m, 0.1]])
    plane, x_m = (on_plane(xy, slopes), np.array([[0, 1, 2], [0, 2, 3]])), GRID_M / slope
    if slope > 1e4:
        within(np.isfinite(depth(*plane, x_m, GRID_M)).sum(), 0, "depths")
    else:
        within(plane_error_m(*plane, x_m, slopes=slopes), ROUNDED_M, "m")


@pytest.mark.parametrize("top_m", [(0, 0, 0.9), (0.01, 0.003, 5.0), (1e-6, 1e-5, 50.0)], ids=str)
def test_fins_that_share_an_edge_with_a_sheet_hide_nothing(top_m, within):
    """A ray may choose a steep face: its place rounds by 2⁻²⁴ of 0.13 m, which is furthest from the
    axis, times the steepest slope that is shown, 10⁴."""
    vertices, faces = sheet(30)
    axis_m = np.linspace(-0.1, 0.1, 61)[1:-1]  # vertices and middles of edges
    fins = np.column_stack([faces[:, :2], np.full(len(faces), len(vertices))])
    mesh = np.vstack([vertices, top_m]), np.vstack([faces, fins])  # three faces on an edge
    within(plane_error_m(*mesh, axis_m, axis_m), U_SINGLE * 0.13 / EDGE_ON, "m")


@pytest.mark.parametrize("aspect", [1e2, 1e4, 1e6, 1e8])
def test_slivers_have_the_depth_of_their_plane(aspect, within):
    """Their normal is a difference of products that are larger by the aspect, and so are the
    roundings."""
    height_m = 0.2 / aspect
    turn = Rotation.from_euler("z", 30, degrees=True).as_matrix()[:2, :2]
    rows = np.array([-0.1, -height_m / 2, height_m / 2, 0.1])
    xy = np.array([(x, y) for y in rows for x in (-0.1, 0.1)]) @ turn.T
    faces = np.concatenate([2 * i + np.array([[0, 1, 3], [0, 3, 2]]) for i in range(3)])
    across_m = height_m * np.linspace(-0.45, 0.45, 7)
    for x_m, y_m in np.array([(x, y) for x in (-0.06, 0.01, 0.055) for y in across_m]) @ turn.T:
        within(plane_error_m(on_plane(xy), faces, x_m, y_m), aspect * ROUNDED_M, "m")


SHEET, FACES = sheet(30)
TURNED = np.random.default_rng(1).random(len(FACES)) < 0.5
CORNERS = np.arange(len(SHEET))[:, None]
SOUPS = {
    "half of the faces turned": (SHEET, np.where(TURNED[:, None], FACES[:, ::-1], FACES)),
    "every vertex once a face": (SHEET[FACES.ravel()], np.arange(FACES.size).reshape(-1, 3)),
    "every face twice, one turned": (SHEET, np.vstack([FACES, FACES[:, ::-1]])),
    "faces without area": (SHEET, np.vstack([FACES, CORNERS.repeat(3, 1), FACES[:, [0, 0, 1]]])),
    "vertices without a face": (np.vstack([SHEET, [0, 0, -1e6]]), FACES),
}


@pytest.mark.parametrize("name", SOUPS)
def test_soups_doubles_and_turned_faces_have_the_plane_s_depth(name, within):
    """Which of two equal triangles is hit changes nothing."""
    within(plane_error_m(*SOUPS[name]), ROUNDED_M, "m")


@pytest.mark.parametrize("behind_m", [np.nan, 1e-3, 1e-5])
@pytest.mark.parametrize("share", [0.01, 0.5, 0.99])
def test_holes_show_what_lies_behind(share, behind_m, within):
    """No depth is invented, lost or of the wrong layer."""
    cells = 36
    vertices, faces = sheet(cells, 0.09)
    middles_m = between(cells, 0.09) + 3e-4  # off the diagonal
    plane_m = DEPTH_M + SLOPES[0] * middles_m + SLOPES[1] * middles_m[:, None]
    kept = np.random.default_rng(2).random(cells**2) >= share
    expected = np.where(kept.reshape(cells, cells), plane_m, plane_m + behind_m)
    mesh = vertices, faces[np.tile(kept, 2)]
    if np.isfinite(behind_m):
        mesh = (
            np.vstack([vertices, vertices + [0, 0, behind_m]]),
            np.vstack([mesh[1], faces + len(vertices)]),
        )
    right = np.isclose(depth(*mesh, middles_m, middles_m), expected, 0, 1e-12, equal_nan=True)
    within(np.count_nonzero(~right), 0, "pixels")


@pytest.mark.parametrize("offset_m", [1.0, 1e3, 1e5, 1e6])
def test_mesh_and_grid_far_from_the_origin(offset_m, within):
    """Corners lie on the sphere, faces within it by r(1 − cos π/√2n) at most for n rings, seen
    under the sphere's slope: over its cosine, 0.31 at 0.95 r, and as much again for how the slope
    changes there; rays count from the grid, so that single precision does not choose another
    face."""
    radius_m, rings = 0.05, 40
    vertices, faces = ball(rings)
    axis_m = radius_m * np.linspace(-0.95, 0.95, 41)
    x, y = np.meshgrid(axis_m, axis_m)
    inside = np.hypot(x, y) < 0.95 * radius_m
    z_m = depth(vertices + offset_m, faces, axis_m + offset_m, axis_m + offset_m)
    x, y = (balls((axis + offset_m)[inside]) - offset_m for axis in (x, y))
    exact = DEPTH_M + offset_m - np.sqrt(balls(radius_m) ** 2 - x**2 - y**2)
    bound_m = 2 * radius_m * (1 - np.cos(np.pi / np.sqrt(2) / rings)) / np.sqrt(1 - 0.95**2)
    within(off(z_m[inside], exact).max(), bound_m, "m")


@pytest.mark.parametrize("gap_m", [1e-2, 1e-3, 1e-4, 1e-5])
@pytest.mark.parametrize("far_m", [1.0, 30.0, 249.0])
def test_layers_behind_a_stray_face_are_the_nearer_one(far_m, gap_m, within):
    """Rays start before the stray face and meet the layers after 250 m at most, rounded by a few
    2⁻²⁴ of that: layers nearer to each other are not separated; a mesh that spans more is
    refused."""
    vertices, faces = sheet(4)
    stray = [[0.3, 0.3, -far_m], [0.31, 0.3, -far_m], [0.3, 0.31, -far_m]]
    count = len(vertices)
    mesh = (
        np.vstack([vertices + [0, 0, gap_m], vertices, stray]),
        np.vstack([faces, faces + count, 2 * count + np.arange(3)]),
    )
    within(plane_error_m(*mesh), 4 * U_SINGLE * LARGEST_M[2], "m")


def test_a_mesh_in_millimetres_has_no_depth():
    """It would be off by 300 m, or all pixels unobserved: a mean of them is not a figure."""
    refuse(lambda: depth(1e3 * SHEET, FACES, GRID_M, GRID_M), "mesh", "200 m")


@pytest.mark.parametrize("half_m", [0.1, 0.13])
@pytest.mark.parametrize("cells", [7, 30, 128])
def test_no_ray_slips_through_vertices_and_edges(cells, half_m, within):
    """The ray caster's edge tests are watertight: neighbours share each edge's sign."""
    # the rim belongs to the sheet only in part
    corners_m = np.linspace(-half_m, half_m, cells + 1)[1:-1]
    for axis_m in (corners_m, between(cells, half_m)):
        slipped = np.isnan(depth(*sheet(cells, half_m), axis_m, axis_m))
        within(slipped.sum(), 0, "rays")


@pytest.mark.parametrize("range_m", [0.1, 0.3, 2.0, 20.0, 400.0])
def test_points_on_their_own_surface_neither_hide_nor_shine_through(range_m, within):
    """Against n·(eye − p). Rays start 0.2 mm above the surface, many times single precision's step
    up to 500 m, where meshes end; points seen within 0.1 rad of grazing are not asked."""
    vertices, faces = ball(40, (0, 0, range_m))
    points = vertices[faces].mean(axis=1)
    outward = points - [0, 0, range_m]
    lengths_m2 = np.linalg.norm(outward, axis=1) * np.linalg.norm(points, axis=1)
    cosine = -(outward * points).sum(axis=1) / lengths_m2
    rays = Rays(vertices, faces)
    wrong = rays.in_sight(points, np.zeros(3)) != (cosine > 0)
    within(wrong[np.abs(cosine) > 0.1].sum(), 0, "points")
    along, face = rays.first_hits(0 * points, points)
    first = np.flatnonzero(cosine > 0.1)
    np.testing.assert_allclose(along[first], 1, rtol=1e-5)  # single precision
    np.testing.assert_array_equal(face[first], first)


def test_a_scene_beyond_single_precision_has_no_shadow():
    """Half a kilometre away a surface and what hides it round to one place."""
    refuse(lambda: Rays(SHEET + 600, FACES), "mesh", "600 m")

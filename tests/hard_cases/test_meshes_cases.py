"""Hard meshes: grazing planes, slivers, fins, soups, holes, few faces, far origins, stray faces,
other units; rays that meet a mesh at its vertices and edges, obliquely, from far away, or on their
own surface.
"""

from itertools import product

import numpy as np
from scipy.spatial.transform import Rotation

from handbench.groundtruth.mesh.depth import EDGE_ON, LARGEST_M, reference_on_grid
from handbench.groundtruth.mesh.surface import Surface
from handbench.support.rays import Rays
from tests.hard_cases.cases import U_SINGLE, Seen, U, Works, hard_case, refusal
from tests.references.balls import balls, off

SLOPES, DEPTH_M = np.array([0.5, -0.3]), 0.3


def between(cells: int, half_m: float) -> np.ndarray:
    """Middles [cells] of as many steps from −half_m to half_m."""
    return np.convolve(np.linspace(-half_m, half_m, cells + 1), [0.5, 0.5], "valid")


def on_plane(xy_m: np.ndarray, slopes: np.ndarray = SLOPES) -> np.ndarray:
    """Vertices [n, 3] of the plane z = 0.3 m + slopes·xy above xy_m [n, 2]."""
    return np.column_stack([xy_m, DEPTH_M + xy_m @ slopes])


def sheet(cells: int, half_m: float = 0.1) -> tuple[np.ndarray, np.ndarray]:
    """A square of the plane as cells² squares of two triangles: vertices [n, 3], faces [m, 3]."""
    x, y = np.meshgrid(*[np.linspace(-half_m, half_m, cells + 1)] * 2)
    corner = np.arange(cells * (cells + 1)).reshape(cells, cells + 1)[:, :-1].ravel()
    right, up = 1, cells + 1
    faces = [
        np.stack([corner, corner + right + up, corner + up], 1),
        np.stack([corner, corner + right, corner + right + up], 1),
    ]
    return on_plane(np.stack([x.ravel(), y.ravel()], 1)), np.concatenate(faces)


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
        np.asarray(vertices_m, float),
        np.asarray(faces),
        np.zeros(len(vertices_m)),
        np.ones(len(vertices_m), bool),
    )


def depth(
    vertices_m: np.ndarray, faces: np.ndarray, x_m: np.ndarray, y_m: np.ndarray
) -> np.ndarray:
    """The product's depth of triangles on a grid [ny, nx]."""
    return reference_on_grid(surface(vertices_m, faces), np.atleast_1d(x_m), np.atleast_1d(y_m)).z_m


def plane_error_m(
    z_m: np.ndarray, x_m: np.ndarray, y_m: np.ndarray, slopes: np.ndarray = SLOPES
) -> float:
    """Largest error of depths [ny, nx] of the plane; infinite where one is missing."""
    x, y = balls(np.atleast_1d(x_m)), balls(np.atleast_1d(y_m))[:, None]
    return float(off(z_m, DEPTH_M + x * float(slopes[0]) + y * float(slopes[1])).max())


GRID_M = np.linspace(-0.09, 0.09, 37)
# A plane's depth: edges, products and differences of two components of the normal, then an offset,
# a product, a sum, a quotient and a difference, in double; a vertex is rounded too.
ROUNDED_M = (2 * 3 + 5 + 1) * U * 0.5
SHEET_M = 0.13  # furthest from the axis


@hard_case(
    "grazing planes",
    kind="rigorous",
    bound=ROUNDED_M,
    unit="m",
    quantity="error of depth, slopes to 10⁴ and past what is shown",
    reference="the plane, in balls; beyond, nothing",
)
def test_grazing() -> Seen:
    """A plane's depth is formed in double on the triangle that is hit: twelve roundings of 0.5
    m; steeper than 10⁴ a triangle is on edge, and it has no depth."""
    for slope in (1.0, 1e2, 9e3, 1.1e4, 1e6, 1e8):
        half_m, slopes = 0.1 / slope, np.array([slope, 0.0])
        xy = np.array([[-half_m, -0.1], [half_m, -0.1], [half_m, 0.1], [-half_m, 0.1]])
        z_m = depth(on_plane(xy, slopes), np.array([[0, 1, 2], [0, 2, 3]]), GRID_M / slope, GRID_M)
        beyond = 0.0 if np.isnan(z_m).all() else np.inf
        yield (
            f"slope {slope:g}",
            beyond if slope > 1e4 else plane_error_m(z_m, GRID_M / slope, GRID_M, slopes),
        )


@hard_case(
    "fins that share an edge with a sheet",
    kind="rigorous",
    bound=U_SINGLE * SHEET_M / EDGE_ON,
    unit="m",
    quantity="error of depth where a ray may choose a steep face",
    reference="the plane, in balls",
)
def test_fins() -> Seen:
    """A ray's place rounds by 2⁻²⁴ of 0.13 m, times the steepest slope that is shown, 10⁴."""
    vertices, faces = sheet(30)
    axis = np.linspace(-0.1, 0.1, 61)[1:-1]  # vertices and middles of edges
    for top_m in ([0, 0, 0.9], [0.01, 0.003, 5.0], [1e-6, 1e-5, 50.0]):
        fins = np.stack(
            [faces[:, 0], faces[:, 1], np.full(len(faces), len(vertices))], 1
        )  # three faces on an edge
        mesh = np.concatenate([vertices, [top_m]]), np.concatenate([faces, fins])
        yield f"fins up to {top_m}", plane_error_m(depth(*mesh, axis, axis), axis, axis)


@hard_case(
    "slivers",
    kind="rigorous",
    bound=ROUNDED_M,
    unit="m",
    quantity="error of depth on triangles of aspect 10² to 10⁸, over the aspect",
    reference="the plane, in balls",
)
def test_slivers() -> Seen:
    """Their normal is a difference of products that are larger by the aspect, and so are the
    twelve roundings of 0.5 m."""
    for aspect in (1e2, 1e4, 1e6, 1e8):
        height_m, turn = (
            0.2 / aspect,
            Rotation.from_euler("z", 30, degrees=True).as_matrix()[:2, :2],
        )
        rows = np.array([-0.1, -height_m / 2, height_m / 2, 0.1])
        xy = np.array([(x, y) for y in rows for x in (-0.1, 0.1)]) @ turn.T
        faces = np.array(
            [[2 * i + a for a in corners] for i in range(3) for corners in ((0, 1, 3), (0, 3, 2))]
        )
        across_m = height_m * np.linspace(-0.45, 0.45, 7)
        places = np.array([(x, y) for x in (-0.06, 0.01, 0.055) for y in across_m]) @ turn.T
        error_m = max(plane_error_m(depth(on_plane(xy), faces, x, y), x, y) for x, y in places)
        yield f"aspect {aspect:g}", error_m / aspect


@hard_case(
    "soups, doubles and turned faces",
    kind="rigorous",
    bound=ROUNDED_M,
    unit="m",
    quantity="error of depth of a mesh that no rule of meshes holds for",
    reference="the plane, in balls",
)
def test_soups() -> Seen:
    """A plane's depth is formed in double on the triangle that is hit: twelve roundings of 0.5
    m; which of two equal triangles is hit changes nothing."""
    vertices, faces = sheet(30)
    generator = np.random.default_rng(1)
    turned = np.where(generator.random(len(faces))[:, None] < 0.5, faces[:, ::-1], faces)
    corner = np.arange(len(vertices))
    meshes = {
        "half of the faces turned": (vertices, turned),
        "every vertex once a face": (vertices[faces.ravel()], np.arange(faces.size).reshape(-1, 3)),
        "every face twice, one turned": (vertices, np.concatenate([faces, faces[:, ::-1]])),
        "faces without area": (
            vertices,
            np.concatenate([faces, np.stack([corner] * 3, 1), faces[:, [0, 0, 1]]]),
        ),
        "vertices without a face": (np.concatenate([vertices, [[0, 0, -1e6]]]), faces),
    }
    return (
        (name, plane_error_m(depth(*mesh, GRID_M, GRID_M), GRID_M, GRID_M))
        for name, mesh in meshes.items()
    )


@hard_case(
    "holes",
    kind="derived",
    bound=0.0,
    unit="pixels",
    quantity="pixels whose depth is invented, lost or of the wrong layer",
    reference="which squares are left",
)
def test_holes() -> Seen:
    """A ray through a hole has no depth, or that of what lies behind."""
    cells = 36
    vertices, faces = sheet(cells, 0.09)
    middles = between(cells, 0.09) + 3e-4  # off the diagonal
    plane = DEPTH_M + SLOPES[0] * middles + SLOPES[1] * middles[:, None]
    for share, behind_m in product((0.01, 0.5, 0.99), (np.nan, 1e-3, 1e-5)):
        kept = np.random.default_rng(2).random(cells**2) >= share
        expected = np.where(kept.reshape(cells, cells), plane, plane + behind_m)
        nothing, left = np.isnan(behind_m), faces[np.tile(kept, 2)]
        both = (
            np.concatenate([vertices, vertices + [0, 0, behind_m]]),
            np.concatenate([left, faces + len(vertices)]),
        )
        z_m = depth(*((vertices, left) if nothing else both), middles, middles)
        place = (
            f"{share:.0%} of the squares missing, "
            f"{'nothing' if nothing else f'{1e3 * behind_m:g} mm'} behind"
        )
        yield place, int((~np.isclose(z_m, expected, 0, 1e-12, equal_nan=True)).sum())


def _ball_share(offset_m: float) -> float:
    radius_m, rings = 0.05, 40
    vertices, faces = ball(rings)
    axis = radius_m * np.linspace(-0.95, 0.95, 41)
    x, y = np.meshgrid(axis, axis)
    inside = np.hypot(x, y) < 0.95 * radius_m
    z_m = depth(vertices + offset_m, faces, axis + offset_m, axis + offset_m)
    largest_m = 2 * radius_m * (1 - np.cos(np.pi / np.sqrt(2) / rings)) / np.sqrt(1 - 0.95**2)
    x, y = (balls((axis + offset_m)[inside]) - offset_m for axis in (x, y))
    exact = DEPTH_M + offset_m - np.sqrt(balls(radius_m) ** 2 - x**2 - y**2)
    return float(off(z_m[inside], exact).max() / largest_m)


@hard_case(
    "mesh and grid far from the origin",
    kind="rigorous",
    bound=1.0,
    unit="of the bound on it",
    quantity="error of a ball's depth, mesh and grid moved together",
    reference="the sphere, in balls",
)
def test_far() -> Seen:
    """Corners lie on the sphere, faces within it by r(1 − cos π/√2n) at most for n rings, seen
    under the sphere's slope: over its cosine, 0.31 at 0.95 r, and as much again for how the
    slope changes there; rays count from the grid, so that single precision does not choose
    another face."""
    return ((f"offset {offset_m:g} m", _ball_share(offset_m)) for offset_m in (1.0, 1e3, 1e5, 1e6))


@hard_case(
    "layers behind a stray face",
    kind="rigorous",
    bound=4 * U_SINGLE * LARGEST_M[2],
    unit="m",
    quantity="error of depth of the nearer of two layers",
    reference="the nearer plane, in balls",
)
def test_layers() -> Seen:
    """Rays start before the stray face and meet the layers after 250 m at most, rounded by a
    few 2⁻²⁴ of that: layers nearer to each other are not separated; a mesh that spans more is
    refused."""
    vertices, faces = sheet(4)
    for far_m, gap_m in product((1.0, 30.0, 249.0), (1e-2, 1e-3, 1e-4, 1e-5)):
        stray = [[0.3, 0.3, -far_m], [0.31, 0.3, -far_m], [0.3, 0.31, -far_m]]
        count = len(vertices)
        mesh = np.concatenate([vertices + [0, 0, gap_m], vertices, stray])
        every = np.concatenate([faces, faces + count, [[2 * count, 2 * count + 1, 2 * count + 2]]])
        error_m = plane_error_m(depth(mesh, every, GRID_M, GRID_M), GRID_M, GRID_M)
        yield f"stray by {far_m:g} m, layers {1e3 * gap_m:g} mm apart", error_m


@refusal("a mesh in millimetres", "in millimetres", "200 m")
def test_millimetres() -> Works:
    """Its depth would be off by 300 m, or all pixels unobserved: a mean of them is not a
    figure."""
    vertices, faces = sheet(10)
    yield "1000 times as large", lambda: depth(1e3 * vertices, faces, GRID_M, GRID_M)


EYES_M = np.array([[0.07, 0.07, 0.0], [-0.3, 0.2, 0.3], [0.0, 0.0, 20.0]])


@hard_case(
    "rays through vertices and edges",
    kind="derived",
    bound=0.0,
    unit="rays",
    quantity="rays that slip through a closed sheet",
    reference="none",
)
def test_watertight() -> Seen:
    """The ray caster's edge tests are watertight: neighbours share each edge's sign."""
    for n, half_m in product((7, 30, 128), (0.1, 0.13)):
        # the rim belongs to the sheet only in part
        corners = np.linspace(-half_m, half_m, n + 1)[1:-1]
        for axis in (corners, between(n, half_m)):
            slipped = np.isnan(depth(*sheet(n, half_m), axis, axis)).sum()
            yield f"{n} × {n} squares of {2e3 * half_m / n:.3g} mm", slipped


@hard_case(
    "oblique rays exactly through vertices and edges",
    kind="measured",
    bound=0.5**2,
    unit="1",
    quantity="share of rays that slip through",
    reference="none",
)
def test_at_edges() -> Seen:
    """Single precision decides for each of the two faces at an edge by itself whether the ray
    meets it: both say no in a quarter of the cases, were they independent and even; rays along
    z, which depth maps are made of, do not slip at all."""
    for rings, eye_m in product((8, 24, 60), EYES_M):
        vertices, faces = ball(rings)
        aims = np.concatenate([vertices, vertices[faces[:, :2]].mean(axis=1)])
        towards = aims - eye_m
        along, _ = Rays(vertices, faces).first_hits(np.tile(eye_m, (len(aims), 1)), towards)
        cosine = ((aims - [0, 0, DEPTH_M]) * towards).sum(axis=1)
        facing = cosine < -0.1 * 0.05 * np.linalg.norm(towards, axis=1)
        yield f"{rings} rings, from {eye_m.tolist()} m", (along[facing] > 1 + 1e-3).mean()


@hard_case(
    "points on their own surface",
    kind="derived",
    bound=0.0,
    unit="points",
    quantity="points that hide themselves, or shine through",
    reference="n·(eye − p) of a ball",
)
def test_own_surface() -> Seen:
    """Rays start 0.2 mm above the surface, many times single precision's step up to 500 m,
    where meshes end; points seen within 0.1 rad of grazing are not asked."""
    for range_m in (0.1, 0.3, 2.0, 20.0, 400.0):
        vertices, faces = ball(40, 0.05, (0, 0, range_m))
        corners = vertices[faces]
        areal = (
            np.linalg.norm(
                np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1
            )
            > 0
        )
        points = corners[areal].mean(axis=1)
        outward, towards = points - [0, 0, range_m], -points
        lengths_m2 = np.linalg.norm(outward, axis=1) * np.linalg.norm(towards, axis=1)
        cosine = np.einsum("ni,ni->n", outward, towards) / lengths_m2
        wrong = Rays(vertices, faces).in_sight(points, np.zeros(3)) != (cosine > 0)
        yield f"range {range_m:g} m", wrong[np.abs(cosine) > 0.1].sum()


@refusal("a scene beyond single precision", "single precision")
def test_far_scene() -> Works:
    """Half a kilometre away a surface and what hides it round to one place."""
    vertices, faces = sheet(10)
    yield "600 m away", lambda: Rays(vertices + 600, faces)

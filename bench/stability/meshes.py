"""Hard meshes: rays through edges, slivers, soups, holes, far origins, single precision, other units, many faces."""

from __future__ import annotations

import tempfile
import tracemalloc
from pathlib import Path

import numpy as np
import psutil
from scipy.spatial import Delaunay
from scipy.spatial.transform import Rotation

from bench.stability.catalogue import Refused, Worst, case, refused, worst
from bench.stability.meshes_shapes import DEPTH_M, SLOPES, ball, depth, on_plane, plane_error_m, sheet, surface
from calibration.meshes import read_triangles
from groundtruth.depth import CLEARANCE_M
from radar.rays import Rays

U = 2.0**-53
GRID_M = np.linspace(-0.09, 0.09, 37)
ROUNDED = "a plane's depth is formed in double on the triangle that is hit: a few 2⁻⁵³ of 0.5 m"
SAGITTA = (
    "corners lie on the sphere, faces within it by r(1 − cos π/√2n) at most for n rings, seen under the sphere's slope: "
    "over its cosine, 0.31 at 0.95 r, and as much again for how the slope changes there"
)


@case(
    "meshes",
    "rays through vertices and edges",
    quantity="rays that slip through a closed sheet",
    reference="none",
    unit="rays",
    bound=0.0,
    reason="the ray caster's edge tests are watertight: neighbours share each edge's sign",
)
def _watertight() -> Worst:
    def slipped(cells: int, half_m: float) -> int:
        corners = np.linspace(-half_m, half_m, cells + 1)[1:-1]  # the rim belongs to the sheet only in part
        between = np.convolve(np.linspace(-half_m, half_m, cells + 1), [0.5, 0.5], "valid")
        mesh = sheet(cells, half_m)
        return sum(int(np.isnan(depth(*mesh, axis, axis)).sum()) for axis in (corners, between))

    seen = [
        (f"{n} × {n} squares of {2e3 * half_m / n:.3g} mm", slipped(n, half_m))
        for n in (7, 30, 128)
        for half_m in (0.1, 0.13)
    ]
    generator = np.random.default_rng(0)
    rim = [[-0.2, -0.2], [0.2, -0.2], [0.2, 0.2], [-0.2, 0.2]]
    places = np.concatenate([generator.uniform(-0.1, 0.1, (200, 2)), rim])
    faces = Delaunay(places).simplices
    edges = places[faces[:, :2]]
    along = generator.uniform(0, 1, (len(edges), 1))
    met = np.concatenate([places[:-4], edges[:, 0] + along * (edges[:, 1] - edges[:, 0])])[::8]
    missed = [np.isnan(depth(on_plane(places), faces, x, y)).any() for x, y in met]
    return worst([*seen, ("an uneven triangulation", sum(missed))])


@case(
    "meshes",
    "a closed ball from every side",
    quantity="oblique rays through vertices and edges that slip through",
    reference="none",
    unit="rays",
    bound=0.0,
    reason="as of sheets; a slipped ray would meet the far side",
)
def _closed() -> Worst:
    def slipped(rings: int) -> int:
        vertices, faces = ball(rings)
        middles = (vertices[faces[:, 0]] + vertices[faces[:, 1]]) / 2
        aims, lost = np.concatenate([vertices, middles]), 0
        for eye in ([0.07, 0.07, 0], [-0.3, 0.2, 0.3], [0, 0, 20.0]):
            near = (aims - eye) @ (np.array([0, 0, DEPTH_M]) - eye) > 0
            towards = aims - eye
            along, _ = Rays(vertices, faces).first_hits(np.tile(eye, (len(aims), 1)), towards)
            facing = np.einsum("ni,ni->n", towards, aims - [0, 0, DEPTH_M]) < -1e-2 * 0.05 * np.linalg.norm(
                towards, axis=1
            )
            lost += int((along[near & facing] > 1 + 1e-3).sum())
        return lost

    return worst((f"{rings} rings", slipped(rings)) for rings in (8, 24, 60))


@case(
    "meshes",
    "grazing planes",
    quantity="error of depth, slopes to 10⁸",
    reference="the plane",
    unit="m",
    bound=1e-14,
    reason=ROUNDED + ", and its offset along x, which is scaled with the slope",
)
def _grazing() -> Worst:
    def error(slope: float) -> float:
        half_m, slopes = 0.1 / slope, np.array([slope, 0.0])
        xy = np.array([[-half_m, -0.1], [half_m, -0.1], [half_m, 0.1], [-half_m, 0.1]])
        x_m = GRID_M / slope
        z_m = depth(on_plane(xy, slopes), np.array([[0, 1, 2], [0, 2, 3]]), x_m, GRID_M)
        return plane_error_m(z_m, x_m, GRID_M, slopes)

    return worst((f"slope {slope:g}", error(slope)) for slope in (1.0, 1e2, 1e4, 1e6, 1e8))


@case(
    "meshes",
    "slivers",
    quantity="error of depth on triangles of aspect 10² to 10⁸, over the aspect",
    reference="the plane",
    unit="m",
    bound=8 * U,
    reason="their normal is a difference of products as large as the aspect over it: 2⁻⁵³ times the aspect, a few times, "
    "over lengths of 0.2 m",
)
def _slivers() -> Worst:
    def error(aspect: float) -> float:
        height_m, turn = 0.2 / aspect, Rotation.from_euler("z", 30, degrees=True).as_matrix()[:2, :2]
        rows = np.array([-0.1, -height_m / 2, height_m / 2, 0.1])
        xy = np.array([(x, y) for y in rows for x in (-0.1, 0.1)]) @ turn.T
        faces = [[2 * i + a for a in corners] for i in range(3) for corners in ((0, 1, 3), (0, 3, 2))]
        places = (
            np.array([(x, y) for x in (-0.06, 0.01, 0.055) for y in height_m * np.linspace(-0.45, 0.45, 7)]) @ turn.T
        )
        vertices = on_plane(xy)
        return max(plane_error_m(depth(vertices, faces, x, y), x, y) for x, y in places) / aspect

    return worst((f"aspect {aspect:g}", error(aspect)) for aspect in (1e2, 1e4, 1e6, 1e8))


@case(
    "meshes",
    "soups, doubles and turned faces",
    quantity="error of depth of a mesh that no rule of meshes holds for",
    reference="the plane",
    unit="m",
    bound=1e-15,
    reason=ROUNDED + "; which of two equal triangles is hit changes nothing",
)
def _soups() -> Worst:
    vertices, faces = sheet(30)
    generator = np.random.default_rng(1)
    turned = np.where(generator.random(len(faces))[:, None] < 0.5, faces[:, ::-1], faces)
    corner = np.arange(len(vertices))
    fins = np.stack([faces[:, 0], faces[:, 1], len(vertices) + 0 * faces[:, 0]], 1)  # three faces on an edge, behind
    meshes = {
        "half of the faces turned": (vertices, turned),
        "all turned": (vertices, faces[:, ::-1]),
        "every vertex once a face": (vertices[faces.ravel()], np.arange(faces.size).reshape(-1, 3)),
        "every face twice, one turned": (vertices, np.concatenate([faces, faces[:, ::-1]])),
        "faces without area": (vertices, np.concatenate([faces, np.stack([corner] * 3, 1), faces[:, [0, 0, 1]]])),
        "non-manifold fins": (np.concatenate([vertices, [[0, 0, 0.9]]]), np.concatenate([faces, fins])),
        "vertices without a face": (np.concatenate([vertices, [[0, 0, -1e6]]]), faces),
    }
    return worst((name, plane_error_m(depth(*mesh, GRID_M, GRID_M), GRID_M, GRID_M)) for name, mesh in meshes.items())


@case(
    "meshes",
    "holes",
    quantity="pixels whose depth is invented, lost or of the wrong layer",
    unit="pixels",
    bound=0.0,
    reference="which squares are left",
    reason="a ray through a hole has no depth, or that of what lies behind",
)
def _holes() -> Worst:
    def wrong(share: float, behind_m: float | None) -> int:
        cells = 36
        vertices, faces = sheet(cells, 0.09)
        kept = np.random.default_rng(2).random(cells**2) >= share
        middles = np.convolve(np.linspace(-0.09, 0.09, cells + 1), [0.5, 0.5], "valid") + 3e-4  # off the diagonal
        expected = plane = DEPTH_M + SLOPES[0] * middles + SLOPES[1] * middles[:, None]
        mesh = vertices, faces[np.tile(kept, 2)]
        beyond = np.nan if behind_m is None else plane + behind_m
        expected = np.where(kept.reshape(cells, cells), plane, beyond)
        if behind_m is not None:
            mesh = (
                np.concatenate([vertices, vertices + [0, 0, behind_m]]),
                np.concatenate([mesh[1], faces + len(vertices)]),
            )
        return int((~np.isclose(depth(*mesh, middles, middles), expected, 0, 1e-12, equal_nan=True)).sum())

    return worst(
        (
            f"{share:.0%} of the squares missing, {'nothing' if behind is None else f'{1e3 * behind:g} mm'} behind",
            wrong(share, behind),
        )
        for share in (0.01, 0.5, 0.99)
        for behind in (None, 1e-3, 1e-5)
    )


@case(
    "meshes",
    "a ball in many or few faces",
    quantity="error of depth over the faces' own distance from the sphere",
    reference="the sphere",
    unit="of the bound on it",
    bound=1.0,
    reason=SAGITTA,
)
def _ball() -> Worst:
    return worst(
        (f"{rings} rings, {name}", _ball_share(rings, flip, 0.0))
        for rings in (16, 40, 100)
        for name, flip in (("outward", 1), ("turned", -1))
    )


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


@case(
    "meshes",
    "far from the origin",
    quantity="error of a ball's depth, mesh and grid moved together",
    reference="the sphere",
    unit="of the bound on it",
    bound=1.0,
    reason=SAGITTA + "; rays count from the grid, so that single precision does not choose another face",
)
def _far() -> Worst:
    return worst((f"offset {offset_m:g} m", _ball_share(40, 1, offset_m)) for offset_m in (1.0, 1e3, 1e5, 1e6))


@case(
    "meshes",
    "layers behind a stray face",
    quantity="error of depth of the nearer of two layers",
    unit="m",
    reference="the nearer plane",
    bound=2.0**-14,
    reason="rays start before the stray face and meet the layers after 900 m, where single precision steps by 2⁻¹⁴ m: "
    "layers nearer to each other are not told apart; beyond 1000 m the mesh is refused",
)
def _layers() -> Worst:
    def error(far_m: float, gap_m: float) -> float:
        vertices, faces = sheet(4)
        stray = [[0.3, 0.3, -far_m], [0.31, 0.3, -far_m], [0.3, 0.31, -far_m]]
        count = len(vertices)
        mesh = np.concatenate([vertices + [0, 0, gap_m], vertices, stray])
        every = np.concatenate([faces, faces + count, [[2 * count, 2 * count + 1, 2 * count + 2]]])
        return plane_error_m(depth(mesh, every, GRID_M, GRID_M), GRID_M, GRID_M)

    return worst(
        (f"stray by {far_m:g} m, layers {1e3 * gap_m:g} mm apart", error(far_m, gap_m))
        for far_m in (1.0, 30.0, 900.0)
        for gap_m in (1e-2, 1e-3, 1e-4, 1e-5)
    )


@case(
    "meshes",
    "points on their own surface",
    quantity="points that hide themselves, or shine through",
    unit="points",
    reference="n·(eye − p) of a ball",
    bound=0.0,
    reason="rays start 0.2 mm above the surface, many times the step of single precision up to 500 m, where meshes end; "
    "points seen within 0.1 rad of grazing are not asked",
)
def _own_surface() -> Worst:
    def wrong(range_m: float) -> int:
        vertices, faces = ball(40, 0.05, (0, 0, range_m))
        corners = vertices[faces]
        areal = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1) > 0
        points = corners[areal].mean(axis=1)
        eye = np.zeros(3)
        outward = (points - [0, 0, range_m]) / np.linalg.norm(points - [0, 0, range_m], axis=1, keepdims=True)
        towards = (eye - points) / np.linalg.norm(eye - points, axis=1, keepdims=True)
        cosine = np.einsum("ni,ni->n", outward, towards)
        seen = Rays(vertices, faces).in_sight(points, eye)
        return int((seen != (cosine > 0))[np.abs(cosine) > 0.1].sum())

    return worst((f"range {range_m:g} m", wrong(range_m)) for range_m in (0.1, 0.3, 2.0, 20.0, 400.0))


def _refusal(name: str, why: str):  # noqa: ANN202
    return case("meshes", name, quantity="an answer", reference="a refusal", unit="answers", bound=0.0, reason=why)


@_refusal("a mesh in millimetres", "its depth would be off by 300 m, or all pixels unobserved: no mean should say so")
def _millimetres() -> Refused | Worst:
    vertices, faces = sheet(10)
    return refused(lambda: depth(1e3 * vertices, faces, GRID_M, GRID_M), "in millimetres?", "200 ×")


@_refusal("a scene beyond single precision", "half a kilometre away a surface and what hides it round to one place")
def _far_scene() -> Refused | Worst:
    vertices, faces = sheet(10)
    return refused(lambda: Rays(vertices + 600, faces), "single precision")


@_refusal("10⁷ faces that are not there", "memory is taken for what the file holds, not for what its header says")
def _declared() -> Refused | Worst:
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "a.ply"
        xyz = "".join(f"property float {axis}\n" for axis in "xyz")
        head = f"ply\nformat binary_little_endian 1.0\nelement vertex 3\n{xyz}element face 10000000\n"
        file.write_bytes(f"{head}property list uchar int vertex_indices\nend_header\n".encode() + bytes(36))
        return refused(lambda: read_triangles(file), "promises 10000000 of 'face'")


@_refusal("a mesh beyond the memory", "reading takes several times the file's size: what is not free is not begun")
def _beyond_memory() -> Refused | Worst:
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "a.ply"
        with file.open("wb") as stream:
            stream.truncate(psutil.virtual_memory().total)  # a hole that takes no disk
        return refused(lambda: read_triangles(file), "memory are free", "simplify the mesh")


@case(
    "meshes",
    "memory for 10⁷ faces",
    quantity="memory that reading takes, for each face of 10⁷",
    unit="GB",
    bound=2.2,
    reference="the peak at 5·10⁴ faces, in proportion",
    reason="8 times the file's 27 bytes a face, what is asked for before reading: 2.2 GB",
)
def _memory() -> float:
    vertices, faces = sheet(158)
    with tempfile.TemporaryDirectory() as folder:
        surface(vertices, faces).save(Path(folder) / "a.ply")
        tracemalloc.start()
        read_triangles(Path(folder) / "a.ply")
        peak = tracemalloc.get_traced_memory()[1]
        tracemalloc.stop()
    return 1e7 * peak / len(faces) / 1e9

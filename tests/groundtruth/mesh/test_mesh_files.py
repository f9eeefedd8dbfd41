"""Mesh files: every format and dialect gives the same triangles, and a broken file is refused in
one line."""

import codecs
import struct

import numpy as np
import pytest

from handbench.groundtruth.mesh.mesh_files import read_triangles
from handbench.support.errors import HandbenchError

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
PLY = ply()
ASCII_PLY = lines(HEADER.format("ascii").rstrip(), *PLACES, "3 0 2 1", "3 1 2 3")
OBJ = lines("# a", "vn 0 0 1", *(f"v {place}" for place in PLACES), "f 1 3 2", "f -3/1/1 -2//1 -1")
STL = b"solid".ljust(80) + struct.pack("<I", 2)
STL += b"".join(bytes(12) + VERTICES_M[face].tobytes() + bytes(2) for face in FACES)
ASCII_STL = lines("solid a vertex of a", *LOOPS, "endsolid a")
FIRST = lines(*(f"v {place}" for place in PLACES[:3]), "f -3 -1 -2", f"v {PLACES[3]}", "f -3 -2 -1")


@pytest.mark.parametrize(
    ("name", "content"),
    [
        ("a.ply", PLY),
        ("a.ply", ply("big", ">")),
        ("a.ply", ASCII_PLY),
        ("a.ply", codecs.BOM_UTF8 + ASCII_PLY.replace(b"\n", b"\r\n")),
        ("A.OBJ", OBJ),
        ("a.obj", OBJ.replace(b"f 1 3 2", b"f 1\\\n 3 \\\n 2")),
        ("a.obj", OBJ.replace(b"\n", b" # in C:\\\r\n")),
        ("a.obj", FIRST),
        ("a.stl", STL),
        ("a.stl", ASCII_STL),
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
    """An arrow, whose notch only its tip and the notch itself see, from each corner."""
    x, y = np.array([(0, 0), (2, -1), (1, 0), (2, 1), (1, 0.8)]).T
    corners = " ".join(str(1 + (first + k) % 5) for k in range(5))
    points = [f"v {a} {b} 0" for a, b in zip(x, y, strict=True)]
    (tmp_path / "a.obj").write_bytes(lines(*points, f"f {corners}"))
    vertices_m, faces, _ = read_triangles(tmp_path / "a.obj")
    edges_m = np.diff(vertices_m[faces], axis=1)
    areas = np.cross(edges_m[:, 0], edges_m[:, 1])[:, 2] / 2
    assert (areas > 0).all()
    assert areas.sum() == pytest.approx((x * np.roll(y, -1) - y * np.roll(x, -1)).sum() / 2)


@pytest.mark.parametrize(
    ("name", "content", "old", "new"),
    [
        ("a.ply", PLY, b"face 2", b"face 100000000"),  # more than the file has
        ("a.ply", PLY, b"element face 2\nproperty list uchar int vertex_indices\n", b""),
        ("a.ply", PLY, b"end_header", b""),
        ("a.ply", PLY[:-1], b"", b""),
        ("a.ply", ply(faces=[(0, 1), (1, 2)]), b"", b""),
        ("a.ply", ply(faces=[(0, 2, 1), (0, 2, 3, 1)]), b"", b""),
        ("a.ply", ASCII_PLY, b"0.400000006", b"nan"),
        ("a.ply", ASCII_PLY, b"3 0 2 1", b"3 0 2 1.5"),
        ("a.ply", ASCII_PLY, b"3 1 2 3\n", b""),
        ("a.obj", OBJ, b"f 1 3 2", b"f 1 3 0"),
        ("a.obj", OBJ, b"f 1 3 2", b"f 1 3 -5"),
        ("a.obj", OBJ, b" 0.400000006", b""),
        ("a.obj", b"v 0 0 0\nv 1 1 0\nv 1 0 0\nv 0 1 0\nf 1 2 3 4", b"", b""),  # crosses itself
        ("a.stl", STL[:-1], b"", b""),
        ("a.stl", b"x" * 80 + struct.pack("<I", 10**8), b"", b""),
        ("a.stl", ASCII_STL[:-30], b"", b""),
        ("a.gltf", b"{}", b"", b""),
    ],
)
def test_a_broken_mesh_is_refused_in_one_line(tmp_path, name, content, old, new):
    assert old in content
    (tmp_path / name).write_bytes(content.replace(old, new))
    with pytest.raises(HandbenchError) as caught:
        read_triangles(tmp_path / name)
    assert str(caught.value).startswith(str(tmp_path / name)) and "\n" not in str(caught.value)

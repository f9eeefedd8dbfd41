"""Mesh files of others: every format and dialect gives the same triangles, and a broken file is
refused in one line."""

import codecs
import struct

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from handbench.groundtruth.mesh.mesh_files import read_triangles
from handbench.groundtruth.mesh.polygons import triangles
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
PLY, ASCII_STL = ply(), lines("solid a", *LOOPS, "endsolid a")
ASCII_PLY = lines(HEADER.format("ascii").rstrip(), *PLACES, "3 0 2 1", "3 1 2 3")
OBJ = lines("# a", "vn 0 0 1", *(f"v {place}" for place in PLACES), "f 1 3 2", "f -3/1/1 -2//1 -1")
STL = b"solid".ljust(80) + struct.pack("<I", 2)
STL += b"".join(bytes(12) + VERTICES_M[face].tobytes() + bytes(2) for face in FACES)


@pytest.mark.parametrize(
    ("name", "content"),
    [
        ("a.ply", PLY),
        ("a.ply", ply("big", ">")),
        ("a.ply", ASCII_PLY),
        ("a.obj", OBJ),
        ("a.obj", codecs.BOM_UTF8 + OBJ),
        ("a.obj", OBJ.replace(b"f 1 3 2", b"f 1 \\\n 3 \\\n 2")),
        ("a.obj", OBJ.replace(b"\n", b" # more\r\n")),
        ("a.stl", STL),
        ("a.stl", ASCII_STL),
        ("a.stl", codecs.BOM_UTF8 + ASCII_STL.upper()),
    ],
)
def test_every_format_holds_the_same_triangles(tmp_path, name, content):
    (tmp_path / name).write_bytes(content)
    vertices_m, faces, more = read_triangles(tmp_path / name)
    np.testing.assert_allclose(vertices_m[faces], VERTICES_M[FACES], atol=1e-9)
    assert len(vertices_m) == 4 and more == {}


@pytest.mark.parametrize(
    ("name", "content"),
    [
        ("a.ply", PLY.replace(b"face 2", b"face 100000000")),  # more than it holds
        ("a.ply", PLY.replace(b"face 2", b"face 1")),
        ("a.ply", PLY.replace(b"uchar int", b"float int")),
        ("a.ply", PLY.replace(b"float z", b"float x")),
        ("a.ply", PLY[:-1]),
        ("a.ply", ply(faces=[(0, 1), (1, 2)])),
        ("a.ply", ply(faces=FACES + 1)),  # a vertex that is not there
        ("a.ply", ASCII_PLY.replace(b"0.400000006", b"nan")),
        ("a.ply", ASCII_PLY.replace(b"0.400000006", b"1e30")),
        ("a.obj", OBJ.replace(b"f 1 3 2", b"f 1 3 0")),
        ("a.obj", OBJ.replace(b"v 0.1", b"v 0,1")),
        ("a.obj", b"vertex 1 2 3\n" + OBJ),
        ("a.obj", b"v 0 0 0\nv 1 1 0\nv 1 0 0\nv 0 1 0\nf 1 2 3 4"),  # crosses itself
        ("a.obj", b"v 0 0 1e5\nv 0.25 0 1e5\nv 0 0.25 1e5\nf 1 2 3"),  # steps of single precision
        ("a.stl", STL[:-1]),
        ("a.stl", b"x" * 80 + struct.pack("<I", 10**8)),
        ("a.stl", ASCII_STL[:-30]),
        ("a.stl", ASCII_STL.replace(b"vertex 0", b"vertex O", 1)),
        ("a.gltf", b"{}"),
    ],
)
def test_a_broken_mesh_is_refused_in_one_line(tmp_path, name, content):
    (tmp_path / name).write_bytes(content)
    with pytest.raises(HandbenchError) as caught:
        read_triangles(tmp_path / name)
    assert str(caught.value).startswith(str(tmp_path / name)) and "\n" not in str(caught.value)


@given(st.integers(0, 2**32 - 1), st.integers(4, 60), st.floats(0, 0.8))
def test_triangles_of_a_star_cover_it_once_from_every_first_corner(seed, count, depth):
    random = np.random.default_rng(seed)
    angle, radius = 2 * np.pi * np.arange(count) / count, 1 + depth * random.uniform(-1, 1, count)
    x, y = radius * np.cos(angle), radius * np.sin(angle)
    shoelace = (x * np.roll(y, -1) - y * np.roll(x, -1)).sum() / 2
    points, found = np.stack([x, y, 0 * x], axis=1), []
    for first in (0, count // 2):
        faces = triangles(points, [np.roll(np.arange(count), first)[None]])
        one, two = (points[faces[:, k]] - points[faces[:, 0]] for k in (1, 2))
        areas = np.cross(one, two)[:, 2] / 2
        assert (areas > -1e-9).all() and areas.sum() == pytest.approx(shoelace, rel=1e-9)
        found.append({tuple(sorted(face)) for face in faces.tolist()})
    assert found[0] == found[1]

"""Mesh files of strangers: what they promise is checked against what they hold, and none of it
stops the program."""

import codecs
import struct

import numpy as np
import pytest

from handbench.groundtruth.mesh.mesh_files import read_mesh, read_triangles, write_mesh
from handbench.groundtruth.mesh.ply import MOST
from handbench.support.errors import HandbenchError
from handbench.support.rays import load_open3d

VERTICES_M = np.array(
    [(0, 0, 0.3), (0.1, 0, 0.4), (0, 0.1, 0.3), (0.1, 0.1, 0.35)], np.float32
).astype(np.float64)
FACES = np.array([(0, 2, 1), (1, 2, 3)])
XYZ = "property float x\nproperty float y\nproperty float z\n"
LIST = "property list uchar int vertex_indices\n"


def header(kind="binary_little_endian", vertices=4, faces=2, of_vertex=XYZ, of_face=LIST) -> bytes:
    text = (
        f"ply\nformat {kind} 1.0\ncomment c\nelement vertex {vertices}\n{of_vertex}element "
        f"face {faces}\n{of_face}"
    )
    return (text + "end_header\n").encode()


def rows(order="<", faces=FACES, values=VERTICES_M) -> bytes:
    corners = b"".join(struct.pack(f"{order}B{len(face)}i", len(face), *face) for face in faces)
    return values.astype(f"{order}f4").tobytes() + corners


def ply() -> bytes:
    return header() + rows()


def ascii_ply(lines=("3 0 2 1", "3 1 2 3"), **promises) -> bytes:
    body = [" ".join(f"{value:.9g}" for value in vertex) for vertex in VERTICES_M]
    return header("ascii", **promises) + "\n".join([*body, *lines, ""]).encode()


def obj() -> bytes:
    lines = [
        "# a hand",
        "o hand",
        *(f"v {x} {y} {z}" for x, y, z in VERTICES_M),
        "vn 0 0 1",
        "usemtl skin",
    ]
    return "\n".join([*lines, "f 1 3 2", "f -3/1/1 -2//1 -1", ""]).encode()


def stl(faces=FACES) -> bytes:
    facets = b"".join(
        bytes(12) + VERTICES_M[face].astype("<f4").tobytes() + bytes(2) for face in faces
    )
    return b"solid as some exporters begin".ljust(80) + struct.pack("<I", len(faces)) + facets


def ascii_stl() -> bytes:
    facets = [
        "facet normal 0 0 1\nouter loop\n"
        + "".join(f"vertex {x} {y} {z}\n" for x, y, z in VERTICES_M[face])
        + "endloop\nendfacet\n"
        for face in FACES
    ]
    return f"solid a\n{''.join(facets)}endsolid a\n".encode()


GOOD = {"a.ply": ply(), "b.ply": ascii_ply(), "a.obj": obj(), "a.stl": stl(), "b.stl": ascii_stl()}


def written(tmp_path, name, content):
    (tmp_path / name).write_bytes(content)
    return tmp_path / name


def test_what_open3d_writes_comes_back_in_both_byte_orders_and_with_colours(tmp_path):
    sphere = load_open3d().geometry.TriangleMesh.create_sphere(0.05, resolution=7)
    sphere.compute_vertex_normals()
    sphere.paint_uniform_color((0.2, 0.4, 0.6))
    write_mesh(tmp_path / "a.ply", sphere)
    again = read_mesh(tmp_path / "a.ply")
    assert np.array_equal(np.asarray(again.vertices), np.asarray(sphere.vertices))
    assert np.array_equal(np.asarray(again.triangles), np.asarray(sphere.triangles))
    assert {"nx", "red"} < read_triangles(tmp_path / "a.ply")[2].keys()
    big = read_triangles(written(tmp_path, "b.ply", header("binary_big_endian") + rows(">")))
    assert np.array_equal(big[0], VERTICES_M) and np.array_equal(big[1], FACES)


def test_polygons_are_cut_into_fans(tmp_path):
    faces = [(0, 2, 1), (0, 1, 3, 2)]
    lines = [" ".join(map(str, face)) for face in faces]
    of_obj = "".join(f"\nf {' '.join(str(corner + 1) for corner in face)}" for face in faces)
    for name, given in {
        "a.ply": header(faces=len(faces)) + rows(faces=faces),
        "b.ply": ascii_ply([f"{len(line.split())} {line}" for line in lines], faces=len(faces)),
        "a.obj": obj().partition(b"\nf")[0] + of_obj.encode(),
    }.items():
        found = read_triangles(written(tmp_path, name, given))[1]
        assert found.tolist() == [[0, 2, 1], [0, 1, 3], [0, 3, 2]]


MARK = codecs.BOM_UTF8
DIALECTS = {
    "mark.obj": MARK + obj(),
    "continued.obj": obj().replace(b"f 1 3 2", b"f 1 \\\n 3 \\\n 2"),
    "comments.obj": obj().replace(b"\n", b" # and more\n"),
    "lines.obj": obj().replace(b"\n", b"\r\n"),
    "mark.stl": MARK + ascii_stl(),
    "capitals.stl": ascii_stl().upper(),
    "mark.ply": MARK + ascii_ply(),
}


@pytest.mark.parametrize(("name", "content"), (GOOD | DIALECTS).items())
def test_every_form_and_dialect_holds_the_same_triangles(tmp_path, name, content):
    """Nine digits are written of float32; STL's equal corners are one vertex."""
    vertices_m, faces, more = read_triangles(written(tmp_path, name, content))
    np.testing.assert_allclose(vertices_m[faces], VERTICES_M[FACES], atol=1e-9)
    assert len(vertices_m) == 4 and more == {}


LIES = [  # a PLY's content, and words of its refusal
    (header(faces=10**8) + rows(), f"declares 100000000 of 'face', more than {MOST}"),
    (
        header(faces=MOST) + rows(),
        "declares 50000000 of 'face', which need at least 50000000 bytes",
    ),
    (header(faces=1) + rows(), "13 bytes follow after the data"),
    (header(faces=0) + rows(faces=()), "has no triangles; expected"),
    (header(of_vertex=XYZ + "property float x\n"), "declared twice"),
    (header(of_vertex=XYZ[:-17]) + rows(values=VERTICES_M[:, :2]), "have no x, y or z"),
    (header() + rows(faces=[(0, 1), (1, 2)]), "a face has 2 corners"),
    (
        header(of_face=LIST.replace("uchar", "char")) + rows()[:48] + b"\xff" * 26,
        "has the length -1",
    ),
    (header(of_face=LIST.replace("uchar", "float")) + rows(), "not declared as a whole number"),
    (header(of_face=LIST + "property x\n") + rows(), "line 10 of its header, 'property x', is not"),
    (header(of_face=LIST + "element face 0\n") + rows(), "an element is declared twice"),
    (ply()[:-1], "it ends before all 2 of 'face'"),
    (header().replace(b"format binary_little_endian 1.0\n", b""), "header has no format"),
    (ascii_ply(("3 0 2 1.5", "3 1 2 3")), "that is not a whole number"),
    (ascii_ply(("3 0 2 1", "3 1 2")), "it ends before all"),
    (header() + rows(faces=FACES + 1), "uses vertex 4, but there are only 4"),
    (header() + rows(values=np.where(VERTICES_M < 0.31, VERTICES_M, np.nan)), "2 vertices are NaN"),
    (ascii_ply().replace(b"0.400000006", b"1e30"), "a vertex is 1e+30 m from the origin"),
]


@pytest.mark.parametrize(
    ("name", "content", "message"),
    [
        *(("a.ply", *lie) for lie in LIES),
        ("a.obj", obj().replace(b"f 1 3 2", b"f 1 3 0"), "line 9, 'f 1 3 0'"),
        ("a.obj", obj().replace(b"f 1 3 2", b"f" + b" 1" * 2000), "line 9, 'f 1 1 1"),
        ("a.obj", b"v 0 0 0\nv 1 1 0\nv 1 0 0\nv 0 1 0\nf 1 2 3 4", "4 corners crosses itself"),
        ("a.obj", obj().replace(b"v 0.0", b"v 0,0"), "line 3, 'v 0,0 .*, has decimal commas"),
        ("a.obj", b"vertex 1 2 3\n" + obj(), "line 1, 'vertex 1 2 3', is not a vertex, a face"),
        ("a.stl", stl()[:-1], "its 2 triangles need 184 bytes, but the file has 183|corners"),
        ("a.stl", b"x" * 80 + struct.pack("<I", 10**8), "triangles need 5000000084 bytes, but"),
        ("a.stl", ascii_stl()[:-30], "6 corners and 1 complete triangles"),
        ("a.stl", ascii_stl().replace(b"vertex 0.0", b"vertex O.O", 1), "line 4 is not a vertex"),
        (
            "a.stl",
            ascii_stl().replace(b"solid a", b"solid\ncolour"),
            "line 2, 'colour', does not begin",
        ),
        ("a.stl", stl().replace(b"\xcd\xcc\xcc\x3d", b"\xff\xff\xff\x7f"), "are NaN"),
        ("a.gltf", b"{}", r"is not a \.ply, \.obj, \.stl file"),
    ],
)
def test_a_mesh_that_lies_is_refused_in_one_line(tmp_path, name, content, message):
    with pytest.raises(HandbenchError, match=message.replace("+", r"\+")) as caught:
        read_triangles(written(tmp_path, name, content))
    assert str(caught.value).startswith(str(tmp_path / name)) and "\n" not in str(caught.value)

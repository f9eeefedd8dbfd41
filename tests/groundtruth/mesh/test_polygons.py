"""Polygons of mesh files become the triangles that they are, whatever their shape and order."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from handbench.groundtruth.mesh.mesh_files import read_triangles
from handbench.groundtruth.mesh.polygons import triangles
from handbench.support.errors import HandbenchError

L_SHAPE = np.array([(0, 0), (2, 0), (2, 1), (1, 1), (1, 3), (0, 3)], float)  # area 4
CROSSED = np.array([(0, 0), (1, 1), (1, 0), (0, 1)], float)
PENTAGRAM = np.array([(np.cos(a), np.sin(a)) for a in 4 * np.pi / 5 * np.arange(5)])


def areas(points: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """Directed areas [m, 3] of triangles."""
    one, two = (points[faces[:, k]] - points[faces[:, 0]] for k in (1, 2))
    return np.cross(one, two) / 2


@given(st.integers(0, 2**32 - 1), st.integers(4, 60), st.floats(0, 0.8))
def test_triangles_of_a_star_cover_it_once_from_every_first_corner(seed, count, depth):
    rng = np.random.default_rng(seed)
    angle, radius = 2 * np.pi * np.arange(count) / count, 1 + depth * rng.uniform(-1, 1, count)
    x, y = radius * np.cos(angle), radius * np.sin(angle)
    turn, _ = np.linalg.qr(rng.normal(size=(3, 3)))
    points = np.stack([x, y, 0 * x], axis=1) @ turn.T + rng.normal(size=3)
    normal = turn[:, 2] * np.linalg.det(turn)
    shoelace = (x * np.roll(y, -1) - y * np.roll(x, -1)).sum() / 2
    found = []
    for first in (0, 1, count // 2):
        faces = triangles(points, [np.roll(np.arange(count), first)[None]])
        along = areas(points, faces) @ normal
        assert (along > -1e-9).all() and along.sum() == pytest.approx(shoelace, rel=1e-9)
        found.append({tuple(sorted(face)) for face in faces.tolist()})
    assert found[0] == found[1] == found[2]


@pytest.mark.parametrize("shape", [CROSSED, CROSSED * [1, 2] + [[0, 0], [0, 0.3], [0, 0], [0, 0]]])
def test_a_polygon_that_crosses_itself_is_refused(shape):
    with pytest.raises(ValueError, match="crosses itself"):
        triangles(np.pad(shape, ((0, 0), (0, 1))), [np.arange(len(shape))[None]])


def test_a_pentagram_is_refused():
    with pytest.raises(ValueError, match="crosses itself"):
        triangles(np.pad(PENTAGRAM, ((0, 0), (0, 1))), [np.arange(5)[None]])


def obj(points: np.ndarray, face: list[int]) -> str:
    lines = [f"v {x} {y} {z}" for x, y, z in points.tolist()]
    return "\n".join([*lines, "f " + " ".join(str(k + 1) for k in face), ""])


def ply(points: np.ndarray, face: list[int]) -> str:
    head = f"ply\nformat ascii 1.0\nelement vertex {len(points)}\n"
    head += "".join(f"property double {axis}\n" for axis in "xyz")
    head += "element face 1\nproperty list uchar int vertex_indices\nend_header\n"
    rows = [f"{x} {y} {z}" for x, y, z in points.tolist()]
    return head + "\n".join([*rows, f"{len(face)} " + " ".join(map(str, face)), ""])


@pytest.mark.parametrize("write", [obj, ply])
@pytest.mark.parametrize("first", range(6))
def test_a_concave_polygon_has_its_area_in_every_reader(tmp_path, write, first):
    points = np.pad(L_SHAPE, ((0, 0), (0, 1)))
    file = tmp_path / f"l.{write.__name__}"
    file.write_text(write(points, np.roll(np.arange(6), first).tolist()))
    vertices_m, faces, _ = read_triangles(file)
    directed = areas(vertices_m, faces)
    np.testing.assert_allclose(directed.sum(axis=0), [0, 0, 4], atol=1e-12)
    assert np.linalg.norm(directed, axis=1).sum() == pytest.approx(4, rel=1e-12)


@pytest.mark.parametrize("write", [obj, ply])
def test_a_crossed_face_of_a_file_is_named(tmp_path, write):
    file = tmp_path / f"x.{write.__name__}"
    file.write_text(write(np.pad(CROSSED, ((0, 0), (0, 1))), [0, 1, 2, 3]))
    with pytest.raises(HandbenchError, match="a face of 4 corners crosses itself"):
        read_triangles(file)


MARK = "\N{ZERO WIDTH NO-BREAK SPACE}"
PLAIN = "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n"
FACET = (
    "facet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex 1 0 0\nvertex 0 1 0\nendloop\nendfacet"
)
DIALECTS = {
    "mark.obj": MARK + PLAIN,
    "continued.obj": PLAIN.replace("f 1 2 3", "f 1 \\\n 2 \\\n 3"),
    "comments.obj": "# a triangle\n" + PLAIN.replace("\n", " # and more\n"),
    "textured.obj": "mtllib a.mtl\no a\ng b\ns off\n"
    + PLAIN.replace("f 1 2 3", "f 1/1/1 2/1/1 -1"),
    "lines.obj": PLAIN.replace("\n", "\r\n"),
    "mark.stl": f"{MARK}solid a\n{FACET}\nendsolid a\n",
    "capitals.stl": f"SOLID A\n{FACET.upper()}\nENDSOLID A\n",
    "mark.ply": MARK + ply(np.array([(0, 0, 0), (1, 0, 0), (0, 1, 0.0)]), [0, 1, 2]),
}


@pytest.mark.parametrize("name", DIALECTS)
def test_one_triangle_is_read_from_every_dialect(tmp_path, name):
    (tmp_path / name).write_text(DIALECTS[name], encoding="utf-8", newline="")
    vertices_m, faces, _ = read_triangles(tmp_path / name)
    np.testing.assert_array_equal(areas(vertices_m, faces), [[0, 0, 0.5]])


REFUSED = {
    "commas.obj": (PLAIN.replace("1 0 0", "1,5 0 0"), "line 2, 'v 1,5 0 0', has decimal commas"),
    "commas.stl": (f"solid\n{FACET.replace('1 0 0', '1,5 0 0')}\nendsolid", "decimal commas"),
    "unknown.obj": ("vertex 1 2 3\n" + PLAIN, "line 1, 'vertex 1 2 3', is no vertex, face"),
    "unknown.stl": (f"solid\ncolour 1\n{FACET}\nendsolid", "line 2, 'colour 1', begins with no"),
}


@pytest.mark.parametrize("name", REFUSED)
def test_a_line_that_is_not_understood_is_named(tmp_path, name):
    text, words = REFUSED[name]
    (tmp_path / name).write_text(text)
    with pytest.raises(HandbenchError) as refused:
        read_triangles(tmp_path / name)
    assert words in str(refused.value) and name in str(refused.value)

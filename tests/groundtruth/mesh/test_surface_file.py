"""Surfaces in files: ours, and those of others, which are believed only as far as they hold
together."""

import numpy as np
import pytest

from handbench.groundtruth.mesh.mesh_files import mesh, write_mesh
from handbench.groundtruth.mesh.surface import FACE, VERTEX, Surface, read_surface
from handbench.support.errors import HandbenchError

VERTICES_M = np.array([(0, 0, 0.3), (0.1, 0, 1 / 3), (0, 0.1, 0.3), (0.1, 0.1, 0.3 + 1e-15)])
FACES = np.array([(0, 2, 1), (1, 2, 3)])
FACE_LINES = "element face 1\nproperty list uchar int vertex_indices\n"
XYZ = "property float x\nproperty float y\nproperty float z\n"


@pytest.fixture
def surface():
    return Surface(
        VERTICES_M,
        FACES,
        np.array([1e-5, 2.5e-5, np.nan, 1.0]),
        np.array([True, False, True, False]),
    )


def test_everything_comes_back(tmp_path, surface):
    for name in ("a.ply", "B.PLY"):
        surface.save(tmp_path / name)
        found = read_surface(tmp_path / name)
        np.testing.assert_array_equal(found.vertices_m, VERTICES_M)  # all 64 bits
        np.testing.assert_array_equal(found.faces, FACES)
        np.testing.assert_array_equal(found.sigma_m, surface.sigma_m.astype(np.float32))
        np.testing.assert_array_equal(found.observed, surface.observed)
        assert found.sigma_m.dtype == np.float64 and found.observed.dtype == bool
    assert {path.name for path in tmp_path.iterdir()} == {"a.ply", "B.PLY"}


def test_the_same_surface_is_the_same_file(tmp_path, surface):
    for name in ("a.ply", "b.ply"):
        surface.save(tmp_path / name)
    assert (tmp_path / "a.ply").read_bytes() == (tmp_path / "b.ply").read_bytes()


@pytest.mark.parametrize("suffix", ["ply", "obj", "stl"])
def test_a_mesh_of_others_is_taken_as_seen_everywhere(tmp_path, suffix):
    path = tmp_path / f"other.{suffix}"
    if suffix == "ply":
        write_mesh(path, mesh(VERTICES_M, FACES))
    elif suffix == "obj":
        rows = [f"v {x} {y} {z}\n" for x, y, z in VERTICES_M] + [
            f"f {a} {b} {c}\n" for a, b, c in FACES + 1
        ]
        path.write_text("".join(rows))
    else:
        corners = "".join(
            "facet normal 0 0 -1\nouter loop\n"
            + "".join(f"vertex {x} {y} {z}\n" for x, y, z in VERTICES_M[face])
            + "endloop\nendfacet\n"
            for face in FACES
        )
        path.write_text(f"solid a\n{corners}endsolid a\n")
    found = read_surface(path)
    np.testing.assert_allclose(
        found.vertices_m[found.faces], VERTICES_M[FACES], atol=1e-7
    )  # STL has 32 bits
    assert np.isnan(found.sigma_m).all() and found.observed.all()
    assert len(found.sigma_m) == len(found.observed) == len(found.vertices_m)


def written(path, vertex_properties, rows, face_properties="", face="3 0 1 2"):
    header = (
        "ply\nformat ascii 1.0\nelement vertex "
        f"3\n{vertex_properties}{FACE_LINES}{face_properties}end_header"
    )
    path.write_text("\n".join([header, *rows, face, ""]))
    return read_surface(path)


def test_one_of_the_two_is_enough_and_of_any_type(tmp_path):
    found = written(
        tmp_path / "a.ply",
        "property uchar observed\n" + XYZ + "property uchar red\n",
        ("1 0 0 0 200", "0 1 0 0 200", "1 0 1 0 200"),
    )
    assert found.observed.tolist() == [True, False, True] and np.isnan(found.sigma_m).all()
    found = written(
        tmp_path / "b.ply",
        XYZ.replace("float", "double") + "property double sigma_m\nproperty int observed\n",
        ("0 0 0 1e-5 1", "1 0 0 2e-5 -1", "0 1 0 3e-5 7"),
    )
    np.testing.assert_array_equal(found.sigma_m, [1e-5, 2e-5, 3e-5])
    assert found.observed.tolist() == [True, False, True]  # what is not plainly seen was not


def test_lists_and_what_faces_carry_are_none_of_it(tmp_path):
    found = written(
        tmp_path / "a.ply",
        XYZ + "property list uchar float sigma_m\n",
        ("0 0 0 1 9", "1 0 0 1 9", "0 1 0 1 9"),
    )
    assert np.isnan(found.sigma_m).all()
    found = written(
        tmp_path / "b.ply",
        XYZ,
        ("0 0 0", "1 0 0", "0 1 0"),
        "property float sigma_m\n",
        "3 0 1 2 9",
    )
    assert np.isnan(found.sigma_m).all()


@pytest.mark.parametrize("counts", [(5, 2), (10**12, 2), (-4, 2), (0, 0)])
def test_a_header_that_promises_other_counts_is_refused(tmp_path, surface, counts):
    surface.save(tmp_path / "a.ply")
    content = (tmp_path / "a.ply").read_bytes()
    for element, before, after in zip(("vertex", "face"), (4, 2), counts, strict=True):
        content = content.replace(
            f"element {element} {before}".encode(), f"element {element} {after}".encode()
        )
    (tmp_path / "a.ply").write_bytes(content)
    with pytest.raises(HandbenchError, match=r"a\.ply: holds no triangles"):
        read_surface(tmp_path / "a.ply")


@pytest.mark.parametrize(
    "length", [0, 3, 100, -VERTEX.itemsize - 2 * FACE.itemsize, -FACE.itemsize - 1]
)
def test_a_file_that_was_cut_is_refused(tmp_path, surface, length):
    surface.save(tmp_path / "a.ply")
    content = (tmp_path / "a.ply").read_bytes()
    (tmp_path / "a.ply").write_bytes(content[:length])
    with pytest.raises(HandbenchError, match=r"a\.ply: holds no triangles"):
        read_surface(tmp_path / "a.ply")


def test_broken_numbers_and_missing_files_are_refused(tmp_path, surface):
    broken = Surface(
        np.where(VERTICES_M == 0.3, np.nan, VERTICES_M), FACES, surface.sigma_m, surface.observed
    )
    broken.save(tmp_path / "a.ply")
    with pytest.raises(HandbenchError, match="2 vertices are NaN or infinite"):
        read_surface(tmp_path / "a.ply")
    Surface(VERTICES_M, FACES + 1, surface.sigma_m, surface.observed).save(tmp_path / "b.ply")
    with pytest.raises(HandbenchError, match="a face names vertex 4, but there are 4"):
        read_surface(tmp_path / "b.ply")
    with pytest.raises(HandbenchError, match="expected a triangle mesh"):
        read_surface(tmp_path / "missing.ply")

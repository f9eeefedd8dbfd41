"""Surfaces in files: ours, and those of others."""

import numpy as np

from handbench.groundtruth.mesh.surface import Surface, read_surface

HEADER = (
    "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\n"
    "property float z\n{}element face 1\nproperty list uchar int vertex_indices\nend_header\n"
)
VERTICES_M = np.array([(0, 0, 0.3), (0.1, 0, 1 / 3), (0, 0.1, 0.3), (0.1, 0.1, 0.3 + 1e-15)])
FACES = np.array([(0, 2, 1), (1, 2, 3)])


def test_everything_comes_back(tmp_path):
    sigma_m, observed = np.array([1e-5, 2.5e-5, np.nan, 1.0]), np.array([True, False, True, False])
    surface = Surface(VERTICES_M, FACES, sigma_m, observed, VERTICES_M[::-1] / 3)
    for name in ("a.ply", "B.PLY"):
        surface.save(tmp_path / name)
        found = read_surface(tmp_path / name)
        np.testing.assert_array_equal(found.vertices_m, VERTICES_M)  # all 64 bits
        np.testing.assert_array_equal(found.faces, FACES)
        np.testing.assert_array_equal(found.sigma_m, surface.sigma_m.astype(np.float32))
        np.testing.assert_array_equal(found.observed, surface.observed)
        np.testing.assert_array_equal(found.velocity_m_s, surface.velocity_m_s)
        assert found.sigma_m.dtype == np.float64 and found.observed.dtype == bool
    assert (tmp_path / "a.ply").read_bytes() == (tmp_path / "B.PLY").read_bytes()


def test_one_of_the_two_is_enough_and_of_any_type(tmp_path):
    """What is not plainly seen was not; a mesh that says nothing was seen everywhere."""
    for extra, rows, observed, sigma_m in (
        ("", ("", "", ""), [True] * 3, [np.nan] * 3),
        ("property int observed\n", ("1", "-1", "0"), [True, False, False], [np.nan] * 3),
        ("property double sigma_m\n", ("1e-5", "2e-5", "3e-5"), [True] * 3, [1e-5, 2e-5, 3e-5]),
    ):
        places = ("0 0 0", "1 0 0", "0 1 0")
        lines = [f"{place} {row}" for place, row in zip(places, rows, strict=True)]
        (tmp_path / "a.ply").write_text(HEADER.format(extra) + "\n".join([*lines, "3 0 1 2", ""]))
        found = read_surface(tmp_path / "a.ply")
        assert found.observed.tolist() == observed
        np.testing.assert_array_equal(found.sigma_m, sigma_m)

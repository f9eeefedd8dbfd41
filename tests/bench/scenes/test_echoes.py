"""Echoes of scenes: what the array sees scatters, what is hidden does not, and noise is all that frames differ in."""

import numpy as np
import pytest

from bench.scenes.echoes import echoes, visible_surface
from bench.scenes.scene import SceneFile, build
from calibration.meshes import load_open3d, write_mesh
from radar.config import parse
from radar.errors import HandbenchError

TONES = {"sweep": [], "tones_hz": [82e9, 81.8e9]}


def scene(folder, surface, **changes):
    write_mesh(folder / "body.ply", surface)
    target = {"kind": "mesh", "path": "body.ply", "distance_m": 0.3}
    return build(
        parse(SceneFile, {"version": 1, "name": "s", "seed": 5, "target": target, "sensor": TONES, **changes}, "test"),
        folder,
    )


def ball(radius_m=0.02, z_m=0.0, resolution=40):
    return load_open3d().geometry.TriangleMesh.create_sphere(radius_m, resolution).translate((0, 0, z_m))


def test_only_the_near_side_of_a_ball_is_seen(tmp_path):
    surface = visible_surface(scene(tmp_path, ball()), 0.00366)
    # From a distance R one sees the cap of height a(1 − a/R) of a sphere: area 2πa²(1 − a/R), here 0.00235 m².
    assert surface.weight.sum() == pytest.approx(2 * np.pi * 0.02**2 * (1 - 0.02 / 0.3), rel=0.02)
    assert (surface.position_m[:, 2] < 0.30).all()
    assert np.linalg.norm(surface.normal, axis=1) == pytest.approx(1)


def test_what_stands_behind_is_in_the_shadow(tmp_path):
    both = visible_surface(scene(tmp_path, ball() + ball(0.015, 0.05)), 0.00366)
    alone = visible_surface(scene(tmp_path, ball()), 0.00366)
    assert both.weight.sum() == pytest.approx(alone.weight.sum(), rel=1e-6)


def test_frames_differ_in_their_noise_alone(tmp_path):
    noisy = echoes(scene(tmp_path, ball(), noise={"phase_noise_rad": 0.03}), frames=3).samples
    clean = echoes(scene(tmp_path, ball()), frames=3).samples
    assert np.array_equal(clean[0], clean[2])
    deviation = noisy - clean
    assert not np.array_equal(deviation[0], deviation[1])
    level = np.sqrt(np.mean(np.abs(deviation) ** 2, axis=(2, 3)))
    assert level == pytest.approx(level.mean(), rel=0.05)  # 8836 draws each: 0.5 % (1σ)
    again = echoes(scene(tmp_path, ball(), noise={"phase_noise_rad": 0.03}), frames=2).samples
    assert np.array_equal(again, noisy[:2])  # a frame does not depend on how many there are


def test_coarse_meshes_are_split_until_they_sample_the_wavelength(tmp_path):
    surface = visible_surface(scene(tmp_path, ball(resolution=10)), 0.00366)
    # A quarter of the wavelength bounds the edges, and with them the facets' area: √3/4 · (0.915 mm)².
    assert surface.weight.max() < np.sqrt(3) / 4 * 0.000915**2 * 1.01
    with pytest.raises(HandbenchError, match="remesh"):
        visible_surface(scene(tmp_path, ball(0.02)), 1e-5)


def test_a_mesh_turned_inside_out_is_refused(tmp_path):
    inside_out = ball()
    inside_out.triangles = load_open3d().utility.Vector3iVector(np.asarray(inside_out.triangles)[:, ::-1].copy())
    with pytest.raises(HandbenchError, match="no facet faces the array"):
        visible_surface(scene(tmp_path, inside_out), 0.00366)

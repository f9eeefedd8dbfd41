"""A mesh on a radar depth map: known motions of an analytic surface, and what it must not pretend
to know."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter
from scipy.spatial import Delaunay
from scipy.spatial.transform import Rotation
from scipy.stats import chi2

from handbench.calibration.refine import refine
from handbench.calibration.transforms import Transform, identity, load_transform
from handbench.cli.main import main
from handbench.groundtruth.mesh.surface import Surface
from handbench.radar.data.depthmap import DepthMap
from tests.refusals import refuse

AXIS_M = np.arange(-0.06, 0.0601, 0.003)
FLAT_M = np.full((len(AXIS_M), len(AXIS_M)), 0.3)
CENTRE_M = np.array([0.0, 0.0, 0.3])
HALF_M = 0.1  # of the surfaces, which are square
STILL = identity("radar")


def bumps(x, y):
    """A hand-like relief: four ridges of 6 mm across a vault of 25 mm, with no symmetry; slopes up
    to 45°."""
    ridges = 0.004 * np.sin(100 * x + 20 * y) + 0.003 * np.sin(80 * y - 30 * x + 1)
    return 0.3 + 2.5 * (x**2 + 1.3 * y**2) + ridges


def plane(x, y):
    return 0.3 + 0.1 * x + 0 * y


def seen(height, radar_from_mesh: Transform = STILL) -> np.ndarray:
    """What a radar without errors would measure of a moved surface z = height(x, y): each step
    leaves less than a fifth of the error for turns up to 5°."""
    points_m = np.stack([*np.meshgrid(AXIS_M, AXIS_M), FLAT_M], axis=2)
    for _ in range(15):
        x, y, z = np.moveaxis(radar_from_mesh.inverse().points(points_m), 2, 0)
        points_m[..., 2] += height(x.clip(-HALF_M, HALF_M), y.clip(-HALF_M, HALF_M)) - z
    return np.where(np.maximum(abs(x), abs(y)) < HALF_M, points_m[..., 2], np.nan)


def depth_of(z_m: np.ndarray, **optional: np.ndarray) -> DepthMap:
    silent = np.zeros(z_m.shape, np.float32)
    return DepthMap(AXIS_M, AXIS_M[: len(z_m)], z_m, silent, "test", **optional)


def motion(shift_mm, turn_deg, covariance=None) -> Transform:
    """A small motion about CENTRE_M."""
    matrix = np.eye(4)
    matrix[:3, :3] = Rotation.from_rotvec(np.radians(turn_deg)).as_matrix()
    matrix[:3, 3] = CENTRE_M + np.array(shift_mm) / 1e3 - matrix[:3, :3] @ CENTRE_M
    return Transform("photo", "radar", matrix, covariance)


def refined(height, z_m: np.ndarray, start: Transform = STILL, **optional) -> Transform:
    return refine(lambda moved: seen(height, moved)[: len(z_m)], depth_of(z_m, **optional), start)


def apart_mm(one: Transform, other: Transform) -> float:
    """Largest distance between the two on points of the surface."""
    points_m = CENTRE_M + 0.05 * np.array([[1, 1, 0], [1, -1, 0], [-1, 1, 0], [-1, -1, 0.0]])
    return 1e3 * float(np.linalg.norm(one.points(points_m) - other.points(points_m), axis=1).max())


def misfit(found: Transform, truth: Transform) -> float:
    """eᵀC⁻¹e of the error e of a transform, with its covariance C."""
    change = found.matrix @ np.linalg.inv(truth.matrix)
    error = np.r_[change[:3, 3], Rotation.from_matrix(change[:3, :3]).as_rotvec()]
    return float(error @ np.linalg.solve(found.require_covariance(), error))


@pytest.mark.parametrize(
    ("shift_mm", "turn_deg", "scale"), [((0, 0, 3), (0, 0, 0), 1.02), ((6, -5, 6), (3, 2, -3.5), 1)]
)
def test_a_known_motion_comes_back_and_the_scale_stays(shift_mm, turn_deg, scale):
    """What is left is the square of the last step, which is less than 10 µm."""
    truth, start = motion(shift_mm, turn_deg), np.diag([scale, scale, scale, 1])

    def scaled(x, y):
        return bumps(x * scale, y * scale) / scale

    found = refined(scaled, seen(bumps, truth), Transform("photo", "radar", start))
    assert apart_mm(found, Transform("photo", "radar", truth.matrix @ start)) < 0.001
    assert "nothing" in found.refined


@pytest.mark.parametrize("reach_pixels", [0, 2])
def test_the_covariance_is_honest(rng, reach_pixels):
    """Errors squared against the covariance, six per run, for noise of 0.2 mm that pixels share
    over a reach that is not known: χ² of 6 degrees of freedom has the mean 6 ± 0.8 over 20 runs;
    its bounds are three times that away. Where it is right already, the mesh stays within it."""
    clean, squares = seen(bumps), []
    for _ in range(20):
        noise = gaussian_filter(rng.standard_normal(clean.shape), reach_pixels)
        squares.append(misfit(refined(bumps, clean + 2e-4 * noise / noise.std()), STILL))
    assert 3.6 < np.mean(squares) < 8.4


def test_a_fifth_of_garbage_does_not_pull(rng):
    truth = motion((1, -2, 2), (1, 1, -1))
    z_m = seen(bumps, truth) + 1e-4 * rng.standard_normal(FLAT_M.shape)
    stranger = rng.random(z_m.shape) < 0.2
    z_m[stranger] += rng.uniform(0.005, 0.03, stranger.sum())  # all on one side
    found = refined(bumps, z_m)
    assert misfit(found, truth) < chi2.ppf(0.99, 6) and apart_mm(found, truth) < 0.06


def test_along_what_a_plane_does_not_determine_the_start_and_its_covariance_stay():
    """Shift along the plane and rotation about its normal n are not moved: a rotation by ω carries
    them along at second order, ω² × 0.1 m = 0.03 mm. What is left of the covariance C of the start
    is (1 − nnᵀ)C(1 − nnᵀ) of a shift, nnᵀCnnᵀ of a rotation, to what the mean pixel is off
    CENTRE_M."""
    truth, spread = motion((0, 0, 2), (0.5, -0.5, 0)), np.diag([4e-6, 1e-6, 9e-6, 1e-6, 1e-6, 1e-4])
    start = motion((0, 0, 0), (0, 0, 0), spread)
    found = refined(plane, seen(plane, truth), start)
    np.testing.assert_allclose(seen(plane, found), seen(plane, truth), atol=1e-6)
    normal = np.array([-0.1, 0, 1]) / np.hypot(0.1, 1)
    across = np.outer(normal, normal)
    shift_mm = 1e3 * (found.points(CENTRE_M) - CENTRE_M)
    turn_deg = np.degrees(Rotation.from_matrix(found.rotation).as_rotvec())
    assert np.linalg.norm(shift_mm - across @ shift_mm) < 0.03 and abs(normal @ turn_deg) < 0.01
    along = np.eye(3) - across
    for covariance, expected in (
        (found.point_covariance(CENTRE_M), along @ start.point_covariance(CENTRE_M) @ along),
        (found.covariance[3:, 3:], across @ spread[3:, 3:] @ across),
    ):
        np.testing.assert_allclose(covariance, expected, atol=0.01 * np.abs(expected).max())


@pytest.mark.parametrize(
    ("start_mm", "lines", "place"),
    [
        ((300, 0, 0), 41, "0 pixels"),
        ((150, 100, 0), 41, "pixels"),
        ((0, 0, 40), 41, "40.0 mm"),
        ((0, 0, 0), 1, "(1, 41)"),
    ],
)
def test_what_cannot_be_trusted_is_refused(start_mm, lines, place):
    z_m, start = seen(bumps)[:lines], motion(start_mm, (0, 0, 0))
    refuse(lambda: refined(bumps, z_m, start), "refine", place)


def test_pixels_that_may_have_wrapped_or_show_no_surface_are_left_out():
    """Two thirds of the map are wrong: too many for any robust fit."""
    z_m, start = seen(bumps), motion((0.5, 0, 1), (0, 0, 0.3))
    wrapped = np.zeros(z_m.shape, bool)
    wrapped[:, 14:] = True
    found = refined(bumps, np.where(wrapped, z_m + 0.03, z_m), start, wrapped=wrapped)
    assert apart_mm(found, STILL) < 0.01

    def third(x, y):
        return np.where(x < -0.02, bumps(x, y), np.nan)

    assert apart_mm(refined(third, z_m, start), STILL) < 0.01


def test_the_command_writes_the_transform_or_that_there_is_no_covariance(
    tmp_path, capsys, monkeypatch
):
    """Triangles of 3 mm on a curvature of 40/m are off by 0.05 mm at most."""
    monkeypatch.chdir(tmp_path)
    truth = motion((0, 1, 2), (0.5, 0, 0))
    STILL.save("start.json")
    x, y = (axis_m.ravel() for axis_m in np.meshgrid(*[np.linspace(-HALF_M, HALF_M, 61)] * 2))
    faces = Delaunay(np.stack([x, y], axis=1)).simplices
    for height in (bumps, plane):
        vertices_m, name = np.stack([x, y, height(x, y)], axis=1), height.__name__
        surface = Surface(vertices_m, faces, np.full(len(x), np.nan), np.ones(len(x), bool))
        surface.save(tmp_path / f"{name}.ply")
        depth_of(seen(height, truth)).save(tmp_path / f"{name}.npz")
        command = f"calibrate --refine {name}.npz --mesh {name}.ply -o {name}.json"
        assert main([*command.split(), "--transform", "start.json"]) == 0
    assert "x, y, rotation about z" in capsys.readouterr().err
    found = load_transform(tmp_path / "bumps.json")
    assert apart_mm(found, truth) < 0.05 and found.covariance is not None
    assert load_transform(tmp_path / "plane.json").covariance is None

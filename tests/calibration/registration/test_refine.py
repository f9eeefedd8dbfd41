"""A mesh on a radar depth map: known motions of an analytic surface, and what it must not pretend
to know."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter
from scipy.spatial.transform import Rotation
from scipy.stats import chi2

from handbench.calibration.registration.refine import refine
from handbench.calibration.transforms import Transform, identity, load_transform
from handbench.cli.main import main
from handbench.groundtruth.mesh.depth import reference_on_grid
from handbench.groundtruth.mesh.surface import Surface
from handbench.radar.data.depthmap import DepthMap
from handbench.support.errors import HandbenchError

AXIS_M = np.arange(-0.06, 0.0601, 0.002)
CENTRE_M = np.array([0.0, 0.0, 0.3])


def bumps(x, y):
    """A hand-like relief: four ridges of 6 mm across a vault of 25 mm, with no symmetry; slopes up
    to 45°."""
    ridges = 0.004 * np.sin(100 * x + 20 * y) + 0.003 * np.sin(80 * y - 30 * x + 1)
    return 0.3 + 2.5 * (x**2 + 1.3 * y**2) + ridges


def surface_of(height, half_m: float = 0.1, count: int = 81) -> Surface:
    """z = height(x, y) as triangles over a square."""
    axis = np.linspace(-half_m, half_m, count)
    x, y = (grid.ravel() for grid in np.meshgrid(axis, axis))
    corner = np.arange(count**2).reshape(count, count)[:-1, :-1].ravel()[:, None]
    halves = [(0, count, 1), (1, count, count + 1)]
    faces = np.concatenate([corner + half for half in halves])
    vertices_m = np.stack([x, y, height(x, y)], axis=1)
    return Surface(vertices_m, faces, np.full(len(x), np.nan), np.ones(len(x), bool))


BUMPS = surface_of(bumps)


def depth_of(z_m: np.ndarray, **optional: np.ndarray) -> DepthMap:
    return DepthMap(AXIS_M, AXIS_M, z_m, np.zeros(z_m.shape, np.float32), "test", **optional)


def seen(
    surface: Surface,
    radar_from_mesh: Transform = identity("radar"),  # noqa: B008 (immutable)
) -> np.ndarray:
    """What a radar without errors would measure of the surface."""
    return reference_on_grid(surface.moved(radar_from_mesh), AXIS_M, AXIS_M).z_m


def motion(shift_mm, turn_deg, covariance=None) -> Transform:
    """A small motion about CENTRE_M."""
    matrix = np.eye(4)
    matrix[:3, :3] = Rotation.from_rotvec(np.radians(turn_deg)).as_matrix()
    matrix[:3, 3] = CENTRE_M + np.array(shift_mm) / 1e3 - matrix[:3, :3] @ CENTRE_M
    return Transform("photo", "radar", matrix, covariance)


def refined(surface: Surface, z_m: np.ndarray, start: Transform, **optional) -> Transform:
    return refine(lambda moved: seen(surface, moved), depth_of(z_m, **optional), start)


def apart_mm(one: Transform, other: Transform) -> float:
    """Largest distance between the two on points of the surface."""
    points_m = CENTRE_M + 0.05 * np.array([[1, 1, 0], [1, -1, 0], [-1, 1, 0], [-1, -1, 0.0]])
    return 1e3 * float(np.linalg.norm(one.points(points_m) - other.points(points_m), axis=1).max())


def misfit(found: Transform, truth: Transform) -> float:
    """eᵀC⁻¹e of the error e of a transform, with its covariance C."""
    change = found.matrix @ np.linalg.inv(truth.matrix)
    error = np.r_[change[:3, 3], Rotation.from_matrix(change[:3, :3]).as_rotvec()]
    return float(error @ np.linalg.solve(found.require_covariance(), error))


@pytest.fixture
def rng() -> np.random.Generator:
    return np.random.default_rng(5)


@pytest.mark.parametrize(("shift_mm", "turn_deg", "scale"), [
    ((0, 0, 3), (0, 0, 0), 1.02), ((6, -5, 6), (3, 2, -3.5), 1)
])  # fmt: skip
def test_a_known_motion_comes_back_and_the_scale_stays(shift_mm, turn_deg, scale):
    """What is left is the ray caster's single precision, below 1 µm along z, and ten times that
    along the directions that the surface determines least."""
    truth, start = motion(shift_mm, turn_deg), np.diag([scale, scale, scale, 1])
    mesh = Surface(BUMPS.vertices_m / scale, BUMPS.faces, BUMPS.sigma_m, BUMPS.observed)
    found = refined(mesh, seen(BUMPS, truth), Transform("photo", "radar", start))
    assert apart_mm(found, Transform("photo", "radar", truth.matrix @ start)) < 0.01
    assert "mm to 0.00" in found.refined and "not determined: nothing" in found.refined


@pytest.mark.parametrize("reach_pixels", [0, 2])
def test_the_covariance_is_honest(rng, reach_pixels):
    """Errors squared against the covariance, six per run, for noise of 0.2 mm that pixels share
    over a reach that is not known: χ² of 6 degrees of freedom has the mean 6 ± 0.8 over 20 runs;
    its bounds are three times that away. Where it is right already, the mesh stays within it."""
    clean, squares = seen(BUMPS), []
    for _ in range(20):
        noise = gaussian_filter(rng.standard_normal(clean.shape), reach_pixels)
        found = refined(BUMPS, clean + 2e-4 * noise / noise.std(), identity("radar"))
        squares.append(misfit(found, identity("radar")))
    assert 3.6 < np.mean(squares) < 8.4


def test_a_fifth_of_garbage_does_not_pull(rng):
    truth = motion((1, -2, 2), (1, 1, -1))
    z_m = seen(BUMPS, truth) + 1e-4 * rng.standard_normal((61, 61))
    stranger = rng.random(z_m.shape) < 0.2
    z_m[stranger] += rng.uniform(0.005, 0.03, stranger.sum())  # all on one side
    found = refined(BUMPS, z_m, identity("radar"))
    assert misfit(found, truth) < chi2.ppf(0.99, 6) and apart_mm(found, truth) < 0.06


def test_a_plane_determines_three_directions_and_keeps_the_others(rng):
    """Shift along the plane and rotation about its normal are not moved: a rotation by ω carries
    them along at second order, ω² × 0.1 m = 0.03 mm."""
    plane, truth = surface_of(lambda x, y: 0.3 + 0.1 * x), motion((0, 0, 2), (0.5, -0.5, 0))
    found = refined(plane, seen(plane, truth), identity("radar"))
    assert "not determined: x, y, rotation about z;" in found.refined and found.covariance is None
    np.testing.assert_allclose(seen(plane, found), seen(plane, truth), atol=1e-6)
    normal = np.array([-0.1, 0, 1]) / np.hypot(0.1, 1)
    shift_mm = 1e3 * (found.points(CENTRE_M) - CENTRE_M)
    turn_deg = np.degrees(Rotation.from_matrix(found.rotation).as_rotvec())
    assert np.linalg.norm(shift_mm - normal * (normal @ shift_mm)) < 0.03
    assert abs(normal @ turn_deg) < 0.01
    flat = surface_of(lambda x, y: 0.3 + 0 * x)
    noisy_m = seen(flat) + 1e-4 * rng.standard_normal((61, 61))
    start = motion((0, 0, 0), (0, 0, 0), np.diag([4e-6, 1e-6, 9e-6, 1e-6, 1e-6, 1e-4]))
    found = refined(flat, noisy_m, start)
    ratio = np.diag(found.point_covariance(CENTRE_M)) / np.diag(start.point_covariance(CENTRE_M))
    np.testing.assert_allclose(ratio[:2], 1, rtol=0.02)  # σ to 1 %: the plane's estimated tilt
    assert ratio[2] < 0.03**2
    assert found.covariance[5, 5] == pytest.approx(1e-4, rel=0.01)


def test_a_sphere_determines_no_rotation(rng):
    sphere = surface_of(lambda x, y: 0.3 + 0.15 - np.sqrt(0.15**2 - x**2 - y**2), half_m=0.07)
    noisy_m = seen(sphere) + 1e-4 * rng.standard_normal((61, 61))
    found = refined(sphere, noisy_m, identity("radar"))
    assert "rotation about z" in found.refined and found.covariance is None


@pytest.mark.parametrize(
    ("start_mm", "lines", "expected"),
    [
        ((300, 0, 0), 61, "share 0 pixels"),
        ((150, 100, 0), 61, "refine: "),
        ((0, 0, 40), 61, "would move the mesh by 40.0 mm and 0.0°"),
        ((0, 0, 0), 1, "expected at least 2 × 2"),
    ],
)
def test_what_cannot_be_trusted_is_refused(start_mm, lines, expected):
    z_m = seen(BUMPS)[:lines]
    depth = DepthMap(AXIS_M, AXIS_M[:lines], z_m, np.zeros(z_m.shape, np.float32), "test")
    with pytest.raises(HandbenchError, match=expected):
        refine(lambda moved: seen(BUMPS, moved)[:lines], depth, motion(start_mm, (0, 0, 0)))


def test_pixels_that_may_have_wrapped_and_invented_surface_are_left_out():
    """Two thirds of the map are wrong: too many for any robust fit."""
    z_m, start = seen(BUMPS), motion((0.5, 0, 1), (0, 0, 0.3))
    wrapped = np.zeros(z_m.shape, bool)
    wrapped[:, 20:] = True
    found = refined(BUMPS, np.where(wrapped, z_m + 0.03, z_m), start, wrapped=wrapped)
    assert apart_mm(found, identity("radar")) < 0.01
    bent, invented = BUMPS.vertices_m.copy(), BUMPS.vertices_m[:, 0] > -0.02
    bent[invented, 2] += 0.01
    mesh = Surface(bent, BUMPS.faces, BUMPS.sigma_m, ~invented)
    assert apart_mm(refined(mesh, z_m, start), identity("radar")) < 0.01


def test_the_command_writes_the_transform_and_its_error_or_that_there_is_none(
    tmp_path, capsys, monkeypatch
):
    monkeypatch.chdir(tmp_path)
    truth = motion((0, 1, 2), (0.5, 0, 0))
    motion((0, 0, 0), (0, 0, 0)).save("start.json")
    plane = surface_of(lambda x, y: 0.3 + 0 * x)
    for name, surface in (("bumps", BUMPS), ("plane", plane)):
        surface.save(tmp_path / f"{name}.ply")
        depth_of(seen(surface, truth)).save(tmp_path / f"{name}.npz")
        command = f"calibrate --refine {name}.npz --mesh {name}.ply -o {name}.json"
        assert main([*command.split(), "--transform", "start.json"]) == 0
    written = capsys.readouterr().err
    assert "no covariance" in written and "not determined: x, y, rotation about z" in written
    found = load_transform(tmp_path / "bumps.json")
    assert apart_mm(found, truth) < 0.01 and found.covariance is not None
    assert "cannot show" in found.refined
    assert load_transform(tmp_path / "plane.json").covariance is None

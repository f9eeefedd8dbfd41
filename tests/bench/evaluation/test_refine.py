"""A mesh on a radar depth map: known motions of an analytic surface, and what it must not pretend
to know."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter
from scipy.spatial.transform import Rotation

from handbench.bench.datasets.maroon_alignment import load_any_transform, save_alignment
from handbench.bench.evaluation import refine as refine_module
from handbench.bench.evaluation.floor import BLOCK_M
from handbench.bench.evaluation.refine import (
    BIAS_M,
    BIAS_REACH_M,
    _blocks,
    _directions,
    _left,
    _motion,
    _name,
    _paired,
    _Pixels,
    _scatter,
    _tukey,
    refine,
    refine_files,
)
from handbench.calibration.transforms import Transform, identity, load_transform
from handbench.cli.main import main
from handbench.groundtruth.mesh.depth import reference_on_grid
from handbench.groundtruth.mesh.surface import Surface
from handbench.radar.data.depthmap import DepthMap
from handbench.support.errors import HandbenchError
from tests.bench.evaluation.measure_refine import misfit

AXIS_M = np.arange(-0.06, 0.0601, 0.002)
CENTRE_M = np.array([0.0, 0.0, 0.3])


def bumps(x, y):
    """A hand-like relief: four ridges of 6 mm across a vault of 25 mm, with no symmetry; slopes up
    to 45°."""
    return (
        0.3
        + 2.5 * (x**2 + 1.3 * y**2)
        + 0.004 * np.sin(100 * x + 20 * y)
        + 0.003 * np.sin(80 * y - 30 * x + 1)
    )


def surface_of(height, half_m: float = 0.1, count: int = 81) -> Surface:
    """z = height(x, y) as triangles over a square."""
    axis = np.linspace(-half_m, half_m, count)
    x, y = (grid.ravel() for grid in np.meshgrid(axis, axis))
    corner = (np.arange(count - 1)[:, None] * count + np.arange(count - 1)).ravel()
    faces = np.concatenate(
        [
            np.stack([corner, corner + count, corner + 1], axis=1),
            np.stack([corner + 1, corner + count, corner + count + 1], axis=1),
        ]
    )
    return Surface(
        np.stack([x, y, height(x, y)], axis=1),
        faces,
        np.full(len(x), np.nan),
        np.ones(len(x), bool),
    )


BUMPS = surface_of(bumps)


def depth_of(z_m: np.ndarray, **optional: np.ndarray) -> DepthMap:
    return DepthMap(AXIS_M, AXIS_M, z_m, np.zeros(z_m.shape, np.float32), "test", **optional)


def seen(surface: Surface, radar_from_mesh: Transform = identity("radar")) -> np.ndarray:  # noqa: B008 (immutable)
    """What a radar without errors would measure of the surface."""
    return reference_on_grid(surface.moved(radar_from_mesh), AXIS_M, AXIS_M).z_m


def motion(shift_mm, turn_deg, covariance=None) -> Transform:
    """A small motion about CENTRE_M."""
    matrix = np.eye(4)
    matrix[:3, :3] = Rotation.from_rotvec(np.radians(turn_deg)).as_matrix()
    matrix[:3, 3] = CENTRE_M + np.array(shift_mm) / 1e3 - matrix[:3, :3] @ CENTRE_M
    return Transform("photo", "radar", matrix, covariance)


def apart_mm(one: Transform, other: Transform) -> float:
    """Largest distance between the two on points of the surface."""
    points_m = CENTRE_M + 0.05 * np.array([[1, 1, 0], [1, -1, 0], [-1, 1, 0], [-1, -1, 0.0]])
    return 1e3 * float(np.linalg.norm(one.points(points_m) - other.points(points_m), axis=1).max())


@pytest.mark.parametrize(("shift_mm", "turn_deg"), [
    ((0, 0, 2), (0, 0, 0)), ((2, -1, 1), (0, 0, 0)), ((1, 2, -2), (1, -1, 1.5)), ((6, -5, 6), (3, 2, -3.5)),
])  # fmt: skip
def test_a_known_motion_comes_back(shift_mm, turn_deg):
    """Without errors the distances vanish at the truth; what is left is the ray caster's single
    precision, below 1 µm along z, and ten times that along the directions that the surface holds
    least."""
    truth = motion(shift_mm, turn_deg)
    found = refine(BUMPS, depth_of(seen(BUMPS, truth)), identity("radar"))
    report = found.refined
    assert apart_mm(found, truth) < 0.01
    assert report["free"] == [] and len(report["held"]) == 6
    assert report["rms_after_mm"] < 1e-3 < report["rms_before_mm"]
    np.testing.assert_array_equal(report["start"], np.eye(4))
    assert np.linalg.norm(report["rotation_deg"]) == pytest.approx(
        np.linalg.norm(turn_deg), abs=0.01
    )


def test_the_report_tells_the_motion_at_the_pixels_and_the_scale_stays(rng):
    start = Transform("photo", "radar", np.diag([1.02, 1.02, 1.02, 1]))
    mesh = Surface(BUMPS.vertices_m / 1.02, BUMPS.faces, BUMPS.sigma_m, BUMPS.observed)
    found = refine(mesh, depth_of(seen(BUMPS, motion((0, 0, 3), (0, 0, 0)))), start)
    report = found.refined
    assert found.scale == pytest.approx(1.02, abs=1e-12) and found.source == "photo"
    np.testing.assert_allclose(report["translation_mm"], [0, 0, 3], atol=0.01)
    np.testing.assert_allclose(report["rotation_deg"], 0, atol=0.01)
    assert report["centre_mm"][2] == pytest.approx(310, abs=10)


def test_a_plane_holds_three_directions_and_keeps_the_others(rng):
    """Shift along the plane and rotation about its normal are not moved: a rotation by ω carries
    them along at second order, ω² × 0.1 m = 0.03 mm."""
    plane = surface_of(lambda x, y: 0.3 + 0.1 * x)
    truth = motion((0, 0, 2), (0.5, -0.5, 0))
    found = refine(plane, depth_of(seen(plane, truth)), identity("radar"))
    report = found.refined
    assert len(report["held"]) == len(report["free"]) == 3
    assert all(float(free.split("condition ")[1][:-1]) > 1e6 for free in report["free"])
    assert found.covariance is None  # the start knew nothing of the three
    assert report["uncertainty"].startswith("no covariance: the surface does not hold ")
    assert all(direction in report["uncertainty"] for direction in report["free"])
    np.testing.assert_allclose(seen(plane, found), seen(plane, truth), atol=1e-6)
    normal = np.array([-0.1, 0, 1]) / np.hypot(0.1, 1)
    shift_mm, turn_deg = report["translation_mm"], report["rotation_deg"]
    assert np.linalg.norm(shift_mm - normal * (normal @ shift_mm)) < 0.03
    assert abs(normal @ turn_deg) < 0.01
    assert (
        report["held"][0] == "+0.99 z (condition 1)"
    )  # the normal; its 0.10 of x is too little to name


def test_along_free_directions_the_covariance_is_the_starts(rng):
    plane = surface_of(lambda x, y: 0.3 + 0 * x)
    noisy = depth_of(seen(plane) + 1e-4 * rng.standard_normal((61, 61)))
    start = motion((0, 0, 0), (0, 0, 0), np.diag([4e-6, 1e-6, 9e-6, 1e-6, 1e-6, 1e-4]))
    found = refine(plane, noisy, start)
    x, y, z = np.sqrt(np.diag(found.point_covariance(CENTRE_M)))
    before = np.sqrt(np.diag(start.point_covariance(CENTRE_M)))
    np.testing.assert_allclose([x, y], before[:2], rtol=0.01)  # 1 %: the plane's estimated tilt
    assert z < 0.03 * before[2]  # the radar's bias: 0.06 of 3 mm
    assert found.covariance[5, 5] == pytest.approx(1e-4, rel=0.01)


def test_a_fifth_of_garbage_does_not_pull(rng):
    """Tukey's estimate may lose 30 % of its efficiency to 20 % of strangers, but not its place: 0.1
    mm of noise in 3000 pixels leaves 0.02 mm where the surface holds least."""
    truth = motion((1, -2, 2), (1, 1, -1))
    z_m = seen(BUMPS, truth) + 1e-4 * rng.standard_normal((61, 61))
    stranger = rng.random(z_m.shape) < 0.2
    z_m[stranger] += rng.uniform(0.005, 0.03, stranger.sum())  # all on one side
    found = refine(BUMPS, depth_of(z_m), identity("radar"))
    report = found.refined
    assert apart_mm(found, truth) < 0.06
    assert report["left_out"] > 0.9 * stranger[1:-1, 1:-1].sum()


def test_pixels_that_may_have_wrapped_are_left_out():
    z_m = seen(BUMPS)
    wrapped = np.zeros(z_m.shape, bool)
    wrapped[:, 20:] = True
    wrong = np.where(wrapped, z_m + 0.03, z_m)  # two thirds of the map: too many for any robust fit
    found = refine(BUMPS, depth_of(wrong, wrapped=wrapped), motion((0.5, 0, 1), (0, 0, 0.3)))
    assert apart_mm(found, identity("radar")) < 0.01


def test_invented_surface_is_left_out():
    bent = BUMPS.vertices_m.copy()
    invented = bent[:, 0] > -0.02
    bent[invented, 2] += 0.01
    mesh = Surface(bent, BUMPS.faces, BUMPS.sigma_m, ~invented)
    found = refine(mesh, depth_of(seen(BUMPS)), motion((0.5, 0, 1), (0, 0, 0.3)))
    assert apart_mm(found, identity("radar")) < 0.01


@pytest.mark.parametrize("reach_pixels", [0, 1.06, 2])
def test_the_covariance_is_honest(rng, monkeypatch, reach_pixels):
    """Errors squared against the covariance, six per run, for noise of 0.2 mm that pixels share
    over a reach that is not told, without a bias: χ² of 6 degrees of freedom has the mean 6 ± 0.8
    over 20 runs; its bounds are three times that away."""
    monkeypatch.setattr(refine_module, "BIAS_M", 0.0)
    clean, squares = seen(BUMPS), []
    for _ in range(20):
        noise = gaussian_filter(rng.standard_normal(clean.shape), reach_pixels)
        found = refine(BUMPS, depth_of(clean + 2e-4 * noise / noise.std()), identity("radar"))
        squares.append(misfit(found))
    assert 3.6 < np.mean(squares) < 8.4


def test_a_start_at_the_edge_of_the_capture_range_comes_back_or_is_refused(rng):
    """10 mm and 5° off in random directions. Ridges 60 mm apart may lock into the wrong valley, but
    never silently near: what is returned without complaint fits."""
    returned = 0
    for _ in range(8):
        shift, turn = (vector / np.linalg.norm(vector) for vector in rng.standard_normal((2, 3)))
        start = motion(10 * shift, 5 * turn)
        try:
            found = refine(BUMPS, depth_of(seen(BUMPS)), start)
        except HandbenchError as error:
            assert "can be trusted" in str(error) or "settle" in str(error)
            continue
        assert apart_mm(found, identity("radar")) < 0.01
        returned += 1
    assert returned >= 4


@pytest.mark.parametrize(("start", "expected"), [
    (motion((300, 0, 0), (0, 0, 0)), "share 0 pixels"),
    (motion((150, 100, 0), (0, 0, 0)), "in [0-9]+ cells of 15 mm"),
    (motion((0, 0, 40), (0, 0, 0)), "would move by 40.0 mm and 0.0°; at most 15 mm and 10°"),
])  # fmt: skip
def test_what_cannot_be_trusted_is_refused(start, expected):
    with pytest.raises(HandbenchError, match=expected):
        refine(BUMPS, depth_of(seen(BUMPS)), start)


def test_a_line_of_pixels_is_refused():
    line = DepthMap(AXIS_M, AXIS_M[:1], seen(BUMPS)[:1], np.zeros((1, 61), np.float32), "test")
    with pytest.raises(HandbenchError, match="expected a map of 3 × 3"):
        refine(BUMPS, line, identity("radar"))


def test_from_files(tmp_path):
    truth = motion((0, 1, 2), (0.5, 0, 0))
    BUMPS.save(tmp_path / "mesh.ply")
    depth_of(seen(BUMPS, truth)).save(tmp_path / "depth.npz")
    found = refine_files(tmp_path / "depth.npz", tmp_path / "mesh.ply", None)
    found.save(tmp_path / "t.json")
    report = load_transform(tmp_path / "t.json").refined
    assert apart_mm(found, truth) < 0.01 and (found.source, found.target) == ("radar", "radar")
    assert report["depth"] == "depth.npz" and "cannot show" in report["reason"]
    assert report["uncertainty"].startswith("one σ at the surface's middle 0.")
    motion((0, 0, 0), (0, 0, 0)).save(tmp_path / "start.json")
    found = refine_files(
        tmp_path / "depth.npz", tmp_path / "mesh.ply", load_any_transform(tmp_path / "start.json")
    )
    assert apart_mm(found, truth) < 0.01 and found.source == "photo"
    save_alignment(tmp_path / "alignment.json", motion((0, 0, 0), (0, 0, 0)))
    start = load_any_transform(tmp_path / "alignment.json")
    maroon = refine_files(tmp_path / "depth.npz", tmp_path / "mesh.ply", start)
    np.testing.assert_allclose(maroon.matrix, found.matrix, atol=1e-9)
    Transform("radar", "photo", np.eye(4)).save(tmp_path / "back.json")
    with pytest.raises(HandbenchError, match="expected one from 'radar' to 'radar'"):
        load_any_transform(tmp_path / "back.json")


@pytest.fixture
def rng() -> np.random.Generator:
    return np.random.default_rng(5)


@pytest.mark.parametrize("first_m", [-0.31, 0.0, 0.0137, 0.2])
def test_blocks_are_counted_from_the_first_place(first_m):
    """Wherever the grid lies, what is less than a block from the first place is in the first
    block."""
    along_m = first_m + BLOCK_M * np.array([0.0, 0.5, 0.99, 1.0, 1.5, 2.2])
    assert _blocks(along_m, np.full(6, 7.0)).tolist() == [0, 0, 0, 1, 1, 2]
    assert _blocks(np.full(6, 7.0), along_m).tolist() == [0, 0, 0, 1, 1, 2]
    assert len(set(_blocks(np.repeat(along_m, 6), np.tile(along_m, 6)))) == 9


def pixels_at(place_m: np.ndarray, distance_m: np.ndarray, jacobian: np.ndarray) -> _Pixels:
    return _Pixels(np.arange(len(distance_m)), place_m, distance_m, jacobian, np.zeros(3), 1.0)


def test_sums_over_pairs_are_those_of_the_definition(rng):
    """Against all pairs one by one, on a grid with holes and unequal steps."""
    x_m, y_m = np.cumsum(rng.uniform(0.5e-3, 2e-3, (2, 12)), axis=1)
    place_m = np.stack(np.meshgrid(x_m, y_m)).reshape(2, -1)[:, rng.random(144) < 0.7]
    values = rng.standard_normal((place_m.shape[1], 3))
    separation_m = np.linalg.norm(place_m[:, :, None] - place_m[:, None], axis=0)
    expected = values.T @ np.exp(-((separation_m / 3e-3) ** 2) / 2) @ values
    found = _paired(values, pixels_at(place_m, values[:, 0], values), 3e-3)
    np.testing.assert_allclose(found, expected, rtol=1e-12)


@pytest.mark.parametrize("reach_m", [0.0, 2e-3, 4e-3])
def test_the_variance_of_a_mean_is_that_of_errors_that_reach_so_far(rng, reach_m):
    """One unknown, a shift along z of 101 × 101 pixels, whose errors σ have the reach ℓ:
    σ²·max(2πℓ², 1.2 pixels)/area, the area much wider than ℓ, and of the bias β² times the mean of
    its correlation. One draw tells ℓ² to some 25 %, so that the mean of 20 is known to 6 %; edges
    take 3 %, and the ℓ of noise that no pixels share is 0.4 pixels, of which the neighbours still
    have 4 %."""
    axis_m = np.arange(101) * 1e-3
    place_m = np.stack(np.meshgrid(axis_m, axis_m)).reshape(2, -1)
    along_z, one, found = np.eye(6)[:, 2:3], np.ones(101**2), []
    for _ in range(20):
        field = gaussian_filter(
            rng.standard_normal((101, 101)), reach_m / 1e-3 / np.sqrt(2), mode="wrap"
        )
        pixels = pixels_at(
            place_m, 2e-4 * (field / field.std()).ravel(), np.tile(along_z.T, (101**2, 1))
        )
        found.append(_scatter(pixels, one, one, along_z)[0, 0])
    correlation = np.exp(-(((axis_m[:, None] - axis_m) / BIAS_REACH_M) ** 2) / 2).mean() ** 2
    bias_m2 = BIAS_M**2 * correlation
    expected_m2 = 4e-8 * max(2 * np.pi * reach_m**2, 1.2e-6) / 0.101**2
    assert np.mean(found) - bias_m2 == pytest.approx(expected_m2, rel=0.25)


def test_what_is_left_of_a_walk_is_its_geometric_series():
    """Steps of 0.5^n: as much is left as the last one was; told in standard deviations of 2 and
    0.1."""
    scatter = np.diag([4.0, 0.01])
    walk = [np.array([0.5**n, 0.0]) for n in range(4)]
    assert _left(walk, scatter) == pytest.approx(0.125 / 2)
    assert _left([step[::-1] for step in walk], scatter) == pytest.approx(0.125 / 0.1)
    assert _left(walk[:1], scatter) == np.inf and _left([], scatter) == np.inf
    assert _left([np.array([1e-7, 0.0])], scatter) == 0


def test_a_walk_in_circles_has_nothing_left():
    circle = [np.array([1.0, 0.0]), np.array([-0.5, 0.5]), np.array([-0.5, -0.5])]
    assert _left(circle * 3, np.eye(2)) > 1  # two rounds of six are not complete
    assert _left(circle * 4, np.eye(2)) < 1e-9
    assert _left([np.array([0.1, 0.0])] * 40, np.eye(2)) > 1  # straight on


def test_a_pixel_that_comes_and_goes_does_not_keep_it_from_ending(monkeypatch):
    """A pixel far off that every second step sees moves the fit to and fro by hundredths of its σ
    for ever: 60 steps and an error, before."""
    seen_now, steps = refine_module._shared, []

    def flickering(surface, depth, transform):
        pixels = seen_now(surface, depth, transform)
        steps.append(1)
        shift_m = 3e-5 * (len(steps) % 2)
        return pixels._replace(distance_m=pixels.distance_m + shift_m * pixels.jacobian[:, 2])

    monkeypatch.setattr(refine_module, "_shared", flickering)
    noise = gaussian_filter(np.random.default_rng(3).standard_normal((61, 61)), 1.06)
    found = refine(BUMPS, depth_of(seen(BUMPS) + 1e-3 * noise / noise.std()), identity("radar"))
    assert len(steps) < 30 and found.covariance is not None


def test_tukeys_weights_are_those_of_his_loss():
    """ψ(e) = e (1 − (e/cs)²)² up to c·s, s = 1.4826 times the median of |e|: the slope by
    differences, 0 beyond."""
    e = np.linspace(-0.01, 0.01, 2001)
    weight, slope = _tukey(e)
    reach_m = 4.685 * 1.4826 * np.median(np.abs(e))
    assert reach_m > e.max()
    np.testing.assert_allclose(weight, (1 - (e / reach_m) ** 2) ** 2, atol=1e-12)
    np.testing.assert_allclose(
        slope[1:-1], ((weight * e)[2:] - (weight * e)[:-2]) / 2e-5, atol=1e-5
    )
    weight, slope = _tukey(np.array([0.0, 1e-3, -1e-3, 1e-3, 0.5, -0.5]))
    assert (weight[4:] == 0).all() and (slope[4:] == 0).all() and weight[0] == slope[0] == 1


def test_a_motion_turns_about_the_pixels_centre_and_then_shifts():
    """Lengths of turns are those of a point at the pixels' radius: 0.05 m · 90° about z takes x to
    y there."""
    pixels = _Pixels(*[np.zeros(0)] * 4, np.array([0.1, 0.2, 0.3]), 0.05)
    matrix = _motion(np.array([0.01, 0.0, -0.02, 0.0, 0.0, 0.05 * np.pi / 2]), pixels)
    np.testing.assert_allclose(matrix @ [0.1, 0.2, 0.3, 1], [0.11, 0.2, 0.28, 1], atol=1e-12)
    np.testing.assert_allclose(matrix @ [0.15, 0.2, 0.3, 1], [0.11, 0.25, 0.28, 1], atol=1e-12)


def test_directions_are_named_by_their_parts_the_largest_first():
    assert _name(np.array([0, 0, 0.95, -0.31, 0.05, 0])) == "+0.95 z −0.31 about x"
    assert (
        _name(np.array([0.31, 0, 0, 0, 0, -0.95])) == "+0.95 about z −0.31 x"
    )  # its largest part is positive
    assert _name(np.array([0, 1.0, 0.29, 0, 0, 0])) == "+1.00 y"


def test_conditions_rise_from_the_direction_that_is_held_best():
    vectors, condition = _directions(
        np.diag([1.0, 3.0, 2.0, 6.0, 0.0, 0.5]), np.array([1.0, 1, 1, 0.25, 1, 1])
    )
    np.testing.assert_allclose(condition[:5], [1, 1, 9 / 4, 9, 36])
    assert condition[5] == pytest.approx(1e12) and np.abs(vectors[:, 5]).argmax() == 4


def test_the_command_starts_from_maroons_file_and_tells_the_covariance_or_why_there_is_none(
    tmp_path, capsys
):
    plane = surface_of(lambda x, y: 0.3 + 0 * x)
    save_alignment(tmp_path / "alignment.json", motion((0, 0, 0), (0, 0, 0)))
    for name, surface in (("bumps", BUMPS), ("plane", plane)):
        surface.save(tmp_path / f"{name}.ply")
        depth_of(seen(surface)).save(tmp_path / f"{name}.npz")
        given = [
            tmp_path / f"{name}.npz",
            "--mesh",
            tmp_path / f"{name}.ply",
            "-o",
            tmp_path / f"{name}.json",
        ]
        command = ["calibrate", "--refine", *given, "--transform", tmp_path / "alignment.json"]
        assert main([str(word) for word in command]) == 0
    told = capsys.readouterr().err
    assert (
        "one σ at the surface's middle 0." in told
        and "no covariance: the surface does not hold" in told
    )
    assert load_transform(tmp_path / "bumps.json").covariance is not None
    assert load_transform(tmp_path / "plane.json").covariance is None

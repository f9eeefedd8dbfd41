"""Tracks over frames against the theory of the Kalman filter, which scipy and a line fit give."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.linalg import solve_discrete_are

from handbench.radar.data.arrays import qar50
from handbench.radar.data.capture import RadarCapture
from handbench.radar.data.depthmap import DepthMap
from handbench.radar.methods.registry import method
from handbench.radar.methods.tracking import track
from handbench.support.errors import HandbenchError
from tests.radar.direct_sums import direct_echoes

SIGMA_M, SIGMA_M_S, ACCELERATION_M_S2 = 3e-4, 4e-3, 1.0
X_M, Y_M = 1e-4 * np.arange(-20, 21), 1e-4 * np.arange(-25, 26)  # on the axis: u = 1
SHAPE = len(Y_M), len(X_M)


def measured(z_m, velocity_m_s, rng=None) -> DepthMap:
    """A frame of pixels at z_m that move with velocity_m_s; rng adds the noise that it states."""
    z_m, velocity_m_s = (np.broadcast_to(values, SHAPE) for values in (z_m, velocity_m_s))
    errors = np.zeros((2, *SHAPE)) if rng is None else rng.standard_normal((2, *SHAPE))
    return DepthMap(
        X_M,
        Y_M,
        z_m + SIGMA_M * errors[0],
        np.zeros(SHAPE),
        "3fsk-doppler",
        sigma_m=np.full(SHAPE, SIGMA_M),
        velocity_m_s=velocity_m_s + SIGMA_M_S * errors[1],
        velocity_sigma_m_s=np.full(SHAPE, SIGMA_M_S),
    )


def followed(times_s, z_m, velocity_m_s, noise=True, acceleration_m_s2=ACCELERATION_M_S2):
    """Track of a target whose depth and velocity are functions of time."""
    rng = np.random.default_rng(0) if noise else None
    maps = [measured(z_m(t), velocity_m_s(t), rng) for t in times_s]
    return list(track(maps, times_s, acceleration_m_s2))


def rms(values) -> float:
    return float(np.sqrt(np.mean(np.square(values))))


@pytest.mark.parametrize("interval_s", (0.004, 0.03))
def test_errors_of_a_matched_target_are_as_large_as_riccati_says_and_as_the_map_says(interval_s):
    # every pixel has its own random acceleration, constant between two frames
    rng, times_s = np.random.default_rng(1), interval_s * np.arange(80)
    F, g = np.array([[1, interval_s], [0, 1]]), np.array([interval_s**2 / 2, interval_s])
    truth = [np.stack(np.broadcast_arrays(3.0, np.zeros(SHAPE)))]
    for _ in times_s[1:]:
        acceleration = ACCELERATION_M_S2 * rng.standard_normal(SHAPE)
        truth.append(np.tensordot(F, truth[-1], 1) + g[:, None, None] * acceleration)
    maps = [measured(*state, rng) for state in truth]
    last = list(track(maps, times_s, ACCELERATION_M_S2))[-1]
    R, Q = np.diag([SIGMA_M**2, SIGMA_M_S**2]), ACCELERATION_M_S2**2 * np.outer(g, g)
    before = solve_discrete_are(F.T, np.eye(2), Q, R)
    theory = np.sqrt(np.diag(before - before @ np.linalg.solve(before + R, before)))
    errors = last.z_m - truth[-1][0], last.velocity_m_s - truth[-1][1]
    for error, sigma, expected in zip(
        errors, (last.sigma_m, last.velocity_sigma_m_s), theory, strict=True
    ):
        assert rms(error) == pytest.approx(expected, rel=0.05)
        # the share of new errors is known to √(2/n) of n pixels, and counted as at most 1
        assert 0.88 < rms(error / sigma) < 1.05


def test_without_acceleration_it_is_the_line_fitted_to_all_frames_however_far_apart():
    times_s = np.cumsum([0.0, 0.004, 0.004, 0.03, 0.001, 0.1, 0.004, 0.004])
    rng = np.random.default_rng(2)
    maps = [measured(0.3 + 0.05 * t, 0.05, rng) for t in times_s]
    last = list(track(maps, times_s, 1e-9))[-1]
    # each frame's depth and velocity are two equations for the line's end and its slope
    ones, after_s = np.ones_like(times_s), times_s - times_s[-1]
    rows = np.concatenate([np.c_[ones, after_s] / SIGMA_M, np.c_[0 * ones, ones] / SIGMA_M_S])
    seen = [[m.z_m / SIGMA_M for m in maps], [m.velocity_m_s / SIGMA_M_S for m in maps]]
    fit = np.linalg.lstsq(rows, np.concatenate(seen).reshape(len(rows), -1), rcond=None)[0]
    # the pixels are up to 2.5 mm off the axis, where u is not 1
    assert np.allclose(last.z_m.ravel(), fit[0], rtol=0, atol=2e-6)
    assert np.allclose(last.velocity_m_s.ravel(), fit[1], rtol=0, atol=1e-5)


def test_a_constant_velocity_is_followed_without_lag():
    last = followed(0.004 * np.arange(200), lambda t: 0.3 + 0.1 * t, lambda t: 0.1)[-1]
    assert abs(last.z_m.mean() - 0.3 - 0.1 * 0.796) < 4 * SIGMA_M / np.sqrt(last.z_m.size)
    assert rms(last.z_m - last.z_m.mean()) < SIGMA_M / 3


@pytest.mark.parametrize("acceleration_m_s2", (0.5, 3.0))
def test_a_constant_acceleration_lags_as_far_as_the_gain_says(acceleration_m_s2):
    a, interval_s = acceleration_m_s2, 0.004
    times_s = interval_s * np.arange(100)
    last = followed(times_s, lambda t: 0.3 + a * t**2 / 2, lambda t: a * t, noise=False)[-1]
    F, g = np.array([[1, interval_s], [0, 1]]), np.array([interval_s**2 / 2, interval_s])
    R, Q = np.diag([SIGMA_M**2, SIGMA_M_S**2]), ACCELERATION_M_S2**2 * np.outer(g, g)
    before = solve_discrete_are(F.T, np.eye(2), Q, R)
    remains = np.eye(2) - before @ np.linalg.inv(before + R)
    # the error settles where one prediction misses a·g and one correction leaves `remains` of it
    lag = np.linalg.solve(np.eye(2) - remains @ F, remains @ g * a)
    middle = SHAPE[0] // 2, SHAPE[1] // 2
    assert 0.3 + a * times_s[-1] ** 2 / 2 - last.z_m[middle] == pytest.approx(lag[0], rel=0.01)
    assert abs(lag[0]) < SIGMA_M


def test_an_error_that_stays_is_not_reduced_and_sigma_says_so():
    stays = SIGMA_M * np.random.default_rng(3).standard_normal(SHAPE)
    last = followed(0.004 * np.arange(50), lambda t: 0.3 + stays, lambda t: 0.0, noise=False)[-1]
    assert np.allclose(last.z_m, 0.3 + stays, rtol=0, atol=1e-9)
    assert np.allclose(last.sigma_m, SIGMA_M, rtol=0.01)


def test_pixels_that_jump_enter_or_leave_start_from_their_measurement():
    times_s, rng = 0.004 * np.arange(30), np.random.default_rng(4)
    maps = [measured(0.3, 0.0, rng) for _ in times_s]
    z_m = maps[-1].z_m + np.where(np.arange(SHAPE[1]) < 10, 0.03, 0.0)  # a finger before the palm
    hole = np.zeros(SHAPE, bool)
    hole[5:9] = True
    fields = ("z_m", "velocity_m_s", "sigma_m", "velocity_sigma_m_s")
    off = {name: np.where(hole, np.nan, getattr(maps[-2], name)) for name in fields}
    maps[-2] = replace(maps[-2], **off)
    maps[-1] = replace(maps[-1], z_m=z_m)
    *_, before, last = track(maps, times_s, ACCELERATION_M_S2)
    assert all(np.isnan(getattr(before, name)[hole]).all() for name in fields)
    again = hole | (np.arange(SHAPE[1]) < 10)
    for name in fields:
        assert np.allclose(getattr(last, name)[again], getattr(maps[-1], name)[again], rtol=1e-12)
    assert rms(last.z_m[~again] - 0.3) < SIGMA_M / 2


def test_one_frame_is_unchanged():
    depth = measured(0.3, 0.1, np.random.default_rng(5))
    [found] = track([depth], [0.0], ACCELERATION_M_S2)
    assert found is depth


@pytest.mark.parametrize(
    ("second", "words"),
    (
        (replace(measured(0.3, 0.0), velocity_m_s=None), "has no velocity_m_s"),
        (replace(measured(0.3, 0.0), x_m=X_M + 1.0), "has other pixels"),
    ),
)
def test_maps_that_cannot_be_tracked_are_refused(second, words):
    with pytest.raises(HandbenchError, match=words):
        list(track([measured(0.3, 0.0), second], [0.0, 0.004], ACCELERATION_M_S2))


PIXELS = {axis: {"start_m": -0.006, "stop_m": 0.006, "step_m": 0.001} for axis in "xy"}


def receding_point(frames, frame_times_s) -> RadarCapture:
    """A point that recedes from 0.3 m by 0.1 m/s; each tone is measured at its own time."""
    hz, times_s = np.array([82e9, 81.8e9, 79.5e9, 82e9]), 1e-3 * np.arange(4)
    starts_s = np.zeros(frames) if frame_times_s is None else frame_times_s
    samples = [
        [
            direct_echoes(np.array([[0, 0, 0.3 + 0.1 * (start + t)]]), np.ones(1), [f], qar50())[0]
            for f, t in zip(hz, times_s, strict=True)
        ]
        for start in starts_s
    ]
    return RadarCapture(
        np.array(samples, np.complex64), hz, qar50(), times_s=times_s, frame_times_s=frame_times_s
    )


def test_the_method_follows_a_point_and_does_not_depend_on_which_frames_were_asked_before():
    chosen = method("3fsk-doppler-tracked")
    config = chosen.configure(PIXELS, "test")
    capture = receding_point(4, 0.01 * np.arange(4))
    in_order = [chosen.run(capture, config, frame).depth for frame in (0, 1, 2, 2, 3)]
    again = replace(capture)  # another object: nothing is known of its frames
    for frame, before in ((3, in_order[4]), (1, in_order[1]), (2, in_order[3]), (2, in_order[2])):
        found = chosen.run(again, config, frame).depth
        for name in ("z_m", "velocity_m_s", "sigma_m", "velocity_sigma_m_s"):
            assert np.array_equal(getattr(found, name), getattr(before, name), equal_nan=True)
    first = method("3fsk-doppler").run(capture, method("3fsk-doppler").configure(PIXELS, "t"), 0)
    assert np.array_equal(first.depth.z_m, in_order[0].z_m, equal_nan=True)
    assert in_order[4].z_m[6, 6] == pytest.approx(0.303, abs=2e-5)
    assert in_order[4].velocity_m_s[6, 6] == pytest.approx(0.1, rel=0.01)


def test_frames_without_times_are_refused_and_one_frame_needs_none():
    chosen = method("3fsk-doppler-tracked")
    config, capture = chosen.configure(PIXELS, "test"), receding_point(2, None)
    assert np.isfinite(chosen.run(capture, config, 0).depth.velocity_m_s).any()
    with pytest.raises(HandbenchError, match="frame_times_s: are missing"):
        chosen.run(capture, config, 1)

"""Hard phases: at and across each pair's ambiguity, pairs of tones too close and too far apart,
first depths that are wrong, points that tie, points at the edge of what is imaged and outside."""

import numpy as np
import pytest
from flint import arb

from handbench.radar.data.arrays import qar50
from handbench.radar.data.grid import PixelGrid
from handbench.radar.imaging.exact import exact_images
from handbench.radar.methods.depth_uncertainty import fsk_with_uncertainty, wrap_probability
from handbench.radar.methods.fsk import Fsk, depth_step_m, fsk
from tests.hard_cases.scenes import (
    FIRST_M,
    FSK,
    HALF_M,
    LADDER_HZ,
    PERIOD_M,
    POINT_M,
    VOXEL_MM,
    C,
    capture,
    depth_map,
    echoes,
    middle,
    missed,
    off_mm,
    recorded,
    small_array,
)
from tests.references.balls import LIGHT_M_S, PI, U_SINGLE, U, balls, off

FINEST_HZ = {"2fsk": 0.2e9, "3fsk": 2.3e9, "3fsk-plus": 2.3e9, "nfsk": 9.8e9}
OFFSETS_MM = (-370, -200, -100, -10, 10, 100, 200, 370)
NEAREST_M = 0.14  # a first plane as near as the aperture is wide


def left_m(point_m, first_m):
    """Error that one correction of z_e, from first_m, and the pixel's own step leave of a point's
    depth: each takes 2 for the rise of the path, which is less by a share that the second one
    multiplies by."""
    corrected_m = 0.0
    for leg_m in (small_array().tx_m, small_array().rx_m):
        at_first, at_point = (
            np.linalg.norm(p - leg_m, axis=1) for p in ([*point_m[:2], first_m], point_m)
        )
        corrected_m += (at_first - at_point).mean() / 2
    return abs(first_m - point_m[2] - corrected_m) * missed(point_m)


def within_unless_flagged(within, error_m, wrapped, bound_m, place=""):
    """The largest error of pixels without a flag, then of those with one; NaN is no depth."""
    for flag in (False, True):
        worst_m = error_m[np.isfinite(error_m) & (wrapped == flag)].max(initial=0.0)
        within(1e3 * worst_m, 1e3 * bound_m, "mm", place, flagged=flag)


@pytest.mark.parametrize("sign", [-1, 1])
@pytest.mark.parametrize("difference_hz", [0.2e9, 0.5e9, 0.7e9, 2.3e9, 2.5e9, 9.8e9, 10e9])
def test_a_step_at_and_across_the_ambiguity_is_its_phase(difference_hz, sign, within):
    """4πΔf·Δz/c wrapped, in balls, periods apart. Each image rounds to single precision: 2⁻²⁴ rad
    at most, of two images 2⁻²³."""
    share = np.array(
        [0, 0.1, 0.3, 0.5, 0.77, 1 - 1e-6, 1 - 2**-24, 1, 1 + 2**-24, 1 + 1e-6, 1.5, 2, 3]
    )
    turns = sign * share / 2  # of the phase, from the step −Δz; exact
    image = np.exp(2j * np.pi * turns).astype(np.complex64)
    step_m = depth_step_m(image, np.ones_like(image), difference_hz)
    stepped = balls(step_m) * 2 * difference_hz / LIGHT_M_S  # turns
    periods = np.rint(stepped.astype(np.float64) + turns)
    within(off(0 * turns, (stepped + turns - periods) * 2 * PI).max(), 2 * U_SINGLE, "rad")


@pytest.mark.parametrize("sigma", [0.0, 1e-300, 1e-9, 1e-3, 1.0, 30.0, 1e9])
def test_the_probability_of_a_wrap_is_that_of_two_gaussians(sigma, within):
    """Four roundings of the exponent x, which turn p by |dp/dx|·x = x·p(1 − p) ≤ 0.2239 of them,
    and three of p itself, 2⁻⁵³ each."""
    step = np.array([0, 29.9, 30 - 1e-9, 30, 30 + 1e-9, 30.1, 60, 300])
    p = wrap_probability(step, np.full(len(step), sigma), 30.0)
    exponent = 60 * (30 - balls(step)) / arb(sigma or 1e-300) ** 2
    odds = np.exp(-np.abs(exponent))  # of the less likely period; halfway it is either
    exact = np.where(step < 30, odds, 1) / (1 + odds)
    within(off(p, exact).max(), (4 * 0.2239 + 3) * U, "of 1")


@pytest.mark.parametrize("height_mm", [20, 40, 60, 65, 70, 75, 80, 85, 90, 95, 100, 110])
def test_a_step_of_half_a_period_and_more_is_flagged(height_mm, within):
    """A filter across the edge is off by up to half the step; beyond 30 mm the third tone adds a
    period, which must be flagged; no pixel without flag is off by more than half of one. Pixels a
    resolution cell, 6 mm, from the edge: nearer ones see both planes in one phase."""
    planes_m = 0.26, 0.26 + height_mm / 1000
    along = np.arange(-0.027, 0.0271, 0.006)
    x, y = np.meshgrid(along, along)
    points = np.stack([x, y, np.where(x < 0, *planes_m)], axis=-1).reshape(-1, 3)
    taken = recorded(points, (82.0e9, 81.8e9, 79.5e9), qar50())  # a thin array's lobes would meddle
    axis = {"start_m": -0.024, "stop_m": 0.024, "step_m": 0.001}
    for size in (15, 31):
        config = Fsk(x=axis, y=axis, filter_px=size, first_depth_m=0.3)
        depth = fsk_with_uncertainty(taken, config)
        step = fsk(taken, config)[1][-1]
        z_m = step.pixels.on_map(step.z_m)  # before the last filter
        beside = np.abs(depth.x_m) > 0.006
        error_m = np.abs(z_m - np.where(depth.x_m < 0, *planes_m))[:, beside]
        flags = depth.wrapped[:, beside]
        within_unless_flagged(within, error_m, flags, PERIOD_M / 2, f"filter {size}")


@pytest.mark.parametrize("difference_hz", [2e8, 2e7, 2e6, 2e5, 2e4, 2e3, 2e2, 20.0])
def test_tones_that_meet_keep_the_phase_of_their_roundings(difference_hz, within):
    """Samples and the image round to single precision by 2⁻²⁴, both steerings by 4·2⁻²⁴, at each of
    two tones: cΔφ/4πΔf; the last micrometre is the factor 2's."""
    tones = [82e9, 82e9 - difference_hz]
    values = {"tones_hz": tones, "tolerance": None, "first_depth_m": POINT_M[2]}
    depth = depth_map("2fsk", recorded(POINT_M, tones), **values)
    phase_rad = 4 * np.pi * difference_hz / C * (off_mm(depth) - 1e-3) / 1e3
    within(phase_rad, 2 * (1 + 2 * 4 + 1) * U_SINGLE, "rad")


@pytest.mark.parametrize("z_m", [POINT_M[2], 1.2])
@pytest.mark.parametrize("id", FSK)
def test_z_e_is_corrected_once_from_a_first_depth_370_mm_off(id, z_m, within):
    """From planes no nearer than the aperture is wide, 0.14 m, one correction leaves 6 % of itself,
    for the factor 2 of the path's derivative, and the pixel's own step 4 % of that, 0.24 mm; a
    pixel 12 mm beside the point sees its range, 0.26 mm nearer. From nearer planes both errors are
    nearer; from behind they are of opposite signs."""
    beside_m = np.hypot(POINT_M[2], HALF_M) - POINT_M[2]
    nearer_m = [POINT_M[2] - 0.1, POINT_M[2] - 0.01]
    bound_m = beside_m + max(left_m(POINT_M, first_m) for first_m in nearer_m)
    for offset_mm in OFFSETS_MM:
        if (first_m := z_m + offset_mm / 1000) > NEAREST_M:
            depth = depth_map(id, recorded((0, 0, z_m), LADDER_HZ), first_depth_m=first_m)
            on = np.isfinite(depth.z_m) | depth.wrapped
            error_m = np.abs(depth.z_m - z_m)[on].max()
            within(1e3 * error_m, 1e3 * bound_m, "mm", f"{first_m:.3g} m")


@pytest.mark.parametrize("z_m", [POINT_M[2], 1.2])
@pytest.mark.parametrize("id", FSK)
def test_a_first_depth_400_mm_to_1_m_off_is_flagged(id, z_m, within):
    """The pair settles 750 mm off, 12.5 periods of the third tone, whose step is then half a
    period: likelier wrapped than wrap_probability, 0.1, at nine pixels of ten (measured). Two tones
    tell depths 750 mm apart by their focus alone: those of wrong periods are flagged where a plane
    a period away is sharper, and those behind the array."""
    for offset_mm in (-1000, -700, -400, 400, 700, 1000):
        if (first_m := z_m + offset_mm / 1000) > 0.02:
            depth = depth_map(id, recorded((0, 0, z_m), LADDER_HZ), first_depth_m=first_m)
            on = np.isfinite(depth.z_m) | depth.wrapped
            wrong = (np.abs(depth.z_m - z_m) > 0.005) & ~depth.wrapped
            within(wrong[on].mean(), 0.1, "of the pixels", f"{first_m:.3g} m")


@pytest.mark.parametrize("apart_mm", [0, 10, 60, 160])
def test_of_two_equal_maxima_the_brighter_is_right(apart_mm, within):
    """z_e settles on one of the two, whichever rounding prefers, and that one must be right: a leak
    of the other, a share s of its amplitude, turns each image by s at most: cs/(2πΔf), and twice
    what the factor 2 leaves, 0.37 mm."""
    along = np.arange(-0.024, 0.0241, 0.001)
    first = PixelGrid(along, along).points_m(0.45).reshape(-1, 3)
    points = np.array([[-0.02, 0, 0.28], [0.02, 0, 0.28 + apart_mm / 1000]])
    alone = [echoes(point, LADDER_HZ, qar50()).astype(np.complex64) for point in points]

    def amplitudes(samples, points_m):
        return np.abs(exact_images(samples, np.array(LADDER_HZ), qar50(), points_m, per_tone=True))

    peaks = np.array([amplitudes(samples, first)[:2].mean(axis=0).max() for samples in alone])
    at = [amplitudes(samples, points).max(axis=0) for samples in alone]  # [echo][point]
    for more in (0.9, 0.99, 1, 1 + 1e-6, 1.1):
        weight = [more, 1 / more] / peaks
        taken = capture(weight[0] * alone[0] + weight[1] * alone[1], LADDER_HZ, qar50())
        for id in FSK:
            depth = depth_map(id, taken, half_m=0.024)
            row, columns = len(along) // 2, np.array([4, -5])
            one = int(depth.amplitude_db[row, columns].argmax())
            leak = weight[1 - one] * at[1 - one][one] / (weight[one] * at[one][one])
            bound_m = C * leak / (2 * np.pi * FINEST_HZ[id]) + 2 * left_m(points[one], FIRST_M)
            error_m = abs(float(depth.z_m[row, columns[one]]) - points[one, 2])
            within(error_m / bound_m, 1, "of the bound", f"{id}, strengths {more:g}")


@pytest.mark.parametrize("beside_mm", [13, 15, 20, 30, 50, 80])
@pytest.mark.parametrize("id", FSK)
def test_a_point_outside_the_image_shows_its_range(id, beside_mm, within):
    """The pixels inside see the point's sidelobe, whose range is the point's own within a cell: no
    period off."""
    point = beside_mm / 1000, 0.0, POINT_M[2]
    depth = depth_map(id, recorded(point, LADDER_HZ))
    ranges_m = np.sqrt(depth.z_m**2 + depth.x_m**2 + depth.y_m[:, None] ** 2)
    error_m = np.abs(ranges_m - np.linalg.norm(point))
    within_unless_flagged(within, error_m, depth.wrapped, PERIOD_M / 2)


@pytest.mark.parametrize("z_m", [0.2, 0.245, 0.2454, 0.28, 0.3246, 0.325, 0.326, 0.335, 0.35, 0.6])
def test_a_point_outside_the_projection_s_box_is_flagged(z_m, within):
    """Within the box half a voxel; outside it the strongest voxel is the box's last, or a range
    sidelobe whose tones do not agree: neither may pass for a depth."""
    depth = depth_map("broadband", recorded((0, 0, z_m)))
    doubted = middle(depth.wrapped) or middle(depth.p_gross) > 0.5
    within(off_mm(depth, z_m), VOXEL_MM + 1e3 * 4 * U * 0.325, "mm", flagged=doubted)

"""Hard data: dead and saturated channels, numbers at the ends of single precision, masks of one
pixel and of all, and noise that drowns the echo."""

from functools import cache

import numpy as np
import pytest

from handbench.radar.data.depthmap import amplitude_db
from handbench.radar.data.grid import PixelGrid
from handbench.radar.imaging.exact import exact_images
from handbench.radar.methods.depth_uncertainty import NOISE, WRAP_PROBABILITY
from tests.hard_cases.scenes import (
    ALL_HZ,
    FIRST_M,
    FSK,
    HALF_M,
    LADDER_HZ,
    METHODS,
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
    small_array,
)
from tests.references.balls import U_SINGLE, balls, off
from tests.refusals import refuse

CHANNELS = int(np.prod(small_array().channels))
POINT = echoes(POINT_M)
SNR_DB = (60, 40, 30, 20, 15, 10, 5, 0, -10, -30)
AMBIGUOUS_M = {id: C / (2 * 0.2e9) if id == "2fsk" else PERIOD_M for id in FSK}
DRAWS = 4


def noisy(samples, strongest, snr_db, seed):
    """Samples [f, t, r] with white noise; snr_db: of an image's strongest pixel, whose amplitude is
    `strongest`."""
    sigma = strongest / np.sqrt(2 * CHANNELS) * 10 ** (-snr_db / 20)
    noise = np.random.default_rng(seed).normal(scale=sigma, size=(2, *samples.shape))
    return samples + noise[0] + 1j * noise[1]


@pytest.mark.parametrize("id", METHODS)
def test_echoes_of_zeros_have_no_strongest_pixel(id):
    refuse(lambda: depth_map(id, capture(0 * POINT)), "echoes")


@pytest.mark.parametrize(
    "value", [np.nan, np.inf, -np.inf, complex(0, np.nan), complex(0, np.inf), 1e39]
)
def test_one_sample_that_is_no_number_in_single_precision_is_named(value):
    """It would reach every pixel of the image; nothing can be repaired without inventing data."""
    samples = POINT.copy()
    samples[3, 5, 7] = value
    with np.errstate(over="ignore"):
        samples = samples.astype(np.complex64)
    refuse(lambda: capture(samples), "samples", "(0, 3, 5, 7)")


def ellipsoid_mm(t, r):
    """Error of one channel: its ellipsoid falls by its slopes to the image's edge, where z_e may be
    found, and the correction leaves its share of the way there for the factor 2; the pixel's own
    step leaves as large a share of both."""
    legs_m = small_array().tx_m[[t]], small_array().rx_m[[r]]
    rise = sum((POINT_M - leg[0]) / np.linalg.norm(POINT_M - leg[0]) for leg in legs_m)
    tilt_m, share = HALF_M * np.abs(rise[:2]).sum() / rise[2], missed(POINT_M, *legs_m)
    return 1e3 * share * (tilt_m + share * (FIRST_M - POINT_M[2]))


@pytest.mark.parametrize("id", METHODS)
def test_one_live_channel_images_its_ellipsoid(id, within):
    """Every pixel ties, so that z_e is that of any pixel; a half voxel is 0.5 mm."""
    channels = (0, 0), (5, 6), (11, 2)
    bound_mm = max(VOXEL_MM, *(ellipsoid_mm(*channel) for channel in channels))
    for t, r in channels:
        samples = np.zeros_like(POINT)
        samples[:, t, r] = POINT[:, t, r]
        within(off_mm(depth_map(id, capture(samples))), bound_mm, "mm", f"channel {t}, {r}")


@pytest.mark.parametrize("id", METHODS)
def test_a_power_of_two_moves_exponents_only(id, within):
    single = POINT.astype(np.complex64)
    z_m = depth_map(id, capture(single)).z_m
    assert np.isfinite(z_m).any()
    for exponent in (-100, -60, 60, 126):
        scaled = depth_map(id, capture(single * 2.0**exponent))
        changed = np.count_nonzero(np.nan_to_num(scaled.z_m) != np.nan_to_num(z_m))
        within(changed, 0, "pixels", f"2^{exponent}")


@pytest.mark.parametrize("z_m", [0.27, POINT_M[2], 0.2875])
@pytest.mark.parametrize("id", METHODS)
def test_saturated_samples_move_a_depth_as_noise_does(id, z_m, within):
    """Clipping I and Q at a level → 0 leaves their signs: S + S*³/3 and less, whose third harmonic
    no pixel focuses: it adds as noise does, a third of the echo over √144 channels, σ = cφ/(4πΔf)
    of the closest pair; 4 σ, as a normal error has in one of 16,000."""
    sigma_mm = 1e3 * C / (4 * np.pi * 0.2e9) * np.sqrt(2 / CHANNELS) / 3
    clean = echoes((*POINT_M[:2], z_m))
    clean_m = float(middle(depth_map(id, capture(clean)).z_m))
    for level in (0.9, 0.5, 0.1, 0.01):
        clipped = np.clip(clean.view(float), -level, level).view(complex)
        moved_mm = off_mm(depth_map(id, capture(clipped)), clean_m)
        within(moved_mm / sigma_mm, 4, "σ", f"clipped at {level}")


@pytest.mark.parametrize("scale", [1e-30, 1.0, 1e30])
@pytest.mark.parametrize("kind", [np.float32, np.float64])
def test_decibels_at_the_threshold_are_those_of_balls(kind, scale, within):
    """The quotient, the logarithm, its product and the result round in single precision, 2⁻²⁴ of 10
    dB each; a pixel further from the threshold falls on its right side."""
    levels = np.array([0.0, -3.0, -10.0, -10.0 + 1e-5, -10.0 - 1e-5, -13.0])
    amplitude = (scale * 10 ** (levels / 20)).astype(kind)
    exact = 20 * np.log(balls(amplitude) / float(amplitude.max())) / np.log(balls(10.0))
    within(off(amplitude_db(amplitude), exact).max(), 4 * 10 * U_SINGLE, "dB")


@pytest.mark.parametrize(
    ("threshold_db", "kept"), [(-1e-9, 1), (-0.5, None), (-10, None), (-400, 625)]
)
@pytest.mark.parametrize("id", METHODS)
def test_masks_of_one_pixel_and_of_all_have_depths_and_sigma(id, threshold_db, kept, within):
    """One pixel has no neighbour to average with and no spread of its own; σ = 0 would claim to
    know it exactly. 3fsk-plus drops what may have wrapped."""
    taken = capture(noisy(POINT, float(CHANNELS), 40.0, 0))
    depth = depth_map(id, taken, threshold_db=threshold_db)
    on = np.isfinite(depth.z_m)
    wrong = abs(np.count_nonzero(on) - kept) if kept and id != "3fsk-plus" else 0
    if depth.sigma_m is not None:
        wrong += np.count_nonzero((depth.sigma_m > 0) != on)
    within(wrong, 0, "pixels")


@cache
def drowned(id, snr_db):
    """Errors, σ and flags [n] of a smooth surface's pixels under noise, several draws, NaN where
    noise has taken the pixel away; errors are against the same method without noise, since σ speaks
    of noise alone."""
    along = np.arange(-0.024, 0.0241, 0.002)  # finer than a resolution cell
    x, y = np.meshgrid(along, along)
    surface = np.stack([x, y, POINT_M[2] + 0.003 * np.sin(60 * x) * np.cos(60 * y)], axis=-1)
    samples = echoes(surface.reshape(-1, 3), frequencies_hz=LADDER_HZ)
    # exact: no plan for points that noise scatters
    values = {"first_depth_m": POINT_M[2], "tolerance": None}
    values |= {} if id == "2fsk" else {"filter_px": 1}
    clean = depth_map(id, capture(samples, LADDER_HZ), **values)
    points_m = PixelGrid(clean.x_m, clean.y_m).points_m(POINT_M[2]).reshape(-1, 3)
    first = samples[:1].astype(np.complex64), np.array(LADDER_HZ[:1])
    strongest = np.abs(exact_images(*first, small_array(), points_m, True)).max()
    on, parts = np.isfinite(clean.z_m), []
    for seed in range(DRAWS):
        taken = capture(noisy(samples, strongest, snr_db, seed), LADDER_HZ)
        depth = depth_map(id, taken, **values)
        parts.append(((depth.z_m - clean.z_m)[on], depth.sigma_m[on], depth.wrapped[on]))
    return [np.concatenate(part) for part in zip(*parts, strict=True)]


@pytest.mark.parametrize("snr_db", SNR_DB)
@pytest.mark.parametrize("id", FSK)
def test_sigma_follows_the_noise(id, snr_db, within):
    """Amplitudes tell σ_φ; they saturate: where the flag is raised, at 0.61 rad, the phase suffers
    1.05, 1.7 times as much. Speckle, which σ counts too, makes it less. Wraps of the flag's 10 %
    apart."""
    error_m, sigma_m, wrapped = drowned(id, snr_db)
    trusted = ~wrapped & (np.abs(error_m) < AMBIGUOUS_M[id] / 2)
    if np.count_nonzero(trusted) > 0.05 * trusted.size:  # fewer are the flag's 10 %
        median = np.median(np.abs(error_m / sigma_m)[trusted]) / 0.6745
        within(median, 1 / (3 * NOISE), "of the median of normal errors")


@pytest.mark.parametrize("snr_db", SNR_DB)
@pytest.mark.parametrize("id", FSK)
def test_depths_that_noise_has_made_up_are_flagged(id, snr_db, within):
    """A pixel without flag is one that has wrapped with a probability below wrap_probability,
    0.1."""
    error_m, _, wrapped = drowned(id, snr_db)
    made_up = (np.abs(error_m) > AMBIGUOUS_M[id] / 2) & ~wrapped
    within(made_up.mean(), WRAP_PROBABILITY, "of the pixels")


@pytest.mark.parametrize("snr_db", [60, 40, 20, 0, -10, -20, -30])
def test_projections_stay_within_a_range_cell_until_noise_overtakes(snr_db, within):
    """Noise moves the maximum within its range cell, c/2B wide, and the voxel, until its own peaks
    overtake it; from there on the tones do not agree, and p_gross must exceed a half."""
    for seed in range(3):
        depth = depth_map("broadband", capture(noisy(POINT, float(CHANNELS), snr_db, seed)))
        if np.isfinite(middle(depth.z_m)):  # else it is below the threshold
            bound_mm = 1e3 * C / (4 * np.ptp(ALL_HZ)) + VOXEL_MM
            doubted = middle(depth.p_gross) > 0.5
            within(off_mm(depth), bound_mm, "mm", f"draw {seed}", flagged=doubted)


@pytest.mark.parametrize("seed", range(6))
def test_noise_alone_leaves_an_empty_map(seed, within):
    """The method drops pixels that may have wrapped; a map without any pixel left is no error."""
    noise = noisy(np.zeros((len(LADDER_HZ), *small_array().channels)), 1.0, 0.0, seed)
    depth = depth_map("3fsk-plus", capture(noise, LADDER_HZ))
    within(np.count_nonzero(np.isfinite([depth.z_m, depth.sigma_m])), 0, "pixels")

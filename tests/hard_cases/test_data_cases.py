"""Hard data: dead and saturated channels, numbers at the ends of single precision, masks of one
pixel and of all, and noise that drowns the echo.
"""

from functools import cache, partial
from itertools import product
from typing import Any

import numpy as np

from handbench.radar.data.depthmap import DepthMap, amplitude_db
from handbench.radar.data.grid import Axis, PixelGrid
from handbench.radar.imaging.cpu.exact import exact_images
from handbench.radar.methods.backprojection import Backprojection, backprojection
from handbench.radar.methods.depth_uncertainty import NOISE, WRAP_PROBABILITY
from handbench.radar.methods.fsk import Fsk
from handbench.radar.methods.gross_errors import with_p_gross
from tests.hard_cases.cases import U_SINGLE, Seen, Works, hard_case, refusal
from tests.hard_cases.scenes import (
    FSK,
    HALF_M,
    LADDER_HZ,
    METHODS,
    PERIOD_M,
    POINT_M,
    STEP_M,
    VOXEL_MM,
    C,
    bumpy_points,
    capture,
    depth_map,
    echoes,
    flags,
    middle,
    noisy,
    slack,
    small_array,
)
from tests.references.balls import balls, off

RANGE_MM = 1e3 * C / (4 * 10e9) + VOXEL_MM  # half a range cell of broadband, and half a voxel
SNR_DB = (60, 40, 30, 20, 15, 10, 5, 0, -10, -30)
DRAWS = 4
SATURATION = 1 / (3 * NOISE)  # phase error over amplitude error where noise is flagged
CHANNELS = ((0, 0), (5, 6), (11, 2))
PAPER = Fsk()


def _alone_mm(t: int, r: int) -> float:
    """Error of one channel: its ellipsoid falls by its slopes to the image's edge, where z_e may be
    found, and the correction leaves its share of the way there; the pixel's own step leaves as
    large a share of both."""
    legs_m = small_array().tx_m[t : t + 1], small_array().rx_m[r : r + 1]
    rise = sum((POINT_M - leg[0]) / np.linalg.norm(POINT_M - leg[0]) for leg in legs_m)
    missed = slack(POINT_M, legs_m)
    tilt_m = HALF_M * np.abs(rise[:2]).sum() / rise[2]
    return float(1e3 * missed * (tilt_m + missed * (PAPER.first_depth_m - POINT_M[2])))


@cache
def _point() -> np.ndarray:
    return echoes(POINT_M)


def _depth(id: str, samples: np.ndarray) -> DepthMap:
    return depth_map(id, capture(samples))


@refusal("echoes of zeros", "zero everywhere", "not all zero")
def test_zeros() -> Works:
    """An image of zeros has no strongest pixel."""
    return ((id, partial(_depth, id, np.zeros_like(_point()))) for id in METHODS)


@refusal("NaN and infinity in one sample", "NaN or infinite", "(0, 3, 5, 7)")
def test_not_finite() -> Works:
    """One NaN reaches every pixel of the image; nothing can be repaired without inventing
    data."""
    for bad, id in product(
        (np.nan, np.inf, -np.inf, complex(0, np.nan), complex(0, np.inf), 1e39), METHODS
    ):
        samples = _point().copy()
        samples[3, 5, 7] = bad
        with np.errstate(over="ignore"):  # 1e39 is infinite in single precision
            yield f"{bad}, {id}", partial(_depth, id, samples.astype(np.complex64))


@hard_case(
    "one live channel",
    kind="derived",
    bound=max(VOXEL_MM, *(_alone_mm(*channel) for channel in CHANNELS)),
    unit="mm",
    quantity="depth at the point's pixel",
    reference="the channel's ellipsoid",
)
def test_one_channel() -> Seen:
    """Every pixel ties, so that z_e is that of any pixel of the ellipsoid, as far off as its
    slopes fall over 12 mm; for the factor 2 the correction leaves a share, the pixel's own step
    as large a share of both; a half voxel is 0.5 mm."""
    for id, (t, r) in product(METHODS, CHANNELS):
        samples = np.zeros_like(_point())
        samples[:, t, r] = _point()[:, t, r]
        yield (
            f"{id}, channel {t}, {r}",
            1e3 * abs(float(middle(_depth(id, samples).z_m)) - POINT_M[2]),
        )


@hard_case(
    "echoes scaled by powers of two",
    kind="derived",
    bound=0.0,
    unit="mm",
    quantity="change of the depth map",
    reference="the scale 1",
)
def test_powers_of_two() -> Seen:
    """A power of two moves exponents only: no bit of depth, σ or mask may change."""
    for id in METHODS:
        whole = _depth(id, _point())
        for exponent in (-100, -60, 60, 126):
            scaled = _depth(id, _point().astype(np.complex64) * np.float64(2.0) ** exponent)
            known = np.isfinite(whole.z_m) & np.isfinite(scaled.z_m)
            same = np.array_equal(np.isfinite(whole.z_m), np.isfinite(scaled.z_m))
            change = np.abs(whole.z_m - scaled.z_m)[known].max()
            yield f"{id}, 2^{exponent}", 1e3 * change if same and known.any() else np.inf


@hard_case(
    "saturated samples",
    kind="derived",
    bound=4.0,
    unit="σ",
    quantity="change of the point's depth",
    reference="samples that are not clipped",
)
def test_saturated() -> Seen:
    """Clipping I and Q at a level → 0 leaves their signs: S + S*³/3 and less, whose third
    harmonic no pixel focuses: it adds as noise does, a third of the echo over √144 channels, σ
    = cφ/(4πΔf) of the closest pair; 4 σ, as a normal error has in one of 16,000."""
    sigma_mm = 1e3 * C / (4 * np.pi * 0.2e9) * np.sqrt(2 / np.prod(small_array().channels)) / 3
    for id, level, z_m in product(METHODS, (0.9, 0.5, 0.1, 0.01), (0.27, POINT_M[2], 0.2875)):
        clean = echoes((*POINT_M[:2], z_m))
        clipped = np.clip(clean.view(float), -level, level).view(complex)
        found_m = [float(middle(_depth(id, samples).z_m)) for samples in (clean, clipped)]
        yield (
            f"{id}, clipped at {level}, {1e3 * z_m:g} mm",
            1e3 * abs(found_m[1] - found_m[0]) / sigma_mm,
        )


@hard_case(
    "ties at the threshold",
    kind="rigorous",
    bound=4 * 10 * U_SINGLE,
    unit="dB",
    quantity="decibels of an amplitude",
    reference="20 log₁₀ in balls",
)
def test_ties() -> Seen:
    """The quotient, the logarithm, its product and the result round in single precision, 2⁻²⁴
    of 10 dB each; a pixel further from the threshold falls on its right side."""
    levels = np.array([0.0, -3.0, -10.0, -10.0 + 1e-5, -10.0 - 1e-5, -13.0])
    for kind, scale in product((np.float32, np.float64), (1e-30, 1.0, 1e30)):
        amplitude = (scale * 10 ** (levels / 20)).astype(kind)
        exact = 20 * np.log(balls(amplitude) / float(amplitude.max())) / np.log(balls(10.0))
        yield f"{kind.__name__} times {scale:g}", off(amplitude_db(amplitude), exact).max()


@hard_case(
    "masks of one pixel and of all",
    kind="derived",
    bound=0.0,
    unit="pixels",
    quantity="pixels whose depth and σ are not both positive numbers",
    reference="the threshold's count",
)
def test_masks() -> Seen:
    """One pixel has no neighbour to average with and no spread of its own; σ = 0 would claim to
    know it exactly."""
    taken = capture(noisy(_point(), 144.0, 40.0, 0))
    for id, threshold_db in product(METHODS, (-1e-9, -0.5, -10.0, -400.0)):
        depth = depth_map(id, taken, threshold_db=threshold_db)
        on = np.isfinite(depth.z_m)
        kept = np.count_nonzero(on)
        wanted = {-1e-9: 1, -400.0: on.size}.get(threshold_db, kept)
        wrong = abs(kept - wanted) if id != "3fsk-plus" else 0  # drops what may have wrapped
        if depth.sigma_m is not None:
            wrong += np.count_nonzero((depth.sigma_m > 0) != on)
        yield f"{id}, {threshold_db:g} dB", float(wrong)


@cache
def _drowned(id: str, snr_db: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Errors, σ and flags [n] of a smooth surface's pixels under noise, several draws, NaN where
    noise has taken the pixel away; errors are against the same method without noise, since σ speaks
    of noise alone."""
    samples = echoes(bumpy_points(), frequencies_hz=LADDER_HZ)
    # No plan for points that noise scatters.
    values: dict[str, Any] = {"half_m": 0.02, "first_depth_m": POINT_M[2], "tolerance": None}
    values |= {} if id == "2fsk" else {"filter_px": 1}
    clean = depth_map(id, capture(samples, LADDER_HZ), **values)
    points = PixelGrid(clean.x_m, clean.y_m).points_m(POINT_M[2]).reshape(-1, 3)
    top = exact_images(
        samples[:1].astype(np.complex64), np.array(LADDER_HZ[:1]), small_array(), points, True
    )
    parts = []
    for seed in range(DRAWS):
        found = depth_map(
            id, capture(noisy(samples, float(np.abs(top).max()), snr_db, seed), LADDER_HZ), **values
        )
        assert found.sigma_m is not None
        on = np.isfinite(clean.z_m)
        parts.append(((found.z_m - clean.z_m)[on], found.sigma_m[on], flags(found)[on]))
    error, sigma, wrapped = (np.concatenate(part) for part in zip(*parts, strict=True))
    return error, sigma, wrapped


@hard_case(
    "σ from +60 to −30 dB",
    kind="derived",
    bound=SATURATION,
    unit="1",
    quantity="median |error|/0.67σ of pixels without flag",
    reference="1",
)
def test_sigma_follows() -> Seen:
    """Amplitudes tell σ_φ; they saturate: where the flag is raised, at 0.61 rad, the phase
    suffers 1.05, 1.7 times as much. Speckle, which σ counts too, makes it less. Wraps of the
    flag's 10 % apart."""
    for id, snr_db in product(FSK, SNR_DB):
        error, sigma, wrapped = _drowned(id, snr_db)
        trusted = ~wrapped & (np.abs(error) < _half_period_m(id))
        if np.count_nonzero(trusted) > 0.05 * trusted.size:  # fewer are the flag's 10 %
            yield f"{id}, {snr_db} dB", float(np.median(np.abs(error / sigma)[trusted]) / 0.6745)


@hard_case(
    "depths that noise has made up",
    kind="derived",
    bound=WRAP_PROBABILITY,
    unit="1",
    quantity="share of pixels off by half a period without flag",
    reference="the flag's probability",
)
def test_made_up() -> Seen:
    """A pixel without flag is one that has wrapped with a probability below wrap_probability,
    0.1."""
    for id, snr_db in product(FSK, SNR_DB):
        error, _, wrapped = _drowned(id, snr_db)
        yield f"{id}, {snr_db} dB", float(np.mean((np.abs(error) > _half_period_m(id)) & ~wrapped))


def _half_period_m(id: str) -> float:
    return C / (4 * 0.2e9) if id == "2fsk" else PERIOD_M / 2


@hard_case(
    "projections through noise",
    kind="derived",
    bound=RANGE_MM,
    unit="mm",
    quantity="error at the point's pixel without flag",
    reference="the point",
)
def test_projections_drown() -> Seen:
    """Noise moves the maximum within its range cell, c/2B wide, until its own peaks overtake
    it; from there on the tones do not agree, and p_gross must exceed a half."""
    axis = Axis(start_m=-HALF_M, stop_m=HALF_M, step_m=STEP_M)
    config = Backprojection(x=axis, y=axis)
    for snr_db, seed in product((60, 40, 20, 0, -10, -20, -30), range(3)):
        taken = capture(noisy(echoes(POINT_M), 144.0, snr_db, seed))
        depth = with_p_gross(backprojection(taken, config), taken, config)
        off_mm = 1e3 * abs(float(middle(depth.z_m)) - POINT_M[2])
        if not np.isnan(off_mm):  # else it is below the threshold
            yield f"{snr_db} dB, draw {seed}", off_mm, bool(middle(depth.p_gross) > 0.5)


@hard_case(
    "a mask of no pixel",
    kind="derived",
    bound=0.0,
    unit="pixels",
    quantity="pixels that a map of noise keeps",
    reference="none",
)
def test_nothing_left() -> Seen:
    """The method drops pixels that may have wrapped; a map without any pixel left is empty, not
    an error."""
    for seed in range(6):
        noise = noisy(np.zeros_like(echoes(POINT_M, frequencies_hz=LADDER_HZ)), 1.0, 0.0, seed)
        depth = depth_map("3fsk-plus", capture(noise, LADDER_HZ))
        assert depth.sigma_m is not None
        yield (
            f"draw {seed}",
            float(np.count_nonzero(np.isfinite(depth.z_m) | np.isfinite(depth.sigma_m))),
        )

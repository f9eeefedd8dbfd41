"""Hard data: dead and saturated channels, numbers at the ends of single precision, masks of one pixel and of all."""

from __future__ import annotations

from functools import cache, partial
from itertools import product

import numpy as np

import bench.studies.stability.data_noise  # noqa: F401  the other half of the group
from bench.studies.stability.cases import Seen, Works, case, refusal
from bench.studies.stability.scenes import FSK, METHODS, POINT_M, VOXEL_MM, C, capture, depth_map, echoes, middle, noisy
from radar.data.depthmap import DepthMap, amplitude_db

FINE_HZ = 2.3e9  # the smaller of 3-FSK's two differences


@cache
def _point() -> np.ndarray:
    return echoes(POINT_M)


def _depth(id: str, samples: np.ndarray) -> DepthMap:
    return depth_map(id, capture(samples))


@cache
def _reference(id: str) -> float:
    return float(middle(_depth(id, _point()).z_m))


def _off_mm(id: str, samples: np.ndarray) -> float:
    """Error of the point's depth, millimetres, against the same method's answer to clean samples."""
    return 1e3 * abs(float(middle(_depth(id, samples).z_m)) - _reference(id))


@refusal("data", "echoes of zeros", "zero everywhere", "no echo", unit="mm")
def zeros() -> Works:
    """Depth map of nothing. Against: a refusal. Because: an image of zeros has no strongest pixel."""
    return ((id, partial(_depth, id, np.zeros_like(_point()))) for id in METHODS)


@refusal("data", "NaN and infinity in one sample", "NaN or infinite", "(0, 3, 5, 7)", unit="mm")
def not_finite() -> Works:
    """Depth map of broken samples. Against: a refusal. Because: one NaN reaches every pixel of the image; nothing can
    be repaired without inventing data."""
    for bad, id in product((np.nan, np.inf, -np.inf, complex(0, np.nan), complex(0, np.inf), 1e39), METHODS):
        samples = _point().copy()
        samples[3, 5, 7] = bad
        with np.errstate(over="ignore"):  # 1e39 is infinite in single precision
            yield f"{bad}, {id}", partial(_depth, id, samples.astype(np.complex64))


@case("data", "one live channel", "mm", 1.0)
def one_channel() -> Seen:
    """Depth at the point's pixel. Against: the channel's ellipsoid. Because: every pixel ties, so that z_e is that of
    any pixel of the ellipsoid, up to 15 mm off; the path's derivative, 1.94 instead of 2, leaves 3 % of that, and a
    half voxel is 0.5 mm."""
    for id, (t, r) in product(METHODS, ((0, 0), (5, 6), (11, 2))):
        samples = np.zeros_like(_point())
        samples[:, t, r] = _point()[:, t, r]
        yield f"{id}, channel {t}, {r}", 1e3 * abs(float(middle(_depth(id, samples).z_m)) - POINT_M[2])


@case("data", "dead rows of channels", "mm", 0.5)
def dead_rows() -> Seen:
    """Depth at the point's pixel. Against: all channels live. Because: a point's phase is that of every channel: what
    moves is the factor 2 of the path's derivative, by 3 % of the last correction (5 mm settled: 0.15 mm), and the
    filters' neighbours; a half voxel is 0.5 mm."""
    for id, dead in product(METHODS, (1, 3, 6, 9, 11)):
        for leg, place in (("t", np.s_[:, :dead]), ("r", np.s_[:, :, -dead:])):
            samples = _point().copy()
            samples[place] = 0
            yield f"{id}, {dead} of 12 dead in {leg}", _off_mm(id, samples)


@case("data", "echoes scaled by powers of two", "mm", 0.0)
def powers_of_two() -> Seen:
    """Change of the depth map. Against: the scale 1. Because: a power of two moves exponents only: no bit of depth, σ
    or mask may change."""
    for id in METHODS:
        whole = _depth(id, _point())
        for exponent in (-100, -60, 60, 126):
            scaled = _depth(id, _point().astype(np.complex64) * np.float64(2.0) ** exponent)
            known = np.isfinite(whole.z_m) & np.isfinite(scaled.z_m)
            same = np.array_equal(np.isfinite(whole.z_m), np.isfinite(scaled.z_m))
            change = np.abs(whole.z_m - scaled.z_m)[known].max()
            yield f"{id}, 2^{exponent}", 1e3 * change if same and known.any() else np.inf


@case("data", "echoes scaled from 1e-38 to 3e38", "mm", 1e3 * C / (4 * np.pi * 0.2e9) * 2**-22)
def scales() -> Seen:
    """Change of the point's depth. Against: the scale 1. Because: scaled samples round anew, by 2⁻²⁴ each: 2⁻²² rad
    between two images, cφ/(4πΔf) of the closest pair."""
    factors = (1e-38, 1e-30, 1e-20, 1e-10, 1e10, 1e20, 1e30, 3e38)
    return ((f"{id}, {factor:g}", _off_mm(id, _point() * factor)) for id, factor in product(METHODS, factors))


def _steps(samples: np.ndarray, bits: int) -> np.ndarray:
    """Samples as an ideal converter of so many bits gives them, full scale at the largest part."""
    parts = samples.view(float)
    full = np.abs(parts).max()
    step = 2 * full / 2**bits
    return np.clip((np.floor(parts / step) + 0.5) * step, -full, full).view(complex)


@case("data", "samples of 4 bits", "1", 1.0)
def four_bits() -> Seen:
    """Change of the point's depth, over 4 σ of the converter's noise. Against: float64 samples. Because: a step s makes
    noise s²/12 a part; 144 channels average it: σ_φ = √2·s/√(12·144)/|S|, cσ_φ/(4πΔf) of the finest pair; half a voxel
    for the projections."""
    for id, bits in product(METHODS, (12, 8, 6, 4)):
        phase = np.sqrt(2) * 2 / 2**bits / np.sqrt(12 * 144)
        sigma_mm = 1e3 * C / (4 * np.pi * _difference_hz(id)) * phase
        allowed = 4 * sigma_mm + (0.0 if id in FSK else VOXEL_MM)
        yield f"{id}, {bits} bits", _off_mm(id, _steps(_point(), bits)) / allowed


def _difference_hz(id: str) -> float:
    return {"2fsk": 0.2e9, "nfsk": 9.3e9}.get(id, FINE_HZ)


@case("data", "saturated samples", "mm", 1e3 * C / (4 * np.pi * 0.2e9) * np.sqrt(2 / 144) / 3)
def saturated() -> Seen:
    """Change of the point's depth. Against: samples that are not clipped. Because: clipping I and Q at a level → 0
    leaves their signs: S + S*³/3 and less, whose third harmonic no pixel focuses: it adds as noise does, a third of the
    echo over √144 channels, cφ/(4πΔf) of the closest pair."""
    for id, level in product(METHODS, (0.9, 0.7, 0.5, 0.3, 0.1, 0.01)):
        yield f"{id}, clipped at {level}", _off_mm(id, np.clip(_point().view(float), -level, level).view(complex))


@case("data", "ties at the threshold", "dB", 10 * 2.0**-24 * 4)
def ties() -> Seen:
    """Decibels of an amplitude. Against: 20 log₁₀ in long double. Because: the quotient, the logarithm, its product and
    the result round in single precision, 2⁻²⁴ of 10 dB each; a pixel further from the threshold falls on its right
    side."""
    levels = np.array([0.0, -3.0, -10.0, -10.0 + 1e-5, -10.0 - 1e-5, -13.0])
    for kind, scale in product((np.float32, np.float64), (1e-30, 1.0, 1e30)):
        amplitude = (scale * 10 ** (levels / 20)).astype(kind)
        exact = 20 * np.log10(amplitude.astype(np.longdouble) / amplitude.astype(np.longdouble).max())
        yield f"{kind.__name__} times {scale:g}", float(np.abs(amplitude_db(amplitude) - exact).max())


@case("data", "masks of one pixel and of all", "pixels", 0.0)
def masks() -> Seen:
    """Pixels whose depth and σ are not both positive numbers. Against: the threshold's count. Because: one pixel has no
    neighbour to average with and no spread of its own; σ = 0 would claim to know it exactly."""
    taken = capture(noisy(_point(), 144.0, 40.0, 0))
    for id, threshold_db in product(METHODS, (-1e-9, -0.5, -10.0, -400.0)):
        depth = depth_map(id, taken, threshold_db=threshold_db)
        on = np.isfinite(depth.z_m)
        wanted = 1 if threshold_db == -1e-9 else on.size if threshold_db == -400 else np.count_nonzero(on)
        wrong = abs(np.count_nonzero(on) - wanted) if id != "3fsk-plus" else 0  # drops what may have wrapped
        if depth.sigma_m is not None:
            wrong += np.count_nonzero(~(depth.sigma_m[on] > 0)) + np.count_nonzero(np.isfinite(depth.sigma_m[~on]))
        yield f"{id}, {threshold_db:g} dB", float(wrong)

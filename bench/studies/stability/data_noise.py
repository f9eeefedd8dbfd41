"""Hard data: noise that drowns the echo."""

from __future__ import annotations

from functools import cache
from itertools import product

import numpy as np

from bench.studies.stability.cases import Seen, case
from bench.studies.stability.scenes import (
    FSK,
    LADDER_HZ,
    PERIOD_M,
    POINT_M,
    VOXEL_MM,
    C,
    bumpy_points,
    capture,
    depth_map,
    echoes,
    middle,
    noisy,
    small_array,
)
from radar.data.grid import PixelGrid
from radar.imaging.cpu.exact import tone_images
from radar.methods.confidence import UNRELATED_RAD

RANGE_MM = 1e3 * C / (4 * 10e9) + VOXEL_MM  # half a range cell of broadband, and half a voxel
SNR_DB = (60, 40, 30, 20, 15, 10, 5, 0, -10, -30)
DRAWS = 4
SATURATION = np.hypot(np.pi / 3, UNRELATED_RAD) / UNRELATED_RAD  # where `radar.methods.confidence.incoherent` begins


@cache
def _drowned(id: str, snr_db: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Errors, σ and flags [n] of a smooth surface's pixels under noise, several draws, NaN where noise has taken the
    pixel away; errors are against the same method without noise, since σ speaks of noise alone."""
    samples = echoes(bumpy_points(), frequencies_hz=LADDER_HZ)
    values = {"half_m": 0.02, "first_depth_m": POINT_M[2], "tolerance": None}  # no plan for points that noise scatters
    values |= {} if id == "2fsk" else {"fine_filter_px": 1}
    clean = depth_map(id, capture(samples, LADDER_HZ), **values)
    points = PixelGrid(clean.x_m, clean.y_m).points_m(POINT_M[2]).reshape(-1, 3)
    top = tone_images(samples[:1].astype(np.complex64), np.array(LADDER_HZ[:1]), small_array(), points)
    parts = []
    for seed in range(DRAWS):
        found = depth_map(id, capture(noisy(samples, float(np.abs(top).max()), snr_db, seed), LADDER_HZ), **values)
        on = np.isfinite(clean.z_m)
        parts.append(((found.z_m - clean.z_m)[on], found.sigma_m[on], found.wrapped[on]))
    error, sigma, wrapped = (np.concatenate(part) for part in zip(*parts, strict=True))
    return error, sigma, wrapped


@case("data", "σ from +60 to −30 dB", "1", SATURATION)
def sigma_follows() -> Seen:
    """Median |error|/0.67σ of pixels without flag. Against: 1. Because: amplitudes tell σ_φ; they saturate: where the
    flag is raised, at 0.61 rad, the phase suffers 1.05, 1.7 times as much. Speckle, which σ counts too, makes it less.
    Wraps of the flag's 10 % apart."""
    for id, snr_db in product(FSK, SNR_DB):
        error, sigma, wrapped = _drowned(id, snr_db)
        trusted = ~wrapped & (np.abs(error) < _half_period_m(id))
        if np.count_nonzero(trusted) > 0.05 * trusted.size:  # fewer are the flag's 10 %
            yield f"{id}, {snr_db} dB", float(np.median(np.abs(error / sigma)[trusted]) / 0.6745)


@case("data", "depths that noise has made up", "1", 0.1)
def made_up() -> Seen:
    """Share of pixels off by half a period without flag. Against: the flag's probability. Because: a pixel without flag
    is one that has wrapped with a probability below wrap_probability, 0.1."""
    for id, snr_db in product(FSK, SNR_DB):
        error, _, wrapped = _drowned(id, snr_db)
        yield f"{id}, {snr_db} dB", float(np.mean((np.abs(error) > _half_period_m(id)) & ~wrapped))


def _half_period_m(id: str) -> float:
    return C / (4 * 0.2e9) if id == "2fsk" else PERIOD_M / 2


@case("data", "projections through noise", "mm", RANGE_MM)
def projections_drown() -> Seen:
    """Error at the point's pixel without flag. Against: the point. Because: noise moves the maximum within its range
    cell, c/2B wide, until its own peaks overtake it; from there on the tones do not agree, and that must be said."""
    for snr_db, seed in product((60, 40, 20, 0, -10, -20, -30), range(3)):
        depth = depth_map("broadband", capture(noisy(echoes(POINT_M), 144.0, snr_db, seed)))
        off_mm = 1e3 * abs(float(middle(depth.z_m)) - POINT_M[2])
        if not np.isnan(off_mm):  # else it is below the threshold
            yield f"{snr_db} dB, draw {seed}", off_mm, bool(middle(depth.wrapped))


@case("data", "a mask of no pixel", "pixels", 0.0)
def nothing_left() -> Seen:
    """Pixels that a map of noise keeps. Against: none. Because: what may have wrapped is dropped; what is left of
    nothing is an empty map, not an error."""
    for seed in range(6):
        noise = noisy(np.zeros_like(echoes(POINT_M, frequencies_hz=LADDER_HZ)), 1.0, 0.0, seed)
        depth = depth_map("3fsk-plus", capture(noise, LADDER_HZ))
        yield f"draw {seed}", float(np.count_nonzero(np.isfinite(depth.z_m) | np.isfinite(depth.sigma_m)))

"""Alignment of phases: the depth of a pixel is found as the shift along z at which the images of
several tones have the same phase.

The aperture focuses on the mirror image of a smooth surface, not on the surface, so the strongest
voxel is before or behind it; the delay is not affected. The image at z_p of a scatterer at z has
the phase k_f (z_p − z), plus one common to all tones, with k_f = 2πf/c · d(|p − t| + |p − r|)/dz
averaged over the antennas. Where the scatterer's neighbourhood has one depth, the normalised power
of the sum over N tones, shifted by Δ,

    γ(Δ) = |Σ_f O_f e^{jk_f Δ}|² / (N Σ_f |O_f|²),

is their coherence, 1 at Δ = z − z_p: its maximum is the maximum-likelihood depth of one scatterer
in white noise (Rife & Boorstyn, IEEE Trans. Inf. Theory 20 (1974) 591). If the phases deviate from
a line with variance s² per tone, the depth has the variance s² / Σ_f (k_f − k̄)², the Cramér–Rao
bound with s² measured. The noise's power, (1 − γ) Σ |O_f|² over N − 1 degrees of freedom, gives the
odds e^{(N−1)(γ₁−γ₂)/(1−γ₁)} of the highest maximum against the second.

The method `joint` finds each pixel's depth in this way from any set of tones at once. FSK with a
ladder of tones uses one tone after the other, and each must resolve the next one's period; all
pairs of tones together are less ambiguous.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Annotated, Literal, NamedTuple

import numpy as np
from pydantic import Field, field_validator

from handbench.radar.data.arrays import SPEED_OF_LIGHT_M_S, range_cell_m
from handbench.radar.data.capture import RadarCapture, even_subset, scaled_to_one
from handbench.radar.data.depthmap import DepthMap, amplitude_db
from handbench.radar.data.grid import Sweep
from handbench.radar.methods.backprojection import Backprojection, backprojection
from handbench.radar.methods.depth_uncertainty import WRAP_PROBABILITY, doubtful_on_plane, speckle_m
from handbench.radar.methods.doppler import SAME, with_velocity
from handbench.radar.methods.fsk import Fsk, FskEchoes
from handbench.radar.methods.pixels import Pixels, path_gradient_z
from handbench.radar.methods.settings import OddPixels
from handbench.support.config import Tone

STEPS = 16  # per range cell, of the search
NONE = 0.8  # coherence below which a pixel has no depth
TINY, MANY = 1e-12, 500.0  # least of 1 − γ, and most of the exponent
POLISHES = 2  # Gauss–Newton steps from the search's maximum
NEAR = 0.25  # share of the reach of a repeated search
CHECKED = 8  # tones of a sweep that are aligned

Edge = Annotated[float, Field(ge=0, le=1, description="pixels behind another one so close go")]


class Joint(Fsk):
    """Settings of the method that uses three or more tones at once: the first two, the closest,
    find the target's plane, and all together find each pixel's depth."""

    tones_hz: tuple[Tone, ...] = Field(
        (82.0e9, 81.8e9, 80.5e9, 77.0e9, 72.0e9), min_length=3, description="the closest pair first"
    )
    weighted: Literal[True] = Field(True, description="the filters weigh each pixel with its power")
    off_axis: bool = Field(True, description="use the path's true derivative along z instead of 2")
    refinements: int = Field(
        2, ge=1, le=1000, description="times that all tones are imaged and searched"
    )
    drop_doubtful: bool = Field(
        True, description="pixels without coherence, or behind an outline, become NaN"
    )
    reach_m: float = Field(
        0.03, gt=0, le=1, description="of the search before and behind each pixel's depth"
    )
    edge_m: Edge = 0.006

    @field_validator("tones_hz")
    @classmethod
    def _in_order(cls, tones_hz: tuple[float, ...]) -> tuple[float, ...]:
        closest_hz = np.diff(np.sort(tones_hz)).min()
        if not 0 < abs(tones_hz[0] - tones_hz[1]) <= closest_hz * (1 + SAME):
            raise ValueError("expected different tones, the closest pair first")
        return tones_hz


class Aligned(Backprojection):
    """Settings of broadband backprojection with refined depths: each pixel's depth is that at which
    the phases of some tones agree."""

    filter_px: OddPixels = Field(5, description="filter of the result, weighted with power")
    drop_doubtful: bool = Field(
        True, description="pixels without coherence, or behind an outline, become NaN"
    )
    edge_m: Edge = 0.006

    @field_validator("tones_hz")
    @classmethod
    def _alignable(cls, tones_hz: tuple[float, ...] | Sweep) -> tuple[float, ...] | Sweep:
        if (tones_hz.count if isinstance(tones_hz, Sweep) else len(tones_hz)) < 3:
            raise ValueError("expected 3 or more tones, whose phases can be aligned")
        return tones_hz


class Alignment(NamedTuple):
    """The shifts along z at which the tones' images of n pixels agree, with their errors: each [n].

    shift_m: the shift; sigma_m: its standard deviation, metres; coherence: normalised power γ of
    the tones' sum at that shift, 0 to 1; other: probability that the second highest maximum of γ is
    the right one.
    """

    shift_m: np.ndarray
    sigma_m: np.ndarray
    coherence: np.ndarray
    other: np.ndarray


def align(
    images: np.ndarray,
    frequencies_hz: np.ndarray,
    path_gradient_z: np.ndarray,
    reach_m: float | None = None,
) -> Alignment:
    """Find the shift Δ within ±reach_m that maximises γ(Δ) = |Σ O_f e^{jk_f Δ}|² / (N Σ |O_f|²) of
    the images O [f, n] of N ≥ 3 tones, for n pixels: an `Alignment`.

    path_gradient_z [n]: growth of the path there and back per metre along z. reach_m: None for a
    range cell c/2B, but at most half of the period of evenly spaced tones.
    """
    n_tones, cell_m = len(images), range_cell_m(frequencies_hz)
    k = 2 * np.pi * frequencies_hz[:, None] / SPEED_OF_LIGHT_M_S * path_gradient_z
    reach_m = reach_m or cell_m * min(1.0, (n_tones - 1) / 2)
    shifts_m = np.linspace(-reach_m, reach_m, 1 + 2 * int(np.ceil(STEPS * reach_m / cell_m)))
    power = np.stack([np.abs(_sum(images, k, shift_m)) ** 2 for shift_m in shifts_m])
    shift_m = shifts_m[power.argmax(axis=0)]
    distance_m = np.abs(shifts_m[:, None] - shift_m) * path_gradient_z / 2
    second = np.where(distance_m > cell_m / 2, power, 0.0).max(axis=0)
    weight = np.abs(images).astype(np.float64) ** 2
    with np.errstate(divide="ignore", invalid="ignore"):  # images of zeros
        weight /= (total := weight.sum(axis=0))
        k_centred = k - (weight * k).sum(axis=0)
        k_variance = (weight * k_centred**2).sum(axis=0)
        for _ in range(POLISHES):
            residual_rad = _residual_rad(images, k, shift_m)
            shift_m = shift_m - (weight * k_centred * residual_rad).sum(axis=0) / k_variance
        variance = (weight * _residual_rad(images, k, shift_m) ** 2).sum(axis=0) / (n_tones - 2)
        sigma_m = np.nan_to_num(np.sqrt(variance / k_variance), nan=np.inf)
        coherence = np.nan_to_num(np.abs(_sum(images, k, shift_m)) ** 2 / (n_tones * total))
        less = coherence - np.nan_to_num(second / (n_tones * total))
    odds = (n_tones - 1) * less / np.maximum(1 - coherence, TINY)
    other = 1 / (1 + np.exp(np.clip(odds, -MANY, MANY)))
    return Alignment(np.nan_to_num(shift_m), sigma_m, coherence, other)


def _sum(images: np.ndarray, k: np.ndarray, shift_m: np.ndarray | float) -> np.ndarray:
    """Compute Σ O_f e^{jk_f Δ} [n], to first order the tones' sum at points shifted by Δ."""
    return np.asarray((images * np.exp(1j * k * shift_m)).sum(axis=0))


def _residual_rad(images: np.ndarray, k: np.ndarray, shift_m: np.ndarray) -> np.ndarray:
    """Compute the phases of O_f e^{jk_f Δ} [f, n] relative to that of their sum over the tones."""
    return np.angle(images * np.exp(1j * k * shift_m) * np.conj(_sum(images, k, shift_m)))


def filter_by_agreement(
    depth: DepthMap, coherence: np.ndarray, bandwidth_hz: float, config: Joint | Aligned
) -> DepthMap:
    """Average a depth map over neighbouring pixels with their power as weights, and add the
    variance by speckle, which the tones of a pixel do not show, to σ².

    coherence [ny, nx]: coherence of the tones at the depths found; bandwidth_hz: bandwidth B of the
    tones. With config.drop_doubtful, pixels without coherence and those more than c/4B behind
    another one within config.edge_m are dropped.
    """
    lost, z_m = coherence < NONE, depth.z_m
    if config.drop_doubtful:
        gap_m, surface_m = SPEED_OF_LIGHT_M_S / (4 * bandwidth_hz), np.where(lost, np.nan, z_m)
        z_m = np.where(lost | behind_outline(surface_m, config, gap_m), np.nan, z_m)
    pixels = Pixels(config.pixels, np.flatnonzero(np.isfinite(z_m)))
    z_m, sigma_m, db = (
        np.asarray(map_).ravel()[pixels.index] for map_ in (z_m, depth.sigma_m, depth.amplitude_db)
    )
    power = 10 ** (db.astype(np.float64) / 10)
    smooth_m = pixels.means(z_m, config.filter_px, power)
    sigma_m = np.hypot(speckle_m(z_m, smooth_m, np.sqrt(power), pixels), sigma_m)
    wrapped = np.asarray(depth.wrapped) & np.isfinite(smooth_map_m := pixels.on_map(smooth_m))
    return replace(depth, z_m=smooth_map_m, sigma_m=pixels.on_map(sigma_m), wrapped=wrapped)


def behind_outline(z_m: np.ndarray, config: Joint | Aligned, gap_m: float) -> np.ndarray:
    """Return True for pixels of a depth map z_m [ny, nx] that have, within config.edge_m along x
    and y, a depth nearer by more than gap_m, metres: at an outline, the side lobes of bright
    surfaces behind are stronger than the dark edge itself."""
    from scipy.ndimage import minimum_filter

    window_px = [1 + 2 * int(config.edge_m / axis.step_m + 1e-6) for axis in (config.y, config.x)]
    nearest_m = minimum_filter(np.where(np.isfinite(z_m), z_m, np.inf), window_px)
    return np.asarray(z_m > nearest_m + gap_m)


def joint(capture: RadarCapture, config: Joint, frame: int = 0) -> DepthMap:
    """Compute the depth map of a frame from three or more tones at once, with predicted 1σ and
    flags. Raises HandbenchError for a capture without the configured tones.

    The shift along z that aligns the phases of all tones is searched within config.reach_m of the
    depths of the first two tones. The pixels are then imaged at the depths found, and a smaller
    shift is searched; this is repeated config.refinements times in all.
    """
    echoes = FskEchoes.of(capture, config, frame)
    step = echoes.target_plane().on_target()
    z_m, wrapped = step.z_m, doubtful_on_plane(step)
    grid, tones_hz = config.pixels, echoes.frequencies_hz[: len(config.tones_hz)]
    reach_m = config.reach_m
    for _ in range(config.refinements):
        step = echoes.surface(step.pixels, step.filtered(z_m), len(tones_hz))
        found = align(step.images, tones_hz, 2 / step.factor * np.ones(len(z_m)), reach_m)
        z_m, wrapped = step.formed_m + found.shift_m, wrapped | (found.other > WRAP_PROBABILITY)
        if config.drop_doubtful and (found.coherence >= NONE).any():
            z_m[found.coherence < NONE] = np.nan
        reach_m = NEAR * config.reach_m
    db = step.pixels.on_map(amplitude_db(step.amplitude), -np.inf).astype(np.float32)
    depth = DepthMap(
        grid.x_m,
        grid.y_m,
        step.pixels.on_map(z_m),
        db,
        "joint",
        echoes.config.model_dump(mode="json"),
        step.pixels.on_map(found.sigma_m),
        step.pixels.on_map(wrapped, 0) > 0,
    )
    coherence = step.pixels.on_map(found.coherence, 0.0)
    depth = filter_by_agreement(depth, coherence, float(np.ptp(tones_hz)), config)
    if echoes.repetition is not None:
        depth = with_velocity(depth, step, echoes.repetition)
    seen = db >= config.threshold_db  # at the final depth, not in the first plane
    z_m, sigma_m = (
        np.where(seen, values_m, np.nan) for values_m in (depth.z_m, np.asarray(depth.sigma_m))
    )
    return replace(depth, z_m=z_m, sigma_m=sigma_m, wrapped=seen & np.asarray(depth.wrapped))


def broadband_aligned(capture: RadarCapture, config: Aligned, frame: int = 0) -> DepthMap:
    """Compute the depth map of a frame by broadband backprojection, where each depth is shifted to
    the one at which the phases of CHECKED of the tones agree, with predicted 1σ and flags."""
    from handbench.radar.imaging.api import image_points  # numba, which settings do not need

    depth, grid = backprojection(capture, config, frame), config.pixels
    samples, hz = capture.tones(config.frequencies_hz, frame)
    some, samples = even_subset(len(hz), CHECKED), scaled_to_one(samples)
    index = np.flatnonzero(np.isfinite(depth.z_m))
    points_m = grid.points_at_m(index, depth.z_m.ravel()[index])
    images = image_points(samples[some], hz[some], capture.aperture, points_m, None, per_tone=True)
    found = align(images, hz[some], path_gradient_z(points_m, capture.aperture))
    z_m, sigma_m = (
        grid.on_map(index, values_m) for values_m in (points_m[:, 2] + found.shift_m, found.sigma_m)
    )
    coherence, bandwidth_hz = grid.on_map(index, found.coherence, 1.0), float(np.ptp(hz[some]))
    depth = replace(depth, z_m=z_m, sigma_m=sigma_m)
    return filter_by_agreement(depth, coherence, bandwidth_hz, config)

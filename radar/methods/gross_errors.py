"""Probability that a depth is grossly wrong, for the depth map of any method.

The odds of a depth error above s = 5 mm are taken as

    p / (1 − p) = σ/s · max(1, h/s) · ε · A_max/A · 10^wrapped,

with the predicted error σ, the largest depth step h to a pixel within 5 mm, the incoherence ε = 1 −
|Σ O|² / (N Σ |O|²) of the images O of N tones at the depth found, the amplitude A, and the method's
flag `wrapped`. For a method without σ it is the Cramér–Rao bound σ² = ε / (2N(1 − ε) Var k), k =
4πf/c. No factor is fitted.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.ndimage import maximum_filter, minimum_filter

from handbench.radar.data.arrays import SPEED_OF_LIGHT_M_S
from handbench.radar.data.capture import RadarCapture, even_subset, scaled_to_one
from handbench.radar.data.depthmap import DepthMap
from handbench.radar.imaging.api import image_points
from handbench.radar.methods.evidence import unresolved_m
from handbench.radar.methods.settings import MethodSettings

GROSS_M = 5e-3
TONES = 8  # tones that are imaged, evenly chosen from a method's
TOLERANCE = 1e-3  # of their images
LEAST_INCOHERENCE = 0.01  # curvature and slope within a resolution cell cause as much


def with_p_gross(
    depth: DepthMap, capture: RadarCapture, config: MethodSettings, frame: int = 0
) -> DepthMap:
    """Return the depth map with p_gross [ny, nx], the probability that a depth is off by more than
    5 mm: NaN off target, 1 for depths behind the array.

    Depth varies within one resolution cell of the antennas: sigma_m is raised to at least this
    variation, and where the variation exceeds 5 mm, p_gross is at least 0.5. config: configuration
    of the method that made the map.
    """
    on, least_m = np.nan_to_num(depth.z_m) > 0, unresolved_m(capture, depth.z_m, frame)
    images, k = _tone_images(depth, capture, config, frame, np.flatnonzero(on))
    with np.errstate(divide="ignore", invalid="ignore"):
        coherence = np.abs(images.mean(axis=0)) ** 2 / (np.abs(images) ** 2).mean(axis=0)
        incoherence = np.maximum(1 - coherence, LEAST_INCOHERENCE)
        bound_m = np.sqrt(incoherence / (1 - incoherence) / (2 * len(k) * k.var()))
        sigma_m = None if depth.sigma_m is None else np.fmax(depth.sigma_m, least_m)
        odds = (bound_m if sigma_m is None else sigma_m[on]) / GROSS_M
        odds *= np.maximum(1, _step_m(depth.z_m, config)[on] / GROSS_M) * incoherence
        odds *= 10 ** (-depth.amplitude_db[on].astype(np.float64) / 20)
    if depth.wrapped is not None:
        odds *= 10.0 ** depth.wrapped[on]
    odds = np.where(np.isnan(odds), np.inf, np.maximum(odds, least_m[on] > GROSS_M))
    p_gross = np.where(np.isfinite(depth.z_m), np.float32(1), np.float32(np.nan))
    p_gross[on] = 1 - 1 / (1 + odds)
    return replace(depth, p_gross=p_gross, sigma_m=sigma_m)


def _step_m(z_m: np.ndarray, config: MethodSettings) -> np.ndarray:
    """Compute the largest difference of each depth [ny, nx] from those within 5 mm beside it."""
    window_px = [1 + 2 * round(GROSS_M / axis.step_m) for axis in (config.y, config.x)]
    nearest_m = minimum_filter(np.where(np.isnan(z_m), np.inf, z_m), window_px)
    furthest_m = maximum_filter(np.where(np.isnan(z_m), -np.inf, z_m), window_px)
    return np.asarray(np.maximum(z_m - nearest_m, furthest_m - z_m))


def _tone_images(
    depth: DepthMap, capture: RadarCapture, config: MethodSettings, frame: int, index: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Image the pixels with flat indices index [n] at their depths, at N of the method's tones:
    (images [N, n], k = 4πf/c [N] in rad/m). The phase 4πfvt/c of the map's velocities v is taken
    off."""
    tones_hz = config.frequencies_hz[even_subset(len(config.frequencies_hz), TONES)]
    samples, f = capture.tones(tones_hz, frame)
    points_m = config.pixels.points_at_m(index, depth.z_m.ravel()[index])
    images = image_points(
        scaled_to_one(samples), f, capture.aperture, points_m, TOLERANCE, per_tone=True
    ).astype(np.complex128)
    k = 4 * np.pi * f / SPEED_OF_LIGHT_M_S
    if depth.velocity_m_s is not None and capture.times_s is not None:
        delay_s = capture.times_s[capture.tone_index(tones_hz)] - capture.times_s.min()
        shift_m = np.outer(delay_s, np.nan_to_num(depth.velocity_m_s.ravel()[index]))
        images *= np.exp(1j * k[:, None] * shift_m)
    return images, k

"""Highlights: what a rough surface mirrors of a lamp (Cook & Torrance 1982; for skin, Weyrich et al. 2006)."""

from __future__ import annotations

import numpy as np

from radar.parallel import for_each

SKIN_REFLECTANCE = 0.028  # at normal incidence: ((n - 1) / (n + 1))² with skin's refractive index n = 1.4
GRAZING = 1e-3  # smallest cosine towards the eye: interpolated normals may turn a little beyond 90°
BLOCK = 20_000  # points per task: they stay in the processor's cache


def ggx(
    normal: np.ndarray, light: np.ndarray, eye: np.ndarray, roughness: float, reflectance: float = SKIN_REFLECTANCE
) -> np.ndarray:
    """Mirrored part [n] of the BRDF, 1/sr, for unit vectors [n, 3] or [3] away from the surface.

    D F V with D = α² / (π ((n·h)² (α² - 1) + 1)²), the spread of facets whose normals lie near the half vector h (GGX,
    Walter et al. 2007); F = R + (1 - R) (1 - h·l)⁵ (Schlick 1994); V, the facets that hide one another, height-correlated
    and divided by 4 (n·l) (n·v) (Heitz 2014). roughness: α.
    """
    half = light + eye
    half /= np.linalg.norm(half, axis=-1, keepdims=True)
    to_half, to_light, to_eye, tilt = (_dot(a, b) for a, b in ((normal, half), (normal, light), (normal, eye), (half, eye)))
    to_light, to_eye = np.maximum(to_light, 0), np.maximum(to_eye, GRAZING)
    square = roughness**2
    spread = square / (np.pi * (to_half**2 * (square - 1) + 1) ** 2)
    fresnel = reflectance + (1 - reflectance) * (1 - np.clip(tilt, 0, 1)) ** 5
    hidden = to_light * np.sqrt(to_eye**2 * (1 - square) + square)
    hidden += to_eye * np.sqrt(to_light**2 * (1 - square) + square)
    return np.where(to_light > 0, spread * fresnel / (2 * hidden), 0)


def mirrored(
    points_m: np.ndarray, normals: np.ndarray, eyes: np.ndarray, lamp_m: np.ndarray, reach_m: float, roughness: float
) -> np.ndarray:
    """Radiance [n] that points [n, 3] with unit normals [n, 3] send along `eyes` [n, 3] (unit, away from the surface)
    under an unshadowed lamp, samples [k, 3], whose irradiance over π is 1 at the distance `reach_m`."""
    result = np.empty(len(points_m), dtype=np.float32)

    def work(first: int) -> None:
        part = slice(first, first + BLOCK)
        normal, eye = normals[part].astype(np.float32), eyes[part].astype(np.float32)
        total = np.zeros(len(normal), dtype=np.float32)
        for sample_m in lamp_m:
            light = (sample_m - points_m[part]).astype(np.float32)
            distance_m = np.linalg.norm(light, axis=1)
            light /= distance_m[:, None]
            total += ggx(normal, light, eye, roughness) * np.maximum(_dot(normal, light), 0) * (reach_m / distance_m) ** 2
        result[part] = np.pi / len(lamp_m) * total

    for_each(work, range(0, len(points_m), BLOCK))
    return result


def _dot(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    return (a * b).sum(axis=-1)

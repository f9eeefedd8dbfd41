"""Highlights: what a rough surface mirrors of a lamp (Cook & Torrance 1982; for skin, Weyrich et al. 2006)."""

import numpy as np

from handbench.support.compiled import njit
from handbench.support.parallel import for_each

SKIN_REFLECTANCE = 0.028  # at normal incidence: ((n - 1) / (n + 1))² with skin's refractive index n = 1.4
GRAZING = 1e-3  # smallest cosine towards the eye: interpolated normals may turn a little beyond 90°
BLOCK = 20_000  # points per task


@njit()
def ggx(to_half: float, to_light: float, to_eye: float, tilt: float, roughness: float, reflectance: float) -> float:
    """Mirrored part of the BRDF, 1/sr, from cosines: of the normal with the half vector, the light and the eye (both
    above 0), and of the half vector with the eye (tilt).

    D F V with D = α² / (π ((n·h)² (α² - 1) + 1)²), the spread of facets whose normals lie near the half vector h (GGX,
    Walter et al. 2007); F = R + (1 - R) (1 - h·v)⁵ (Schlick 1994); V, facets that hide one another, height-correlated,
    over 4 (n·l) (n·v) (Heitz 2014). roughness: α; reflectance: R.
    """
    square = roughness**2
    spread = square / (np.pi * (to_half**2 * (square - 1) + 1) ** 2)
    fresnel = reflectance + (1 - reflectance) * (1 - tilt) ** 5
    hidden = to_light * np.sqrt(to_eye**2 * (1 - square) + square)
    hidden += to_eye * np.sqrt(to_light**2 * (1 - square) + square)
    return spread * fresnel / (2 * hidden)


def mirrored(
    points_m: np.ndarray, normals: np.ndarray, eyes: np.ndarray, lamp_m: np.ndarray, reach_m: float, roughness: float
) -> np.ndarray:
    """Radiance [n] that skin at points [n, 3] with unit normals [n, 3] sends along `eyes` [n, 3] (unit, away from it)
    under an unshadowed lamp, samples [k, 3], whose irradiance over π is 1 at the distance `reach_m`."""
    result = np.empty(len(points_m), dtype=np.float32)

    def work(first: int) -> None:
        part = slice(first, first + BLOCK)
        _mirrored(points_m[part], normals[part], eyes[part], lamp_m, reach_m, roughness, result[part])

    for_each(work, range(0, len(points_m), BLOCK))
    return result


@njit(nogil=True, cache=True)
def _mirrored(
    points_m: np.ndarray,
    normals: np.ndarray,
    eyes: np.ndarray,
    lamp_m: np.ndarray,
    reach_m: float,
    roughness: float,
    result: np.ndarray,
) -> None:
    """The rendering equation over a lamp's samples: π / k Σ brdf cos θ (reach / distance)²."""
    for i in range(len(points_m)):
        px, py, pz = points_m[i, 0], points_m[i, 1], points_m[i, 2]
        nx, ny, nz = normals[i, 0], normals[i, 1], normals[i, 2]
        ex, ey, ez = eyes[i, 0], eyes[i, 1], eyes[i, 2]
        to_eye = max(nx * ex + ny * ey + nz * ez, GRAZING)
        total = 0.0
        for k in range(len(lamp_m)):
            lx, ly, lz = lamp_m[k, 0] - px, lamp_m[k, 1] - py, lamp_m[k, 2] - pz
            distance_m = np.sqrt(lx * lx + ly * ly + lz * lz)
            to_light = (nx * lx + ny * ly + nz * lz) / distance_m
            if to_light > 0:
                hx, hy, hz = lx / distance_m + ex, ly / distance_m + ey, lz / distance_m + ez
                length = np.sqrt(hx * hx + hy * hy + hz * hz)
                to_half, tilt = (nx * hx + ny * hy + nz * hz) / length, min(length / 2, 1.0)  # |l + v| = 2 h·v
                brdf = ggx(to_half, to_light, to_eye, tilt, roughness, SKIN_REFLECTANCE)
                total += brdf * to_light * (reach_m / distance_m) ** 2
        result[i] = np.pi / len(lamp_m) * total

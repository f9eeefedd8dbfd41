"""Amplification of phase errors by FSK's depth, and the rank correlation of its σ with its
errors."""

from functools import cache
from typing import Any, NamedTuple

import numpy as np
from scipy.stats import spearmanr

from handbench.radar.data.arrays import SPEED_OF_LIGHT_M_S, qar50
from handbench.radar.data.capture import RadarCapture
from handbench.radar.data.depthmap import DepthMap
from handbench.radar.simulation.effects.sensor import strongest_amplitude, thermal_noise
from handbench.radar.simulation.forward import Scatterers, simulate
from tests.hard_cases.scenes import LADDER_HZ, imaged, small_array

ARRAY = small_array(4)  # 24 + 24 antennas
POINT_M = np.array([0.0, 0.0, 0.28])
NOISE_RAD = 0.0264  # the paper's, between two tones at the strongest pixel
DRAWS = 24
NEAR = {"start_m": -0.004, "stop_m": 0.004, "step_m": 0.001}
KNOWN: dict[str, Any] = {
    "x": NEAR,
    "y": NEAR,
    "off_axis": True,
    "tolerance": None,
    "first_depth_m": float(POINT_M[2]),
}


class Method(NamedTuple):
    """An FSK method, and its tones in the order of its ladder."""

    name: str
    id: str
    tones_hz: tuple[float, ...]


METHODS = (
    Method("2-FSK", "2fsk", LADDER_HZ[:2]),
    Method("3-FSK", "3fsk", (*LADDER_HZ[:2], LADDER_HZ[3])),
    Method("ladder", "nfsk", LADDER_HZ),
)


def amplification(method: Method) -> float:
    """Change of a point's depth with the phase of the last tone's samples."""
    tones_hz = np.array(method.tones_hz)
    samples = simulate(Scatterers(POINT_M[None], np.ones(1)), tones_hz, ARRAY, tolerance=None)

    def depth_m(phase_rad: float) -> float:
        turned = samples.copy()
        turned[-1] *= np.exp(1j * phase_rad)
        z_m = imaged(method.id, RadarCapture(turned[None], tones_hz, ARRAY), **KNOWN).z_m
        return float(z_m[len(z_m) // 2, z_m.shape[1] // 2])

    return abs(depth_m(5e-3) - depth_m(-5e-3)) / 1e-2


def expected(method: Method) -> float:
    """c/(2πΔf) over the path's rise along z (2 far away on the axis), averaged over the pairs of
    the last tone."""
    rise = sum(
        np.mean(POINT_M[2] / np.linalg.norm(POINT_M - leg, axis=1))
        for leg in (ARRAY.tx_m, ARRAY.rx_m)
    )
    *others, last = method.tones_hz
    per_hz = np.mean([1 / abs(tone - last) for tone in others[:2]])
    return float(SPEED_OF_LIGHT_M_S / (2 * np.pi) * per_hz / rise)


def _surface_m(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    return 0.28 + 0.004 * np.sin(2 * np.pi * x / 0.03) * np.cos(2 * np.pi * y / 0.04)


@cache
def ranks() -> dict[str, tuple[float, float]]:
    """Method → rank correlation with |z − truth| of the stated σ, and of the true one: the errors'
    root mean square of the other draws. Over the pixels of a bumpy surface, with the paper's array
    and noise.

    The true σ knows what repeats, as where a filter flattens the surface; the stated one knows its
    own draw's amplitudes. An error is one draw of its σ, and σ varies but a few times over a
    target: none reaches 1.
    """
    along = np.arange(-0.03, 0.03 + 1e-9, 0.000625)
    x, y = np.meshgrid(along, along)
    points_m = np.stack([x.ravel(), y.ravel(), _surface_m(x, y).ravel()], axis=1)
    tones_hz = np.array(METHODS[1].tones_hz)
    clean = simulate(Scatterers(points_m, np.ones(len(points_m))), tones_hz, qar50())
    strongest = strongest_amplitude(clean[0], tones_hz[0], qar50(), points_m)
    span = {"start_m": -0.024, "stop_m": 0.024, "step_m": 0.001}
    maps: dict[str, list[DepthMap]] = {method.name: [] for method in METHODS[:2]}
    for seed in range(DRAWS):
        samples = thermal_noise(clean, tones_hz, NOISE_RAD, strongest, (seed,))
        capture = RadarCapture(samples[None], tones_hz, qar50())
        for method in METHODS[:2]:
            maps[method.name].append(
                imaged(method.id, capture, x=span, y=span, first_depth_m=float(POINT_M[2]))
            )
    return {name: _ranks(found) for name, found in maps.items()}


def _ranks(maps: list[DepthMap]) -> tuple[float, float]:
    """Over the pixels that half of the draws observe: of the stated σ, and of the true one."""
    error_m = np.array([depth.z_m for depth in maps]) - _surface_m(
        *np.meshgrid(maps[0].x_m, maps[0].y_m)
    )
    seen = np.isfinite(error_m)
    often = seen & (seen.sum(axis=0) > len(maps) / 2)
    square_m2 = np.where(seen, error_m**2, 0)
    others_m2 = (square_m2.sum(axis=0) - square_m2) / np.maximum(seen.sum(axis=0) - 1, 1)
    stated_m = np.array([depth.sigma_m for depth in maps])
    error_m = np.abs(error_m[often])
    stated, true = (
        float(spearmanr(sigma[often], error_m).statistic) for sigma in (stated_m, others_m2)
    )
    return stated, true

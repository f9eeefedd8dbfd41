"""Scenes of the hard cases: a small array, scatterers whose depth is known, and methods run on the
pixels about them. Echoes are formed in float64."""

from collections.abc import Iterator
from functools import cache
from typing import Any

import numpy as np

from handbench.radar.data.arrays import SPEED_OF_LIGHT_M_S, AntennaArray, qar50
from handbench.radar.data.capture import RadarCapture
from handbench.radar.data.depthmap import DepthMap
from handbench.radar.data.grid import Axis
from handbench.radar.methods.registry import method
from tests.radar.direct_sums import direct_echoes

FSK = ("2fsk", "3fsk", "3fsk-plus", "nfsk")
METHODS = (*FSK, "broadband", "narrowband")
LADDER_HZ = (82.0e9, 81.8e9, 81.3e9, 79.5e9, 72.0e9)
ALL_HZ = np.unique(np.concatenate([np.linspace(72e9, 82e9, 128), LADDER_HZ]))
TONES_HZ = np.linspace(72e9, 82e9, 9)
POINT_M = (0.0, 0.0, 0.28)
HALF_M, STEP_M = 0.012, 0.001
VOXEL_MM = 0.5  # half a voxel of the projections
C = SPEED_OF_LIGHT_M_S
PERIOD_M = C / (2 * 2.5e9)  # of depths that three tones tell apart


@cache
def small_array(every: int = 8) -> AntennaArray:
    """Every eighth antenna of the paper's frame, 12 + 12, or another part: as wide, and 60 times as
    fast."""
    whole = qar50()
    return AntennaArray(whole.tx_m[::every], whole.rx_m[::every])


def plate(t: int = 12, r: int = 10, seed: int = 0) -> AntennaArray:
    """Antennas anywhere on a plate of 14 cm."""
    places = np.random.default_rng(seed).uniform(-0.07, 0.07, (t + r, 3)) * [1, 1, 0]
    return AntennaArray(places[:t], places[t:])


def cloud(
    count: int, middle_m: tuple[float, float, float], half_m: float = 0.015, seed: int = 1
) -> np.ndarray:
    """Points [count, 3] within half_m of the middle, metres."""
    return np.random.default_rng(seed).uniform(-half_m, half_m, (count, 3)) + middle_m


def left_m(point_m: Any, first_m: float) -> float:
    """Error that one correction of z_e, from first_m, and the pixel's own step leave of a point's
    depth: each takes 2 for the rise of the path, which is less by a share that the second one
    multiplies by."""
    point_m = np.asarray(point_m, np.float64)
    legs = small_array().tx_m, small_array().rx_m
    steps = (
        np.linalg.norm([*point_m[:2], first_m] - leg, axis=1)
        - np.linalg.norm(point_m - leg, axis=1)
        for leg in legs
    )
    corrected_m = sum(step.mean() for step in steps) / 2
    return float(abs(first_m - point_m[2] - corrected_m) * slack(point_m))


def slack(point_m: Any, legs_m: Any = None) -> float:
    """Share of a step in depth that the factor 2 misses, averaged over the antennas of two legs [n,
    3]."""
    legs_m = legs_m or (small_array().tx_m, small_array().rx_m)
    return float(
        1 - sum(np.mean(point_m[2] / np.linalg.norm(point_m - leg, axis=1)) for leg in legs_m) / 2
    )


def echoes(
    points_m: Any,
    weight: Any = None,
    frequencies_hz: Any = ALL_HZ,
    array: AntennaArray | None = None,
) -> np.ndarray:
    """Samples complex128 [f, t, r] of points [n, 3] with a weight each (1), before the small array
    or another."""
    points_m = np.atleast_2d(np.asarray(points_m, np.float64))
    weight = np.ones(len(points_m)) if weight is None else weight
    return direct_echoes(
        points_m, weight, np.asarray(frequencies_hz, np.float64), array or small_array()
    )


def recorded(
    points_m: Any, frequencies_hz: Any = ALL_HZ, array: AntennaArray | None = None
) -> RadarCapture:
    """Capture of points [n, 3] that scatter equally."""
    return capture(echoes(points_m, None, frequencies_hz, array), frequencies_hz, array)


def capture(
    samples: np.ndarray, frequencies_hz: Any = ALL_HZ, array: AntennaArray | None = None
) -> RadarCapture:
    """One frame of samples [f, t, r], in single precision as a receiver's file has them."""
    samples = np.asarray(samples, np.complex64)[None]
    return RadarCapture(samples, np.asarray(frequencies_hz, np.float64), array or small_array())


def depth_map(id: str, taken: RadarCapture, half_m: float = HALF_M, **values: Any) -> DepthMap:
    """A method's depth map of the pixels about POINT_M, which lies on the axis, with these values
    of its configuration."""
    axis = Axis(start_m=-half_m, stop_m=half_m, step_m=STEP_M)
    return imaged(id, taken, x=axis, y=axis, **values)


def imaged(id: str, taken: RadarCapture, frame: int = 0, **values: Any) -> DepthMap:
    """A method's depth map with these values of its configuration."""
    return method(id).run(taken, method(id).configure(values, f"hard case of '{id}'"), frame)


def middle(values: np.ndarray) -> Any:
    """The map's middle pixel: the point's own."""
    return values[values.shape[0] // 2, values.shape[1] // 2]


def flags(depth: DepthMap) -> np.ndarray:
    """The map's pixels in doubt, of a method that flags them."""
    assert depth.wrapped is not None
    return depth.wrapped


def noisy(samples: np.ndarray, strongest: float, snr_db: float, seed: int) -> np.ndarray:
    """Samples [f, t, r] with white noise; snr_db: of an image's strongest pixel, whose amplitude is
    `strongest`."""
    channels = int(np.prod(samples.shape[1:]))
    sigma = strongest / np.sqrt(2 * channels) * 10 ** (-snr_db / 20)
    noise = np.random.default_rng(seed).normal(scale=sigma, size=(2, *samples.shape))
    return samples + noise[0] + 1j * noise[1]


@cache
def bumpy_points() -> np.ndarray:
    """Points [n, 3] of a smooth surface at 0.28 m, finer than a resolution cell."""
    along = np.arange(-0.024, 0.0241, 0.002)
    x, y = np.meshgrid(along, along)
    return np.stack([x, y, 0.28 + 0.003 * np.sin(60 * x) * np.cos(60 * y)], axis=-1).reshape(-1, 3)


def by_flag(
    place: str, off_m: np.ndarray, wrapped: np.ndarray
) -> Iterator[tuple[str, float, bool]]:
    """The largest error, millimetres, of pixels without a flag, then of those with one; NaN is no
    depth."""
    for flag in (False, True):
        yield place, 1e3 * off_m[np.isfinite(off_m) & (wrapped == flag)].max(initial=0.0), flag

"""Scenes of the hard cases: a small array, scatterers whose depth is known, and methods run on the
pixels about them. Echoes are formed in float64."""

from functools import cache

import numpy as np

from handbench.radar.data.arrays import SPEED_OF_LIGHT_M_S, AntennaArray, qar50
from handbench.radar.data.capture import RadarCapture
from handbench.radar.data.depthmap import DepthMap
from handbench.radar.methods.fsk import Fsk
from handbench.radar.methods.gross_errors import with_p_gross
from handbench.radar.methods.registry import method
from tests.radar.direct_sums import direct_echoes

C = SPEED_OF_LIGHT_M_S
FSK = ("2fsk", "3fsk", "3fsk-plus", "nfsk")
METHODS = (*FSK, "broadband", "narrowband")
LADDER_HZ = (82.0e9, 81.8e9, 81.3e9, 79.5e9, 72.0e9)
ALL_HZ = np.unique(np.concatenate([np.linspace(72e9, 82e9, 128), LADDER_HZ]))
POINT_M = (0.0, 0.0, 0.28)
FIRST_M = Fsk().first_depth_m
HALF_M = 0.012  # of the pixels about the point
VOXEL_MM = 0.5  # half a voxel of the projections
PERIOD_M = C / (2 * 2.5e9)  # of depths that three tones tell apart


@cache
def small_array() -> AntennaArray:
    """Every eighth antenna of the paper's frame, 12 + 12: as wide, and 60 times as fast."""
    return AntennaArray(qar50().tx_m[::8], qar50().rx_m[::8])


def missed(point_m, *legs_m: np.ndarray) -> float:
    """Share of a step in depth that the factor 2 misses, averaged over the antennas of two legs [n,
    3]: those of the small array, or others."""
    legs_m = legs_m or (small_array().tx_m, small_array().rx_m)
    return (
        1 - sum(np.mean(point_m[2] / np.linalg.norm(point_m - leg, axis=1)) for leg in legs_m) / 2
    )


def echoes(points_m, frequencies_hz=ALL_HZ, array=None) -> np.ndarray:
    """Samples complex128 [f, t, r] of points [n, 3] that scatter equally, before the small array or
    another."""
    points_m, array = np.atleast_2d(points_m), array or small_array()
    return direct_echoes(points_m, np.ones(len(points_m)), np.asarray(frequencies_hz), array)


def capture(samples, frequencies_hz=ALL_HZ, array=None) -> RadarCapture:
    """One frame of samples [f, t, r], in single precision as a receiver's file has them."""
    samples = np.asarray(samples, np.complex64)[None]
    return RadarCapture(samples, np.asarray(frequencies_hz), array or small_array())


def recorded(points_m, frequencies_hz=ALL_HZ, array=None) -> RadarCapture:
    """Capture of such points."""
    return capture(echoes(points_m, frequencies_hz, array), frequencies_hz, array)


def depth_map(id: str, taken: RadarCapture, half_m: float = HALF_M, **values) -> DepthMap:
    """A method's depth map of the pixels about POINT_M, which lies on the axis, with these values
    of its configuration. Projections have p_gross."""
    axis = {"start_m": -half_m, "stop_m": half_m, "step_m": 0.001}
    config = method(id).configure({"x": axis, "y": axis, **values}, "hard case")
    depth = method(id).run(taken, config)
    return depth if id in FSK else with_p_gross(depth, taken, config)


def middle(values: np.ndarray):
    """The map's middle pixel: the point's own."""
    return values[values.shape[0] // 2, values.shape[1] // 2]


def off_mm(depth: DepthMap, z_m: float = POINT_M[2]) -> float:
    """Error at the point's pixel."""
    return 1e3 * abs(float(middle(depth.z_m)) - z_m)

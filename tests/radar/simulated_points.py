"""Captures of scatterers whose depth is known, and pixels about them."""

import numpy as np

from handbench.radar.data.arrays import qar50
from handbench.radar.data.capture import RadarCapture
from handbench.radar.data.grid import Axis
from handbench.radar.methods.registry import method
from handbench.radar.simulation.effects.sensor import strongest_amplitude, thermal_noise
from handbench.radar.simulation.forward import Scatterers, simulate
from tests.radar.direct_sums import direct_echoes

TONES_HZ = np.array([82e9, 81.8e9, 79.5e9])


def exact_capture(points_m, frequencies_hz=TONES_HZ, weight=None, array=None) -> RadarCapture:
    """Points [n, 3] with a weight each (1), without spreading: float64 sums that share no code with
    the simulator."""
    points_m, array = np.atleast_2d(points_m), array or qar50()
    weight = np.ones(len(points_m)) if weight is None else weight
    samples = direct_echoes(points_m, weight, np.asarray(frequencies_hz), array)
    return RadarCapture(samples[None].astype(np.complex64), np.asarray(frequencies_hz), array)


def point_capture(point_m, frequencies_hz=TONES_HZ) -> RadarCapture:
    """One point without noise."""
    return points_capture(np.array([point_m]), frequencies_hz)


def points_capture(points_m, frequencies_hz=TONES_HZ, phase_noise_rad=0.0, seed=0) -> RadarCapture:
    """Points [n, 3] of equal strength; phase_noise_rad: between two tones at the strongest
    point."""
    frequencies_hz = np.asarray(frequencies_hz)
    samples = simulate(Scatterers(points_m, np.ones(len(points_m))), frequencies_hz, qar50())
    if phase_noise_rad:
        strongest = strongest_amplitude(samples[0], frequencies_hz[0], qar50(), points_m)
        samples = thermal_noise(samples, frequencies_hz, phase_noise_rad, strongest, (seed,))
    return RadarCapture(samples[None], frequencies_hz, qar50())


def surface_points(surface, half_m, pitch_m) -> np.ndarray:
    """Points [n, 3] on z = surface(x, y) over the square |x|, |y| ≤ half_m."""
    along = np.arange(-half_m, half_m + pitch_m / 2, pitch_m)
    x, y = np.meshgrid(along, along)
    return np.stack([x.ravel(), y.ravel(), surface(x, y).ravel()], axis=1)


def error_m(depth, surface) -> np.ndarray:
    """z − surface(x, y) of a depth map [ny, nx], NaN off target."""
    return depth.z_m - surface(*np.meshgrid(depth.x_m, depth.y_m))


def bumpy(x, y):
    """A smooth surface at 0.28 m."""
    return 0.28 + 0.004 * np.sin(2 * np.pi * x / 0.03) * np.cos(2 * np.pi * y / 0.04)


def depth_by(id, capture, pixels, **values):
    """A method's depth map of these pixels with these values of its configuration."""
    config = method(id).configure(pixels | values, "test")
    return method(id).run(capture, config, 0)


def around(point_m, half_m=0.012, step_m=0.001) -> dict[str, Axis]:
    """Pixels about a point, which lies on one of them; the full image would take as long for
    nothing more."""
    return {
        axis: Axis(start_m=p - half_m, stop_m=p + half_m, step_m=step_m)
        for axis, p in zip("xy", point_m[:2], strict=True)
    }


def strongest_z_m(depth) -> float:
    """Depth of the strongest pixel on target."""
    return float(
        depth.z_m.flat[np.argmax(np.where(np.isfinite(depth.z_m), depth.amplitude_db, -np.inf))]
    )

"""Depths of a moving metal finger whose echoes are the exact series of a cylinder at each tone's
place: nothing of handbench's simulation."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from handbench.radar.data.capture import RadarCapture
from handbench.radar.methods.registry import method
from tests.references.exact.cases import Case, front_m
from tests.references.exact.cylinders import ALONG, Cylinder, cylinder_echoes
from tests.references.exact.kept_echoes import thin_array

FINGER = Cylinder(0.0, 0.29, 8e-3)
FSK_HZ = np.array([82e9, 81.8e9, 79.5e9, 82e9])
SWEEP_HZ = np.linspace(72e9, 82e9, 13)
PIXELS = {
    "x": {"start_m": -0.02, "stop_m": 0.02, "step_m": 0.001},
    "y": {"start_m": -0.03, "stop_m": 0.03, "step_m": 0.002},
}


@cache
def moving(tones: str, velocity_m_s: float, step_s: float = 1e-3) -> RadarCapture:
    frequencies_hz = FSK_HZ if tones == "fsk" else SWEEP_HZ
    times_s = step_s * np.arange(len(frequencies_hz))
    samples = [
        cylinder_echoes(
            [replace(FINGER, z_m=FINGER.z_m + velocity_m_s * time_s)], hz[None], thin_array(), ALONG
        )[0]
        for hz, time_s in zip(frequencies_hz, times_s, strict=True)
    ]
    samples = np.array(samples)[None].astype(np.complex64)
    return RadarCapture(samples, frequencies_hz, thin_array(), times_s=times_s)


def mae_mm(id: str, capture: RadarCapture, **settings) -> float:
    """Mean absolute error of the depths above the paper's −10 dB."""
    chosen = method(id)
    depth = chosen.run(capture, chosen.configure(PIXELS | settings, id), 0)
    front = front_m(Case("one finger", (FINGER,), "metal", ALONG), depth.x_m, depth.y_m)
    return float(1e3 * np.nanmean(np.abs(depth.z_m - front)))


@pytest.mark.parametrize("velocity_m_s", (0.1, -0.1))
def test_depths_of_a_moving_finger(velocity_m_s):
    rest, moved = moving("fsk", 0.0), moving("fsk", velocity_m_s)
    at_rest_mm = mae_mm("3fsk", rest)
    assert mae_mm("3fsk-doppler", rest) < 1.1 * at_rest_mm
    assert mae_mm("3fsk-doppler", moved) < 1.2 * at_rest_mm
    # f/Δf·v·T of both tones, 49 ms on average
    assert mae_mm("3fsk", moved) > max(2 * at_rest_mm, 1e3 * 0.04 * abs(velocity_m_s))
    depth = method("3fsk-doppler").run(moved, method("3fsk-doppler").configure(PIXELS, ""), 0)
    assert np.nanmedian(depth.velocity_m_s) == pytest.approx(velocity_m_s, rel=0.03)


@pytest.mark.slow
def test_a_sweep_over_a_moving_finger_smears():
    # f·T/B: a sweep of 13 ms at 0.05 m/s shifts the depths by 5 mm
    z = {"start_m": 0.25, "stop_m": 0.31, "step_m": 0.001}
    sweep = {"tones_hz": {"count": len(SWEEP_HZ)}, "z": z}
    at_rest_mm = mae_mm("broadband", moving("sweep", 0.0), **sweep)
    moved_mm = mae_mm("broadband", moving("sweep", 0.05), **sweep)
    assert moved_mm > 2 * at_rest_mm

"""Depths of a moving metal finger whose echoes are the exact series of a cylinder at each tone's
place: nothing of handbench's simulation."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from handbench.radar.data.capture import RadarCapture
from handbench.radar.methods.registry import method
from tests.references.exact.cylinders import Cylinder, cylinder_echoes
from tests.references.exact.kept_echoes import thin_array

FINGER = Cylinder(0.0, 0.29, 8e-3)
TONES_HZ = np.array([82e9, 81.8e9, 79.5e9, 82e9])
TIMES_S = 1e-3 * np.arange(4)
PIXELS = {
    "x": {"start_m": -0.02, "stop_m": 0.02, "step_m": 0.001},
    "y": {"start_m": -0.03, "stop_m": 0.03, "step_m": 0.002},
}


@cache
def echo(z_m, hz):
    return cylinder_echoes([replace(FINGER, z_m=z_m)], np.array([hz]), thin_array())[0]


def moving(velocity_m_s):
    samples = np.array([*map(echo, FINGER.z_m + velocity_m_s * TIMES_S, TONES_HZ)])
    samples = samples[None].astype(np.complex64)
    return RadarCapture(samples, TONES_HZ, thin_array(), times_s=TIMES_S)


def imaged(id, capture):
    """The depth map, and its mean absolute error in mm above the paper's −10 dB."""
    depth = method(id).run(capture, method(id).configure(PIXELS, id))
    front_m = FINGER.z_m - np.sqrt(np.maximum(FINGER.radius_m**2 - depth.x_m**2, 0))
    on = np.abs(depth.x_m) < FINGER.radius_m
    return depth, 1e3 * np.nanmean(np.abs(depth.z_m - front_m)[:, on])


def test_depths_of_a_moving_finger_are_as_at_rest():
    rest = moving(0.0)
    at_rest_mm = imaged("3fsk", rest)[1]
    assert imaged("3fsk-doppler", rest)[1] < 1.1 * at_rest_mm
    moved = moving(-0.1)
    # f/Δf·v·T of both tones, 49 ms on average
    assert imaged("3fsk", moved)[1] > max(2 * at_rest_mm, 1e3 * 0.04 * 0.1)
    depth, moved_mm = imaged("3fsk-doppler", moved)
    assert moved_mm < 1.2 * at_rest_mm
    assert np.nanmedian(depth.velocity_m_s) == pytest.approx(-0.1, rel=0.03)

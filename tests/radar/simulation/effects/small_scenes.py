"""Small scenes for effects: a metal bead before the array."""

import numpy as np

from radar.data.arrays import qar50
from radar.simulation.causes import Causes
from radar.simulation.scene import Body, EchoScene
from radar.simulation.selection import choose
from radar.simulation.simulate import SimulatedCapture, simulate_scene

TONES_HZ = np.array([79.5e9, 81.8e9, 82e9])


def sphere_body(radius_m, centre_m, count=24) -> Body:
    """A sphere of triangles."""
    polar, azimuth = np.meshgrid(np.linspace(0, np.pi, count), np.linspace(0, 2 * np.pi, 2 * count), indexing="ij")
    unit = np.stack([np.sin(polar) * np.cos(azimuth), np.sin(polar) * np.sin(azimuth), np.cos(polar)], axis=-1)
    index = np.arange(polar.size).reshape(polar.shape)
    a, b, c, d = (index[i : i + count - 1, j : j + 2 * count - 1].ravel() for i, j in ((0, 0), (1, 0), (1, 1), (0, 1)))
    faces = np.concatenate([np.stack([a, b, c], 1), np.stack([a, c, d], 1)])
    return Body(np.asarray(centre_m) + radius_m * unit.reshape(-1, 3), faces)


def bead_scene(causes: dict | None = None, time_s=(0.0, 1e-3, 2e-3), **changes) -> EchoScene:
    """A bead of 4 mm at 0.30 m before the paper's array, with three tones and some causes."""
    values = {"target": sphere_body(4e-3, (0.01, -0.005, 0.3)), "seed": 3, **changes}
    return EchoScene(qar50(), TONES_HZ, np.asarray(time_s), causes=Causes(**(causes or {})), **values)


def simulated(scene: EchoScene, *effects: str, frames: int = 1, **options) -> SimulatedCapture:
    """The scene with the listed effects."""
    return simulate_scene(scene, choose(scene, effects, 0.1), frames, **options)

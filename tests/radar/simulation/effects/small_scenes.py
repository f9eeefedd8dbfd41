"""Small scenes for effects: a metal bead before the array."""

import numpy as np

from handbench.radar.data.arrays import SPEED_OF_LIGHT_M_S, qar50
from handbench.radar.imaging.api import image_points
from handbench.radar.simulation.ablation import explain
from handbench.radar.simulation.catalogue import choose
from handbench.radar.simulation.scene import (
    Ball,
    Choice,
    EchoScene,
    Motion,
    Noise,
    Roughness,
    SensorFaults,
)
from handbench.radar.simulation.scene_echoes import Echoes, bare_echoes
from handbench.radar.simulation.simulate import SimulatedCapture, simulate_scene
from tests.radar.simulation.effects.plates import sphere_body

TONES_HZ = np.array([79.5e9, 81.8e9, 82e9])
NEAR_SIDE_M = np.array([[0.01, -0.005, 0.296]])  # of the bead
FOAM_BALL = Ball(np.array([0.01, -0.02, 0.3]), 5e-3, 0.025, 1.03)
EVERYTHING = {
    "noise": {"phase_noise_rad": 0.05},
    "oscillator": {"level_dbc_hz": -80.0},
    "motion": {"amplitude_m": 1e-4},
    "pattern": {"beamwidth_deg": 60.0},
    "coupling": {"level_db": -20.0},
    "positions": {"sigma_m": 2e-5},
    "channels": {"gain_db": 0.5, "phase_rad": 0.1},
    "dead": {"tx": (1,)},
    "converter": {"bits": 12},
}


def causes(**values: dict) -> dict:
    """The fields of a scene with these causes of effects, by the names of the effects."""
    own = {"noise": Noise, "motion": Motion, "roughness": Roughness}
    faults = {name: values[name] for name in values.keys() - own.keys()}
    fields = {name: own[name](**values[name]) for name in values.keys() & own.keys()}
    return fields | {"sensor": SensorFaults(**faults)}


def bead_scene(caused: dict | None = None, time_s=(0.0, 1e-3, 2e-3), **changes) -> EchoScene:
    """A bead of 4 mm at 0.30 m before the paper's array, with three tones and some causes."""
    values = {"target": sphere_body(4e-3, (0.01, -0.005, 0.3)), "seed": 3, **changes}
    return EchoScene(qar50(), TONES_HZ, np.asarray(time_s), **causes(**caused or {}), **values)


def simulated(scene: EchoScene, *effects: str, frames: int = 1, **options) -> SimulatedCapture:
    """The scene with the listed effects."""
    return simulate_scene(scene, choose(scene, effects), frames, **options)


def depth_shift_m(before, after) -> float:
    """How far the bead's depth by the first and the last tone is behind that of another capture."""
    products = []
    for capture in (before, after):
        points = capture.aperture, NEAR_SIDE_M
        images = image_points(capture.samples[0], TONES_HZ, *points, None, per_tone=True)[:, 0]
        products.append(images[-1] * images[0].conj())
    turned = np.angle(products[1] * products[0].conj())
    return -SPEED_OF_LIGHT_M_S * turned / (4 * np.pi * (TONES_HZ[-1] - TONES_HZ[0]))


def shaped(scene: EchoScene, *effects, **options) -> Echoes:
    """The scene's echoes after functions of effects have shaped them."""
    echoes = bare_echoes(scene, **options)
    for effect in effects:
        echoes.shape(effect)
    return echoes


def explained(scene: EchoScene, *effects: str) -> dict[str, Choice]:
    """What leaving each of the effects out changes, by an ablation: effect → row."""
    rows = explain(scene, choose(scene, effects or "auto"))
    return {row.effect: row for row in rows}

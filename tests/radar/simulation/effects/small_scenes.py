"""Small scenes for effects: a metal bead before the array."""

import numpy as np
import pytest

from handbench.radar.data.arrays import SPEED_OF_LIGHT_M_S, qar50
from handbench.radar.data.grid import Axis
from handbench.radar.imaging.api import image_points
from handbench.radar.methods.depth_uncertainty import fsk_with_uncertainty
from handbench.radar.methods.fsk_config import ThreeToneConfig
from handbench.radar.simulation.ablation import Ablation, Change
from handbench.radar.simulation.catalogue import CONTAINED, EFFECTS, Effect
from handbench.radar.simulation.causes import Causes
from handbench.radar.simulation.known_effects import IDS
from handbench.radar.simulation.scene import EchoScene
from handbench.radar.simulation.selection import choose
from handbench.radar.simulation.simulate import SimulatedCapture, simulate_scene
from tests.radar.simulation.effects.plates import sphere_body

TONES_HZ = np.array([79.5e9, 81.8e9, 82e9])
NEAR_SIDE_M = np.array([[0.01, -0.005, 0.296]])  # of the bead
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


@pytest.fixture
def no_random_numbers(monkeypatch):
    """Refuses what scenes draw from."""

    def refuse(*arguments, **named):
        raise AssertionError("drew a random number")

    monkeypatch.setattr(np.random, "default_rng", refuse)
    monkeypatch.setattr(np.random, "SeedSequence", refuse)


def bead_scene(causes: dict | None = None, time_s=(0.0, 1e-3, 2e-3), **changes) -> EchoScene:
    """A bead of 4 mm at 0.30 m before the paper's array, with three tones and some causes."""
    values = {"target": sphere_body(4e-3, (0.01, -0.005, 0.3)), "seed": 3, **changes}
    return EchoScene(
        qar50(), TONES_HZ, np.asarray(time_s), causes=Causes(**(causes or {})), **values
    )


def simulated(scene: EchoScene, *effects: str, frames: int = 1, **options) -> SimulatedCapture:
    """The scene with the listed effects."""
    return simulate_scene(scene, choose(scene, effects), frames, **options)


def depth_shift_m(before, after, low: int = 0, high: int = 2) -> float:
    """How far the bead's FSK depth between two tones is behind that of another capture."""
    products = []
    for capture in (before, after):
        points = capture.aperture, NEAR_SIDE_M
        images = image_points(capture.samples[0], TONES_HZ, *points, None, apart=True)[:, 0]
        products.append(images[high] * images[low].conj())
    turned = np.angle(products[1] * products[0].conj())
    return -SPEED_OF_LIGHT_M_S * turned / (4 * np.pi * (TONES_HZ[high] - TONES_HZ[low]))


def effect(name: str) -> Effect:
    """The effect of that name."""
    return EFFECTS[IDS.index(name)]


def estimated(scene: EchoScene, *effects: str, without: str) -> tuple[dict[str, Change], float]:
    """What leaving one of the effects out does to each method's map, and its level in dB, by an
    ablation."""
    ablation = Ablation(scene, [effect(name) for name in effects], CONTAINED)
    return ablation.change({without}), ablation.level_db({without})


def simulated_change(scene: EchoScene, *effects: str, without: str) -> tuple[Change, float]:
    """The same of 3-FSK's map, by two whole simulations and the method as users run it, at pixels
    of 1 mm."""
    rest = [name for name in effects if name != without]
    captures = [simulated(scene, *names).capture for names in (effects, rest)]
    middle = np.round(scene.middle_m[:2], 3)
    reach_m, step_m = (0.15, 2e-3) if scene.room else (0.02, 1e-3)
    x, y = (Axis(start_m=at - reach_m, stop_m=at + reach_m, step_m=step_m) for at in middle)
    config = ThreeToneConfig(x=x, y=y, first_depth_m=0.3)
    maps = [fsk_with_uncertainty(capture, config).z_m for capture in captures]
    samples = [capture.samples[0] for capture in captures]
    level = np.linalg.norm(samples[1] - samples[0]) / np.linalg.norm(samples[0])
    return Change.between(*maps), float(20 * np.log10(level))

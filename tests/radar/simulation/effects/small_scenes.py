"""Small scenes for effects: a metal bead before the array."""

import numpy as np

from handbench.radar.data.arrays import qar50
from handbench.radar.data.grid import Axis
from handbench.radar.methods.depth_uncertainty import fsk_with_uncertainty
from handbench.radar.methods.fsk_config import ThreeToneConfig
from handbench.radar.simulation.ablation import Ablation, Change
from handbench.radar.simulation.catalogue import CONTAINED, EFFECTS, Effect
from handbench.radar.simulation.causes import Causes
from handbench.radar.simulation.known_effects import IDS
from handbench.radar.simulation.scene import Body, EchoScene
from handbench.radar.simulation.selection import choose
from handbench.radar.simulation.simulate import SimulatedCapture, simulate_scene

TONES_HZ = np.array([79.5e9, 81.8e9, 82e9])


def sphere_body(radius_m, centre_m, count=24) -> Body:
    """A sphere of triangles."""
    polar, azimuth = np.meshgrid(
        np.linspace(0, np.pi, count), np.linspace(0, 2 * np.pi, 2 * count), indexing="ij"
    )
    unit = np.stack(
        [np.sin(polar) * np.cos(azimuth), np.sin(polar) * np.sin(azimuth), np.cos(polar)], axis=-1
    )
    index = np.arange(polar.size).reshape(polar.shape)
    a, b, c, d = (
        index[i : i + count - 1, j : j + 2 * count - 1].ravel()
        for i, j in ((0, 0), (1, 0), (1, 1), (0, 1))
    )
    faces = np.concatenate([np.stack([a, b, c], 1), np.stack([a, c, d], 1)])
    return Body(np.asarray(centre_m) + radius_m * unit.reshape(-1, 3), faces)


def bead_scene(causes: dict | None = None, time_s=(0.0, 1e-3, 2e-3), **changes) -> EchoScene:
    """A bead of 4 mm at 0.30 m before the paper's array, with three tones and some causes."""
    values = {"target": sphere_body(4e-3, (0.01, -0.005, 0.3)), "seed": 3, **changes}
    return EchoScene(
        qar50(), TONES_HZ, np.asarray(time_s), causes=Causes(**(causes or {})), **values
    )


def simulated(scene: EchoScene, *effects: str, frames: int = 1, **options) -> SimulatedCapture:
    """The scene with the listed effects."""
    return simulate_scene(scene, choose(scene, effects, 0.1), frames, **options)


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

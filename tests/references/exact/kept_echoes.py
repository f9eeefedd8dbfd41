"""How far simulations are from exact echoes.

Of every second antenna at the tones of 3-FSK. Echoes that take minutes are kept in half precision,
made by this module of commit d67b8e8a: 2e-4 of the samples, below 0.01 mm in 2-FSK's maps. With
sharp shadows the means of the differences above 0.2 mm are within 3 % (3-FSK) and 10 % (2-FSK) of
the whole array's.
"""

from pathlib import Path

import numpy as np

from handbench.radar.data.arrays import AntennaArray, qar50
from handbench.radar.data.capture import RadarCapture
from handbench.radar.methods.registry import METHODS
from handbench.radar.simulation.catalogue import choose
from handbench.radar.simulation.scene import EchoScene
from handbench.radar.simulation.simulate import simulate_scene
from tests.radar.samples import relative_error
from tests.references.exact.cases import MATERIALS, SCENES, body, exact_echoes

LONG_M = 0.03  # depths are compared as far along the cylinders, where their ends do not count
# the effect that a kind of material needs
REFLECTION = {"metal": (), "plastic": ("dielectric",), "skin": ("skin",)}
FOLDER = Path(__file__).parent / "echoes"
TONES_HZ = np.array([79.5e9, 81.8e9, 82e9])


def thin_array() -> AntennaArray:
    """Every second antenna."""
    return AntennaArray(qar50().tx_m[::2], qar50().rx_m[::2])


def exact(scene: str, material: str) -> np.ndarray:
    """Samples [f, t, r] of a scene, kept or made anew."""
    path = FOLDER / f"{scene.replace(',', '').replace(' ', '_')}-{material}.npz"
    if not path.exists():
        return exact_echoes(SCENES[scene], material, TONES_HZ, thin_array())
    with np.load(path) as file:
        return file["scale"] * file["samples"].astype(np.float32).view(np.complex64)[..., 0]


def against_exact(scene: str, material: str, *effects: str) -> dict[str, float]:
    """Differences of the simulation with these effects, besides that of the material, from the
    exact echoes: echo_error, relative L2, and METHOD_mean_mm, mean |Δz| where both maps have a
    depth."""
    simulated = EchoScene(thin_array(), TONES_HZ, np.zeros(3), body(SCENES[scene], material))
    chosen = choose(simulated, (*effects, *REFLECTION[MATERIALS[material].kind]))
    ours = simulate_scene(simulated, chosen).capture
    samples = exact(scene, material)
    theirs = RadarCapture(samples[None].astype(np.complex64), TONES_HZ, thin_array())
    errors = {"echo_error": relative_error(ours.samples[0], samples)}
    for id in ("2fsk", "3fsk"):
        method = METHODS[id]
        depth, true = (method.run(capture, method.defaults) for capture in (ours, theirs))
        near = np.abs(depth.y_m) < LONG_M
        errors[f"{id}_mean_mm"] = 1e3 * np.nanmean(np.abs(depth.z_m - true.z_m)[near])
    return errors

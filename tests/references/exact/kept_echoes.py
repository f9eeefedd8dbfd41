"""Exact echoes of cylinders in small files, and how far simulations are from them.

Every second antenna, the tones of 3-FSK, and half precision: 2e-4 of the samples, below 0.01 mm in
2-FSK's maps. With sharp shadows the means of the differences above 0.2 mm are within 3 % (3-FSK)
and 10 % (2-FSK) of the whole array's.

    python -m tests.references.exact.kept_echoes     # makes them again: half a minute
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from handbench.radar.data.arrays import AntennaArray, qar50
from handbench.radar.data.capture import RadarCapture
from handbench.radar.simulation.scene import EchoScene
from handbench.radar.simulation.selection import choose
from handbench.radar.simulation.simulate import simulate_scene
from tests.radar.samples import relative_error
from tests.references.exact.cases import MATERIALS, SCENES, Case, body, exact_echoes, maps
from tests.references.exact.cylinders import ALONG

LONG_M = 0.03  # depths are compared as far along the cylinders, where their ends do not count
# the effect that a kind of material needs
REFLECTION = {"metal": (), "plastic": ("dielectric",), "skin": ("skin",)}
METHODS = ("2fsk", "3fsk")
FOLDER = Path(__file__).parent / "echoes"
TONES_HZ = np.array([79.5e9, 81.8e9, 82e9])
KEPT = (
    ("one finger", "skin"),
    ("finger before palm", "skin"),
    ("finger before palm, 12 mm aside", "metal"),
)


def thin_array() -> AntennaArray:
    """Every second antenna."""
    array = qar50()
    return AntennaArray(array.tx_m[::2], array.rx_m[::2])


def kept(scene: str, material: str) -> np.ndarray:
    """Samples [f, t, r] of a scene of KEPT; of one sphere, made anew."""
    if (scene, material) not in KEPT:
        return exact_echoes(Case(scene, SCENES[scene], material, ALONG), TONES_HZ, thin_array())
    with np.load(_path(scene, material)) as file:
        return file["scale"] * file["samples"].astype(np.float32).view(np.complex64)[..., 0]


def against_exact(scene: str, material: str, *effects: str) -> dict[str, float]:
    """Differences of the simulation with these effects, besides that of the material, from the
    exact echoes: echo_error, relative L2, and METHOD_mean_mm, mean |Δz| where both maps have a
    depth."""
    exact = kept(scene, material)
    case = Case(scene, SCENES[scene], material, ALONG)
    simulated = EchoScene(thin_array(), TONES_HZ, np.zeros(len(TONES_HZ)), body(case))
    chosen = choose(simulated, (*effects, *REFLECTION[MATERIALS[material].kind]))
    capture = simulate_scene(simulated, chosen).capture
    known = RadarCapture(exact[None].astype(np.complex64), TONES_HZ, thin_array())
    found = {"echo_error": relative_error(capture.samples[0], exact)}
    ours, exact_maps = maps(capture, METHODS), maps(known, METHODS)
    for name, depth in ours.items():
        near = np.abs(depth.y_m) < LONG_M
        off_m = depth.z_m[near] - exact_maps[name].z_m[near]
        found[f"{name}_mean_mm"] = float(1e3 * np.nanmean(np.abs(off_m)))
    return found


def _path(scene: str, material: str) -> Path:
    return FOLDER / f"{scene.replace(',', '').replace(' ', '_')}-{material}.npz"


if __name__ == "__main__":
    FOLDER.mkdir(exist_ok=True)
    for scene, material in KEPT:
        samples = exact_echoes(Case(scene, SCENES[scene], material, ALONG), TONES_HZ, thin_array())
        scale = np.abs(samples).max()
        halves = (samples / scale).view(float).reshape(*samples.shape, 2).astype(np.float16)
        np.savez_compressed(_path(scene, material), samples=halves, scale=np.float32(scale))
        print(f"{scene}, {material}: {_path(scene, material).stat().st_size / 1e3:.0f} kB")

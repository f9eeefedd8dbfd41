"""Rounding of a scene's places, by 1e-14 of them, moves its echoes by rounding: each effect by
itself, on a hand and small bodies. The references are the same scenes unmoved."""

from dataclasses import replace

import pytest

from handbench.bench.scenes.build import build
from handbench.bench.scenes.echoes import echo_scene
from handbench.bench.scenes.scene_file import SceneFile
from handbench.radar.data.arrays import AntennaArray
from handbench.radar.simulation.catalogue import EFFECTS, choose
from handbench.radar.simulation.scene import EchoScene
from handbench.radar.simulation.simulate import simulate_scene
from handbench.support.config import parse
from tests.radar.samples import relative_error

SHARE = 1e-14  # of each coordinate: 4e-15 m on a hand
# Samples are sums of thousands of echoes in float32: 2e-7 was measured at most, on plates, and 2e-8
# on hands.
ROUNDING = 5e-7
# A ray that just misses an outline hits it: one vertex of thousands changes sides for one antenna
# (measured: 1e-4).
ONE_RAY = 1e-3
CASTING = ("shadow", "multipath", "clutter")
SURFACE = {"skin", "dielectric", "shadow", "multipath", "roughness"}  # on every body
ROUGH = {"roughness": {"rms_m": 2e-5}}
TARGETS = {
    "hand B": {"kind": "hand", "pose": "B", "edge_m": 4e-3, "material": {"kind": "skin"}, **ROUGH},
    "plate": {
        "kind": "plate",
        "width_m": 0.02,
        "height_m": 0.02,
        "edge_m": 2e-3,
        "material": {"kind": "plastic"},
        "motion": {"amplitude_m": 1e-4},
        **ROUGH,
    },
    "dihedral": {"kind": "dihedral", "side_m": 0.02, "edge_m": 2e-3},
}
SENSOR = {
    "sweep": [],
    "tones_hz": [79.5e9, 81.8e9],
    "pattern": {"beamwidth_deg": 80},
    "positions": {"sigma_m": 1e-4},
    "coupling": {"level_db": -20},
    "channels": {"gain_db": 0.3},
    "oscillator": {"level_dbc_hz": -90},
    "dead": {"tx": [3]},
}


def rounded_scenes(target: dict) -> tuple[EchoScene, EchoScene]:
    """A scene before every eighth antenna, with facets and mirrors of twice the usual edge, and the
    same once all vertices are multiplied by 1 + SHARE."""
    values = {"version": 1, "name": "s", "target": {"distance_m": 0.3, **target}, "sensor": SENSOR}
    values |= {"noise": {"phase_noise_rad": 0.03}}
    values |= {"stand": {"reflectivity_db": -10.0}} if target["kind"] == "plate" else {}
    made = echo_scene(build(parse(SceneFile, values, "test")))
    sparse = AntennaArray(made.array.tx_m[::8], made.array.rx_m[::8])
    before = replace(made, array=sparse, coarser=2.0)
    body, *room = (
        replace(body, vertices_m=body.vertices_m * (1 + SHARE)) for body in (made.body, *made.room)
    )
    assert (body.vertices_m != made.body.vertices_m).any()
    return before, replace(before, target=body, room=tuple(room))


@pytest.mark.slow
@pytest.mark.parametrize("name", TARGETS)
def test_rounding_stays_rounding_with_each_effect(name):
    before, after = rounded_scenes(TARGETS[name])
    caused = [effect.id for effect in EFFECTS if effect.cause(before)]
    for effect in caused if name == "plate" else SURFACE.intersection(caused):
        listed = tuple({"obliquity", effect})
        one, other = (
            simulate_scene(scene, choose(scene, listed)).capture.samples
            for scene in (before, after)
        )
        bound = ONE_RAY if effect in CASTING else ROUNDING
        assert relative_error(other, one) < bound, effect

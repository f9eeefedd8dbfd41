"""Random scenes of all kinds, each determined by a seed: the target, its distance, and the
imperfections of radar and surroundings.

Strengths of imperfections are drawn evenly on a logarithmic scale, so that each effect ranges from
negligible to dominant.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from handbench.bench.scenes.build import Scene, build
from handbench.bench.scenes.hand_pose import POSES
from handbench.bench.scenes.scene_file import SceneFile
from handbench.bench.scenes.shapes import cylinder_mesh, sphere_mesh
from handbench.groundtruth.mesh.mesh_files import mesh, write_mesh
from handbench.support.config import parse
from handbench.support.rays import TriangleMesh

EDGE_M, WIRE_M = 2e-3, 0.08
TONES = {"sweep": [], "tones_hz": [82e9, 81.8e9, 81.3e9, 79.5e9, 72e9]}
SKIN, PLASTIC = {"kind": "skin"}, {"kind": "plastic", "permittivity": 2.7, "loss_tangent": 0.01}
KINDS = (
    "hand",
    "bowl",
    "sphere",
    "printed hand",
    "plate",
    "wires",
    "moving hand",
    "skin spheres",
    "dihedral",
    "board",
)
BEHIND_M = 0.2  # the stand's plate


def assorted_scene(seed: int, folder: Path) -> Scene:
    """Make the random scene of a seed. The seed modulo the number of kinds selects the kind of
    target (hand, bowl, sphere, …). If the target is a mesh, it is written into the folder."""
    draw, kind = np.random.default_rng(seed), KINDS[seed % len(KINDS)]
    name = f"{kind.replace(' ', '-')}-{seed}"
    target, surface = _target(kind, draw)
    if surface is not None:
        target |= {"kind": "mesh", "path": f"{name}.ply"}
        write_mesh(folder / f"{name}.ply", surface)
    distance_m = float(draw.uniform(0.2, 1.0 if "hand" in kind else 0.6))
    target |= {"distance_m": distance_m, "rotation_deg": draw.uniform(-12, 12, 3).tolist()}
    sensor, around = _imperfect(draw)
    if kind == "moving hand" or draw.random() < 0.2:
        still_m, speed_m_s = _decades(draw, 1e-9, 1e-4), _decades(draw, 1e-8, 1e-2)
        target["motion"] = {"amplitude_m": still_m, "velocity_m_s": speed_m_s}
    values = {
        "version": 1,
        "name": name,
        "seed": seed,
        "target": target,
        "sensor": TONES | sensor,
        "mount": {"offset_m": [0.0, 0.0, distance_m + BEHIND_M]},
    }
    return build(parse(SceneFile, values | around, name), folder)


def _target(kind: str, draw: np.random.Generator) -> tuple[dict[str, Any], TriangleMesh | None]:
    """Draw a target of the given kind, such as "hand" or "bowl". Returns its table for the scene
    file, and its mesh (None for a shape that scene files have built in)."""
    shape: dict[str, Any] = {"kind": kind, "edge_m": EDGE_M}
    match kind:
        case "sphere":
            return shape | {"radius_m": _decades(draw, 5e-3, 6e-2)}, None
        case "plate" | "board":
            width_m, height_m = draw.uniform(0.03, 0.15, 2).tolist()
            shape |= {"kind": "plate", "width_m": width_m, "height_m": height_m}
            return shape | ({"material": PLASTIC} if kind == "board" else {}), None
        case "dihedral":
            return shape | {"side_m": draw.uniform(0.03, 0.08), "material": PLASTIC}, None
        case "bowl":
            return {}, bowl(draw.uniform(0.02, 0.05), draw.uniform(20, 85))
        case "wires":
            radii_m, gap_m = 10 ** draw.uniform(-3, -2, 2), draw.uniform(1e-3, 3e-2)
            left, right = -radii_m[0] - gap_m / 2, radii_m[1] + gap_m / 2
            return {}, wire(radii_m[0], left) + wire(radii_m[1], right)
        case "skin spheres":
            radii_m, apart = draw.uniform(8e-3, 2e-2, 2), draw.normal(size=3) * [1, 1, 0.5]
            apart *= (radii_m.sum() + draw.uniform(1e-3, 3e-2)) / np.linalg.norm(apart)
            first, second = (sphere_mesh(radius_m, EDGE_M) for radius_m in radii_m)
            return {"material": SKIN}, first + second.translate(apart)
    pose, material = str(draw.choice(list(POSES))), PLASTIC if "printed" in kind else SKIN
    return shape | {"kind": "hand", "pose": pose, "material": material}, None


def _imperfect(draw: np.random.Generator) -> tuple[dict[str, Any], dict[str, Any]]:
    """Draw imperfections, of which each is present or absent at random. Returns the sensor's keys
    for the scene file, and the scene file's tables of noise and stand."""
    faults = {
        "oscillator": {"level_dbc_hz": draw.uniform(-120, -80)},
        "pattern": {"beamwidth_deg": draw.uniform(40, 150)},
        "positions": {"sigma_m": _decades(draw, 1e-7, 5e-5)},
        "channels": {"gain_db": _decades(draw, 1e-3, 0.5), "phase_rad": _decades(draw, 1e-4, 0.1)},
        "coupling": {"level_db": draw.uniform(-80, -20)},
        "converter": {"bits": int(draw.integers(8, 17))},
        "dead": {"tx": [int(draw.integers(94))]},
    }
    sensor = _some(faults, draw, 0.4)
    tables = {
        "noise": {"phase_noise_rad": _decades(draw, 1e-4, 0.05)},
        "stand": {"reflectivity_db": draw.uniform(-90, -15)},
    }
    return sensor, _some(tables, draw, (0.7, 0.4))


def _some(
    known: dict[str, Any], draw: np.random.Generator, share: float | tuple[float, ...]
) -> dict[str, Any]:
    there = draw.random(len(known)) < share
    return {name: known[name] for name, on in zip(known, there, strict=True) if on}


def _decades(draw: np.random.Generator, low: float, high: float) -> float:
    return float(low * (high / low) ** draw.random())


def bowl(radius_m: float, half_angle_deg: float, thick_m: float = 2e-3) -> TriangleMesh:
    """Make the mesh of a bowl: a cap of a spherical shell of radius radius_m, thick_m thick, which
    opens towards −z and has its deepest point at the origin. half_angle_deg: angle from the cap's
    middle to its rim, seen from the sphere's centre."""
    surface = sphere_mesh(radius_m, EDGE_M)
    x, y, z = np.asarray(surface.vertices).T
    polar, turn = np.arccos(np.clip(z / radius_m, -1, 1)), np.arctan2(y, x)
    angle = np.radians(half_angle_deg) * np.minimum(polar, np.pi - polar) / (np.pi / 2)
    radii_m = np.where(polar <= np.pi / 2, radius_m + thick_m, radius_m)
    shell = [np.sin(angle) * np.cos(turn), np.sin(angle) * np.sin(turn), np.cos(angle)]
    return mesh((radii_m * np.array(shell)).T - [0, 0, radius_m], np.asarray(surface.triangles))


def wire(radius_m: float, x_m: float) -> TriangleMesh:
    """Make the mesh of a cylinder 80 mm long (WIRE_M), parallel to the y axis at x = x_m."""
    along, around = int(WIRE_M / EDGE_M), max(16, int(2 * np.pi * radius_m / EDGE_M))
    return cylinder_mesh(radius_m, WIRE_M, around, along).translate([x_m, 0.0, 0.0])

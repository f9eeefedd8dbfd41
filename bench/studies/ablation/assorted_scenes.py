"""Random scenes of all kinds, each of a seed alone: what stands before the array, how far away, and what is imperfect.

Sizes of causes are spread evenly over decades, so that each effect is anything between all and nothing.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from bench.scenes.build import Scene, build
from bench.scenes.hand_pose import POSES
from bench.scenes.scene_file import SceneFile
from groundtruth.mesh.mesh_files import mesh, write_mesh
from radar.simulation.physics.facets import face_vectors
from radar.support.config import parse

Mesh = tuple[np.ndarray, np.ndarray]
EDGE_M = 2e-3
TONES = {"sweep": [], "tones_hz": [82e9, 81.8e9, 81.3e9, 79.5e9, 72e9]}
SKIN, PLASTIC = {"kind": "skin"}, {"kind": "plastic", "permittivity": 2.7, "loss_tangent": 0.01}
KINDS = ("hand", "bowl", "sphere", "printed hand", "plate", "wires", "moving hand", "skin spheres", "dihedral", "board")
BEHIND_M = 0.2  # the stand's plate


def assorted_scene(seed: int, folder: Path) -> Scene:
    """The scene of a seed; a mesh that it needs is written into the folder."""
    draw, kind = np.random.default_rng(seed), KINDS[seed % len(KINDS)]
    name = f"{kind.replace(' ', '-')}-{seed}"
    target, surface = _target(kind, draw)
    if surface is not None:
        target |= {"kind": "mesh", "path": f"{name}.ply"}
        write_mesh(folder / f"{name}.ply", mesh(*surface))
    distance_m = float(draw.uniform(0.2, 1.0 if "hand" in kind else 0.6))
    target |= {"distance_m": distance_m, "rotation_deg": draw.uniform(-12, 12, 3).tolist()}
    sensor, around = _imperfect(draw)
    if kind == "moving hand" or draw.random() < 0.2:
        target["motion"] = {"amplitude_m": _decades(draw, 1e-9, 1e-4), "velocity_m_s": _decades(draw, 1e-8, 1e-2)}
    mount = {"offset_m": [0.0, 0.0, distance_m + BEHIND_M]}
    values = {"version": 1, "name": name, "seed": seed, "target": target, "sensor": TONES | sensor, "mount": mount}
    return build(parse(SceneFile, values | around, name), folder)


def _target(kind: str, draw: np.random.Generator) -> tuple[dict[str, Any], Mesh | None]:
    """The target's table, and its mesh where it needs one."""
    if "hand" in kind:
        pose = str(draw.choice(list(POSES)))
        return {
            "kind": "hand",
            "pose": pose,
            "material": PLASTIC if "printed" in kind else SKIN,
            "edge_m": EDGE_M,
        }, None
    if kind == "sphere":
        return {"kind": "sphere", "radius_m": _decades(draw, 5e-3, 6e-2), "edge_m": EDGE_M}, None
    if kind in ("plate", "board"):
        width_m, height_m = draw.uniform(0.03, 0.15, 2).tolist()
        material = PLASTIC if kind == "board" else {"kind": "metal"}
        return {"kind": "plate", "width_m": width_m, "height_m": height_m, "edge_m": EDGE_M, "material": material}, None
    if kind == "dihedral":
        return {"kind": "dihedral", "side_m": draw.uniform(0.03, 0.08), "edge_m": EDGE_M, "material": PLASTIC}, None
    if kind == "bowl":
        return {}, bowl(draw.uniform(0.02, 0.05), draw.uniform(20, 85))
    if kind == "wires":
        radii_m, gap_m = 10 ** draw.uniform(-3, -2, 2), draw.uniform(1e-3, 3e-2)
        places = (-radii_m[0] - gap_m / 2, radii_m[1] + gap_m / 2)
        wires = [cylinder(r, 0.08) for r in radii_m]
        return {}, joined([(v + [x, 0, 0], f) for (v, f), x in zip(wires, places, strict=True)])
    radii_m, apart = draw.uniform(8e-3, 2e-2, 2), draw.normal(size=3) * [1, 1, 0.5]
    apart *= (radii_m.sum() + draw.uniform(1e-3, 3e-2)) / np.linalg.norm(apart)
    first, second = (ball(r) for r in radii_m)
    return {"material": SKIN}, joined([first, (second[0] + apart, second[1])])


def _imperfect(draw: np.random.Generator) -> tuple[dict[str, Any], dict[str, Any]]:
    """The sensor's faults, and the tables of noise and stand: each there or not."""
    faults = {
        "oscillator": {"level_dbc_hz": draw.uniform(-120, -80)},
        "pattern": {"beamwidth_deg": draw.uniform(40, 150)},
        "positions": {"sigma_m": _decades(draw, 1e-7, 5e-5)},
        "channels": {"gain_db": _decades(draw, 1e-3, 0.5), "phase_rad": _decades(draw, 1e-4, 0.1)},
        "coupling": {"level_db": draw.uniform(-80, -20)},
        "converter": {"bits": int(draw.integers(8, 17))},
        "dead": {"tx": [int(draw.integers(94))]},
    }
    there = draw.random(len(faults)) < 0.4
    tables = {
        "noise": {"phase_noise_rad": _decades(draw, 1e-4, 0.05)},
        "stand": {"reflectivity_db": draw.uniform(-90, -15)},
    }
    chosen = draw.random(2) < (0.7, 0.4)
    return (
        {name: fault for (name, fault), on in zip(faults.items(), there, strict=True) if on},
        {name: table for (name, table), on in zip(tables.items(), chosen, strict=True) if on},
    )


def _decades(draw: np.random.Generator, low: float, high: float) -> float:
    return float(low * (high / low) ** draw.random())


def bowl(radius_m: float, half_angle_deg: float, thick_m: float = 2e-3) -> Mesh:
    """A part of a spherical shell, open towards -z: up to half_angle_deg from its deepest point, at the origin."""
    angle = np.linspace(0, np.radians(half_angle_deg), 2 + int(radius_m * np.radians(half_angle_deg) / EDGE_M))
    arc = np.stack([np.sin(angle), np.cos(angle)], axis=1)
    return revolved(np.concatenate([radius_m * arc, ((radius_m + thick_m) * arc)[::-1]]) - [0, radius_m])


def cylinder(radius_m: float, length_m: float) -> Mesh:
    """A cylinder along y about the origin."""
    across = np.linspace(0, radius_m, 2 + int(radius_m / EDGE_M))
    along = np.linspace(-length_m / 2, length_m / 2, 2 + int(length_m / EDGE_M))
    ends = [np.stack([across, np.full(len(across), along[i])], axis=1) for i in (0, -1)]
    side = np.stack([np.full(len(along), radius_m), along], axis=1)[1:-1]
    vertices_m, faces = revolved(np.concatenate([ends[0], side, ends[1][::-1]]))
    return vertices_m[:, [0, 2, 1]] * [1, 1, -1], faces


def ball(radius_m: float) -> Mesh:
    """A sphere about the origin."""
    angle = np.linspace(0, np.pi, 2 + int(np.pi * radius_m / EDGE_M))
    return revolved(radius_m * np.stack([np.sin(angle), np.cos(angle)], axis=1))


def revolved(profile_m: np.ndarray) -> Mesh:
    """The closed surface of a profile [n, 2] (distance from the axis, z) that turns about z; it begins and ends on the
    axis."""
    count = int(np.clip(2 * np.pi * profile_m[:, 0].max() / EDGE_M, 16, 400))
    turn = np.linspace(0, 2 * np.pi, count, endpoint=False)
    inner = profile_m[1:-1]
    rings = np.stack(
        [np.outer(inner[:, 0], np.cos(turn)), np.outer(inner[:, 0], np.sin(turn)), np.repeat(inner[:, 1:], count, 1)],
        -1,
    )
    vertices_m = np.concatenate([[[0, 0, profile_m[0, 1]]], rings.reshape(-1, 3), [[0, 0, profile_m[-1, 1]]]])
    index, last = 1 + np.arange(len(inner) * count).reshape(-1, count), len(vertices_m) - 1
    a, b = index, np.roll(index, -1, axis=1)
    p, q, r, s = (part.ravel() for part in (a[:-1], b[:-1], b[1:], a[1:]))
    caps = [np.stack([np.full(count, 0), b[0], a[0]], 1), np.stack([np.full(count, last), a[-1], b[-1]], 1)]
    faces = np.concatenate([*caps, np.stack([p, q, r], 1), np.stack([p, r, s], 1)])
    volume_m3 = (face_vectors(vertices_m, faces) * vertices_m[faces].mean(axis=1)).sum()
    return vertices_m, faces if volume_m3 > 0 else faces[:, ::-1]


def joined(parts: list[Mesh]) -> Mesh:
    """All meshes as one."""
    starts = np.cumsum([0, *(len(vertices_m) for vertices_m, _ in parts[:-1])])
    faces = [faces + start for (_, faces), start in zip(parts, starts, strict=True)]
    return np.concatenate([vertices_m for vertices_m, _ in parts]), np.concatenate(faces)

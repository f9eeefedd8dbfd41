"""Random placements of the calibration target with errors of manufacture, and the point cloud that
eight cameras would reconstruct of it, with realistic errors."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from handbench.bench.scenes.build import Scene, build
from handbench.bench.scenes.scene_file import SceneFile
from handbench.bench.scenes.stand import rig
from handbench.calibration.spheres.description import Element, Target, default_target, save_target
from handbench.support.config import parse

TURN_DEG = 30.0  # of the target, about each axis, at most
PHASE_NOISE_RAD = 0.0281  # of the paper's table
MADE = "made.toml"  # the target as manufactured, next to the scene


@dataclass(frozen=True)
class Placement:
    """The calibration target in one random position.

    number: identifies the placement, and is the seed of its random numbers. scene: the true scene,
    with the target as manufactured. described: the ideal target, without errors of manufacture.
    """

    number: int
    scene: Scene
    described: Target


def placement(number: int, folder: Path, **more: Any) -> Placement:
    """Draw the placement `number` of the calibration target: 0.26 to 0.32 m from the radar, up to
    20 mm sideways, turned by up to 30° about each axis.

    The pose of the stand's board, the antennas' polarisation and the target's errors of manufacture
    are drawn too; the manufactured target is written to made.toml in `folder`. more: further tables
    of the scene file.
    """
    rng = np.random.default_rng([number, 6])
    described = default_target()
    folder.mkdir(parents=True, exist_ok=True)
    save_target(folder / MADE, manufactured_target(described, rng))
    values = {
        "version": 1,
        "name": f"target-{number}",
        "seed": number,
        "target": {
            "kind": "calibration_target",
            "file": MADE,
            "distance_m": rng.uniform(0.26, 0.32),
            "offset_m": rng.uniform(-0.02, 0.02, 2).tolist(),
            "rotation_deg": rng.uniform(-TURN_DEG, TURN_DEG, 3).tolist(),
        },
        "sensor": {"polarisation_deg": rng.uniform(0, 180)},
        "noise": {"phase_noise_rad": PHASE_NOISE_RAD},
        "mount": {
            "offset_m": [*rng.uniform(-0.01, 0.01, 2).tolist(), 0.43],
            "rotation_deg": rng.uniform(-5, 5, 3).tolist(),
        },
        **more,
    }
    return Placement(
        number, build(parse(SceneFile, values, f"placement {number}"), folder), described
    )


def placements(number: int, count: int, folder: Path) -> list[Placement]:
    """Draw `count` random poses of one manufactured target. Target, stand and antennas are the same
    in all scenes; only the target's pose and the noise differ.

    number: of the first placement; the others have the following numbers. folder: receives the
    scenes' files.
    """
    first = placement(number, folder / str(number))
    found = [first]
    for other in range(number + 1, number + count):
        moved = placement(other, folder / str(other)).scene.file
        file = first.scene.file.model_copy(update={"seed": other, "target": moved.target})
        found.append(replace(first, number=other, scene=build(file, folder / str(number))))
    return found


def manufactured_target(target: Target, rng: np.random.Generator) -> Target:
    """Return the target with random errors of manufacture, drawn from the tolerances in its
    description: the foam's permittivity, the radii of the spheres, and the positions of the balls
    in them."""
    return target.model_copy(
        update={
            "foam_permittivity": max(
                1.0, target.foam_permittivity + target.foam_permittivity_sigma * rng.normal()
            ),
            "element": tuple(_made(element, target, rng) for element in target.element),
        }
    )


def _made(element: Element, target: Target, rng: np.random.Generator) -> Element:
    offset_m = np.array(element.ball_offset_m) + target.ball_offset_sigma_m * rng.normal(size=3)
    return element.model_copy(
        update={
            "sphere_radius_m": element.sphere_radius_m
            + target.sphere_radius_sigma_m * rng.normal(),
            "ball_offset_m": tuple(offset_m.tolist()),
        }
    )


DENSITY_M2 = 2e6  # points on a square metre of foam: 2 per mm²
# of each point, and common to patches; measured on hands
NOISE_M, PATCH_NOISE_M, PATCH_M = (3e-5, 1.5e-5, 3e-3)
NORMAL_NOISE = 0.07  # per axis: 4°
STEEPEST = 0.35  # cosine at which a camera sees too little of a surface
CAMERAS = 8


def optical_cloud(
    placed: Placement, seen: Sequence[int] | None = None
) -> tuple[np.ndarray, np.ndarray]:
    """Simulate the point cloud that eight cameras would reconstruct of a placement.

    It has points of the back plate, and those points of the spheres that at least two cameras see.
    seen: indices of the spheres in view (None: all). Returns points [n, 3] in the photo frame,
    metres, and outward normals [n, 3], both with errors.
    """
    scene, target = placed.scene, placed.scene.target
    assert target is not None  # a placement has one
    rng = np.random.default_rng([placed.number, 8])
    aim_m = np.array([0.0, 0.0, scene.file.target.distance_m])
    cameras = rig(CAMERAS, 2400, 1600, aim_m, scene.radar_from_photo, scene.file.seed)
    photo_from_radar = scene.radar_from_photo.inverse()
    shown = list(range(len(target.element)) if seen is None else seen)
    centres_m = photo_from_radar.points(scene.radar_from_target.points(target.centres_m))[shown]
    radii_m = np.array([target.element[i].sphere_radius_m for i in shown])
    eyes_m = np.array([camera.centre_m for camera in cameras])
    points, normals = [], []
    for centre_m, radius_m in zip(centres_m, radii_m, strict=True):
        outward = rng.standard_normal((int(4 * np.pi * radius_m**2 * DENSITY_M2), 3))
        outward /= np.linalg.norm(outward, axis=1, keepdims=True)
        on_it = centre_m + radius_m * outward
        views = sum(_sees(eye_m, on_it, outward, centres_m, radii_m) for eye_m in eyes_m)
        outward, on_it = outward[views >= 2], on_it[views >= 2]
        cells = np.unique(np.floor(on_it / PATCH_M), axis=0, return_inverse=True)[
            1
        ].ravel()  # errors of neighbours are correlated
        error_m = (
            NOISE_M * rng.standard_normal(len(on_it))
            + PATCH_NOISE_M * rng.standard_normal(cells.max(initial=0) + 1)[cells]
        )
        points.append(on_it + error_m[:, None] * outward)
        normals.append(outward)
    plate_m = rng.uniform((-0.2, -0.15, 0), (0.2, 0.15, 0), (100_000, 3))
    plate_m += (0, 0, NOISE_M) * rng.standard_normal(plate_m.shape)
    p, n = (
        np.concatenate([*points, plate_m]),
        np.concatenate([*normals, np.tile([0.0, 0, 1], (len(plate_m), 1))]),
    )
    return p, n + NORMAL_NOISE * rng.standard_normal(n.shape)


def _sees(
    eye_m: np.ndarray,
    points_m: np.ndarray,
    outward: np.ndarray,
    centres_m: np.ndarray,
    radii_m: np.ndarray,
) -> np.ndarray:
    """Return the mask [n] of the points [n, 3] of a sphere that a camera at eye_m [3] sees.

    outward [n, 3]: unit normals at the points; too oblique ones are not seen. centres_m [k, 3],
    radii_m [k]: all spheres, which may hide the points.
    """
    ray = points_m - eye_m
    length = np.linalg.norm(ray, axis=1, keepdims=True)
    ray /= length
    free = np.einsum("nk,nk->n", -ray, outward) > STEEPEST
    for centre_m, radius_m in zip(centres_m, radii_m, strict=True):
        along = (centre_m - eye_m) @ ray.T
        beside_m = np.linalg.norm(eye_m + along[:, None] * ray - centre_m, axis=1)
        free &= ~((beside_m < radius_m) & (along < length[:, 0] - 2 * radius_m))
    return free

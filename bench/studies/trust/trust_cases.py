"""Scenes with a known true surface, for the study of p_gross (the predicted probability that a
depth is grossly wrong).

There are four families: random points on a surface in front of an array of 24 + 24 antennas, with
difficulties such as clutter; hands of many people with all simulated effects; assorted scenes with
imperfect antennas; and given captures with a true surface.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
from scipy.ndimage import distance_transform_edt

from handbench.bench.datasets.native import NativeCapture
from handbench.bench.scenes.build import Scene, build
from handbench.bench.scenes.echoes import echo_scene, echoes
from handbench.bench.scenes.hand_pose import POSES
from handbench.bench.scenes.people import MOST_PEOPLE
from handbench.bench.scenes.scene_file import SceneFile
from handbench.bench.studies.trust.assorted_scenes import BEHIND_M, SKIN, assorted_scene
from handbench.groundtruth.mesh.depth import depth_on_grid
from handbench.groundtruth.mesh.mesh_files import mesh, read_mesh
from handbench.radar.data.arrays import AntennaArray, qar50
from handbench.radar.data.capture import RadarCapture
from handbench.radar.data.depthmap import DepthMap
from handbench.radar.methods.fsk_config import JointConfig, LadderConfig
from handbench.radar.simulation.forward import Scatterers, simulate
from handbench.support.config import parse
from handbench.support.errors import HandbenchError
from handbench.support.rays import TriangleMesh

SWEPT = 32  # tones of the volumes: the paper's band, repeated in depth after 0.47 m
TONES_HZ = np.unique(
    [*np.linspace(72e9, 82e9, SWEPT), *LadderConfig().tones_hz, *JointConfig().tones_hz]
)
LETTERS = "ACEGILNPRTW"  # that calibrate
POINTS, HALF_M = 300, 0.024
AXIS = {"start_m": -0.02, "stop_m": 0.02, "step_m": 0.00125}  # the filters' 5 pixels are a cell
WIDE_AXIS = {"start_m": -0.15, "stop_m": 0.15, "step_m": 0.001}
WITHIN_M = np.linspace(-2.5e-3, 2.5e-3, 5)  # the paper's lateral resolution: 5 mm
POINTS_NOISE_DB = (-60.0, 0.0)  # of a channel's echo: the image gains 28 dB
HANDS_NOISE_RAD = (0.003, 0.3)
# a depth that far beside the surface is held to the nearest part of it; further away it is wrong
BESIDE_M = 5e-3
FINE = 2  # reference depths a pixel, along x and y
ARRAY = AntennaArray(qar50().tx_m[::4], qar50().rx_m[::4])
Off = Callable[[DepthMap], tuple[np.ndarray, np.ndarray]]
Surface = Callable[[np.ndarray, np.ndarray], np.ndarray]


def tilted(rng: np.random.Generator) -> Surface:
    """Draw a plane that is inclined by up to 40° along x and along y. Returns its z as a function
    of x and y, metres."""
    slope = np.tan(np.deg2rad(rng.uniform(-40, 40, 2)))
    return lambda x, y: slope[0] * x + slope[1] * y


def bumpy(rng: np.random.Generator) -> Surface:
    """Draw a wavy surface with waves 1 to 6 mm high and 10 to 40 mm long. Returns its z as a
    function of x and y, metres."""
    height_m, length_m = rng.uniform(1e-3, 6e-3), rng.uniform(0.01, 0.04)
    first, second = rng.uniform(0, 2 * np.pi, 2)
    turns = 2 * np.pi / length_m
    return lambda x, y: height_m * np.sin(turns * x + first) * np.sin(turns * y + second)


def step(rng: np.random.Generator) -> Surface:
    """Draw a step, 2 to 50 mm deep, with its edge along y. Returns its z as a function of x and y,
    metres. Steps above 30 mm exceed the unambiguous range of three tones."""
    height_m, place_m = rng.uniform(2e-3, 0.05), rng.uniform(-0.01, 0.01)
    return lambda x, y: np.where(x > place_m, height_m, 0.0)


def fingers(rng: np.random.Generator) -> Surface:
    """Draw cylinders, 8 to 16 mm thick, side by side in front of a palm that is a plane at z = 5 to
    25 mm. Returns the z of this surface as a function of x and y, metres."""
    width_m, depth_m = rng.uniform(0.008, 0.016), rng.uniform(0.005, 0.025)

    def z_m(x: np.ndarray, y: np.ndarray) -> np.ndarray:
        beside = np.mod(x, 1.3 * width_m) - 0.65 * width_m
        inside = np.maximum((width_m / 2) ** 2 - beside**2, 0)
        return np.where(inside > 0, depth_m - np.sqrt(inside) - width_m / 2, depth_m)

    return z_m


KINDS = {kind.__name__: kind for kind in (tilted, bumpy, step, fingers)}
TROUBLES = ("none", "glint", "clutter", "dead", "clipped")
CALIBRATING = {"points": ("tilted", "step"), "hands": LETTERS}


@dataclass(frozen=True)
class TrustCase:
    """A scene with a known true surface.

    family: "points", "hands", "assorted" or "captures". kind: the surface, letter or folder within
    the family. Family, kind and number determine everything else.
    """

    family: str
    kind: str
    number: int

    def __str__(self) -> str:
        return f"{self.family} {self.kind} {self.number}"

    @property
    def group(self) -> str:
        """The group of scenes in tables: "calibration" if weights are fitted to this scene; "other
        surfaces" for the remaining scenes of points; otherwise the family."""
        if self.kind.split(", ")[-1] in CALIBRATING.get(self.family, ()):
            return "calibration"
        return "other surfaces" if self.family == "points" else self.family


@dataclass(frozen=True)
class Known:
    """Echoes of a scene, how it is imaged, and the distance of depths from its true surface.

    axis: x and y of the image (None: all settings are the method's defaults). first_depth_m:
    initial depth of FSK methods. middle_m: middle of imaged volumes. off_m: function of a depth map
    that returns two arrays [ny, nx] of distances along z in metres: to the nearest true depth
    within the pixel's resolution cell, and to the true depth at the pixel itself.
    """

    capture: RadarCapture
    axis: dict[str, float] | None
    first_depth_m: float
    middle_m: float
    off_m: Off

    def values(self, method: str) -> dict[str, Any]:
        """Return the settings with which a method (its id) images the scene; empty for the method's
        defaults."""
        if self.axis is None:
            return {}
        tolerance = None if self.axis is AXIS else 1e-3
        known: dict[str, Any] = {"x": self.axis, "y": self.axis, "tolerance": tolerance}
        if "band" in method:
            ends_m = (round(self.middle_m + off_m, 4) for off_m in (-0.04, 0.04))
            known["z"] = dict(zip(("start_m", "stop_m"), ends_m, strict=True)) | {"step_m": 0.002}
            return known | ({"count": SWEPT} if "broad" in method else {})
        tones: dict[str, dict[str, Any]] = {  # of all captures
            "joint": {"tones_hz": LadderConfig().tones_hz}
        }
        return known | {"first_depth_m": self.first_depth_m} | tones.get(method, {})


def cases(points: int, hands: int, assorted: int, captures: list[Path]) -> list[TrustCase]:
    """List the scenes of the study. points, hands, assorted: number of scenes of each of these
    families. captures: folders with echoes and a true surface, one scene each."""
    drawn = (
        ("points", points, [", ".join(kind) for kind in product(TROUBLES, KINDS)]),
        ("hands", hands, list(POSES)),
        ("assorted", assorted, ["all"]),
        ("captures", len(captures), list(map(str, captures))),
    )
    return [TrustCase(name, of[n % len(of)], n) for name, count, of in drawn for n in range(count)]


def known(case: TrustCase, seed: int, work: Path) -> Known:
    """Simulate the scene of a case, or open its capture. Returns its echoes with the true surface.

    seed: of the whole study. work: folder for the meshes of assorted scenes. Raises HandbenchError
    for a capture without a true surface.
    """
    rng = np.random.default_rng([seed, case.number, len(case.family)])
    if case.family == "points":
        return _points(case.kind, rng)
    if case.family == "hands":
        return _built(_hand(case.kind, rng), rng)
    if case.family == "assorted":
        work.mkdir(parents=True, exist_ok=True)
        return _built(assorted_scene(case.number + seed, work), rng)
    capture = NativeCapture(Path(case.kind))
    if capture.truth is None:
        raise HandbenchError(f"{capture.folder}: has no truth.ply; expected a simulated capture")
    return Known(capture.echoes(1), None, 0.0, 0.0, off_mesh(read_mesh(capture.truth)))


def _points(trouble_kind: str, rng: np.random.Generator) -> Known:
    trouble, kind = trouble_kind.split(", ")
    surface, middle_m = KINDS[kind](rng), float(rng.uniform(0.25, 0.35))
    capture, clutter_m = recorded(surface, middle_m, trouble, rng)

    def off_m(depth: DepthMap) -> tuple[np.ndarray, np.ndarray]:
        y = depth.y_m[:, None] + WITHIN_M[:, None, None, None]
        x = depth.x_m + WITHIN_M[:, None, None]
        cells_m = np.abs(depth.z_m - middle_m - surface(*np.broadcast_arrays(x, y)))
        nearest_m = cells_m.min(axis=(0, 1))
        for x_m, y_m, z_m in clutter_m:
            near = np.hypot(depth.x_m - x_m, depth.y_m[:, None] - y_m) <= BESIDE_M
            nearest_m = np.where(near, np.fmin(nearest_m, np.abs(depth.z_m - z_m)), nearest_m)
        return nearest_m, cells_m[len(WITHIN_M) // 2, len(WITHIN_M) // 2]

    first_m, volume_m = middle_m + rng.uniform([-0.1, -0.015], [0.1, 0.015])
    return Known(capture, AXIS, float(first_m), float(volume_m), off_m)


def recorded(
    surface: Surface, middle_m: float, trouble: str, rng: np.random.Generator
) -> tuple[RadarCapture, np.ndarray]:
    """Simulate the echoes of random points on a surface, with noise and one difficulty. Returns the
    capture, and the positions [n, 3] of clutter, metres.

    surface: its z as a function of x and y, relative to middle_m. trouble: the difficulty, "none",
    "glint", "clutter", "dead" (antennas) or "clipped" (samples).
    """
    xy = rng.uniform(-HALF_M, HALF_M, (POINTS, 2))
    points_m = np.column_stack([xy, middle_m + surface(*xy.T)])
    weight = rng.standard_normal(POINTS)
    if trouble == "glint":
        weight[0] = 10 ** rng.uniform(1, 2)
    if trouble == "clutter":
        points_m = np.vstack([points_m, rng.uniform((-0.1, -0.1, 0.2), (0.1, 0.1, 0.5), (5, 3))])
        weight = np.append(weight, 10 * rng.standard_normal(5))
    scatterers = Scatterers(points_m, weight)
    samples = simulate(scatterers, TONES_HZ, ARRAY, spreading=False, tolerance=None)
    level = np.sqrt(np.mean(np.abs(samples) ** 2)) * 10 ** (rng.uniform(*POINTS_NOISE_DB) / 20)
    noise = rng.standard_normal((2, *samples.shape)) * level / np.sqrt(2)
    samples = samples + noise[0] + 1j * noise[1]
    if trouble == "dead":
        samples[:, rng.integers(0, len(ARRAY.tx_m), 4)] = 0
    if trouble == "clipped":
        most = np.abs(samples).max() * rng.uniform(0.2, 0.8)
        samples = np.clip(samples.view(float), -most, most).view(complex)
    return RadarCapture(samples[None].astype(np.complex64), TONES_HZ, ARRAY), points_m[POINTS:]


def _hand(letter: str, rng: np.random.Generator) -> Scene:
    """Draw the scene of a random person's hand in front of the whole array, in the pose of a
    letter. A part of the array would have grating lobes, which copy strong reflections to other
    places in the image."""
    distance_m, person = float(rng.uniform(0.25, 0.4)), int(rng.integers(MOST_PEOPLE))
    target = {"kind": "hand", "pose": letter, "material": SKIN, "edge_m": 3e-3, "person": person}
    target |= {"distance_m": distance_m, "rotation_deg": rng.uniform(-20, 20, 3).tolist()}
    noise_rad = float(np.exp(rng.uniform(*np.log(HANDS_NOISE_RAD))))
    values = {
        "version": 1,
        "name": letter,
        "seed": int(rng.integers(1 << 30)),
        "target": target,
        "sensor": {"sweep": [], "tones_hz": TONES_HZ.tolist()},
        "noise": {"phase_noise_rad": noise_rad},
        "mount": {"offset_m": [0.0, 0.0, distance_m + BEHIND_M]},
    }
    return build(parse(SceneFile, values, letter), Path())


def _built(scene: Scene, rng: np.random.Generator) -> Known:
    vertices_m, target = np.asarray(scene.target_mesh.vertices), scene.target_mesh
    surface = mesh(vertices_m, np.asarray(target.triangles))
    for body in echo_scene(scene).room:  # the stand, where the radar sees it
        surface += mesh(body.vertices_m, body.faces)
    first_m = scene.file.target.distance_m + float(rng.uniform(-0.05, 0.05))
    middle_m = float(vertices_m[:, 2].min()) + 0.03
    return Known(echoes(scene).capture, WIDE_AXIS, first_m, middle_m, off_mesh(surface))


def off_mesh(surface: TriangleMesh) -> Off:
    """Return a function of a depth map that computes the distances along z to the true surface,
    given as a mesh in the radar frame.

    The function returns two arrays [ny, nx] in metres: to the nearest true depth within the pixel's
    resolution cell, and to the true depth at the pixel. Up to 5 mm (BESIDE_M) beside the surface,
    the depth of its nearest part counts as the true one; farther away, distances are infinite.
    """

    def off_m(depth: DepthMap) -> tuple[np.ndarray, np.ndarray]:
        step_m = float(depth.x_m[1] - depth.x_m[0]) / FINE
        around = int(np.ceil(WITHIN_M[-1] / step_m))
        x_m, y_m = (
            axis[0] + step_m * np.arange(-around, FINE * (len(axis) - 1) + around + 1)
            for axis in (depth.x_m, depth.y_m)
        )
        z_m = depth_on_grid(surface, x_m, y_m)
        away, place = distance_transform_edt(np.isnan(z_m), return_indices=True)
        z_m = np.where(away * step_m <= BESIDE_M, z_m[tuple(place)], np.inf)
        nearest_m, (ny, nx) = np.full(depth.z_m.shape, np.inf), depth.z_m.shape
        for i, j in product(range(2 * around + 1), repeat=2):
            cell_m = z_m[i : i + FINE * ny - 1 : FINE, j : j + FINE * nx - 1 : FINE]
            nearest_m = np.fmin(nearest_m, np.abs(depth.z_m - cell_m))
        return nearest_m, np.abs(depth.z_m - z_m[around:-around:FINE, around:-around:FINE])

    return off_m

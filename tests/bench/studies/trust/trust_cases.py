"""Scenes whose true surface is known, of several families: points on surfaces; hands of many people
with every effect of the simulation; assorted scenes with imperfect antennas; and captures with a
truth."""

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
from handbench.groundtruth.mesh.depth import depth_on_grid
from handbench.groundtruth.mesh.mesh_files import mesh, read_mesh
from handbench.radar.data.capture import RadarCapture
from handbench.radar.data.depthmap import DepthMap
from handbench.radar.methods.fsk_config import JointConfig, LadderConfig
from handbench.support.config import parse
from handbench.support.errors import HandbenchError
from handbench.support.rays import TriangleMesh
from tests.bench.studies.ablation.assorted_scenes import BEHIND_M, SKIN, assorted_scene
from tests.bench.studies.stability.random_scenes import AXIS, KINDS, TROUBLES, WITHIN_M, recorded

SWEPT = (
    32  # tones of the volumes: as wide a band as the paper's 128, repeated in depth after 0.47 m
)
TONES_HZ = np.unique(
    [*np.linspace(72e9, 82e9, SWEPT), *LadderConfig().tones_hz, *JointConfig().tones_hz]
)
SURFACES, LETTERS = ("tilted", "step"), "ACEGILNPRTW"  # that calibrate
WIDE_AXIS = {"start_m": -0.15, "stop_m": 0.15, "step_m": 0.001}
NOISE_RAD = (0.003, 0.3)  # of hands
# a depth that far beside the surface is held to the nearest part of it; further away it is wrong
BESIDE_M = 5e-3
FINE = 2  # reference depths a pixel, along x and y
Off = Callable[[DepthMap], tuple[np.ndarray, np.ndarray]]


@dataclass(frozen=True)
class Case:
    """A scene: family, kind and number, of which all else follows."""

    family: str
    kind: str
    number: int

    def __str__(self) -> str:
        return f"{self.family} {self.kind} {self.number}"

    @property
    def group(self) -> str:
        """The scenes that calibrate, those of other surfaces, or the family."""
        others = {"points": (SURFACES, "other surfaces"), "hands": (LETTERS, "hands")}
        known, other = others.get(self.family, ((), self.family))
        return "calibration" if self.kind.split(", ")[-1] in known else other


@dataclass(frozen=True)
class Known:
    """Echoes, the pixels' axis (None: every setting is the method's default), the depth that FSK
    begins at and the middle of volumes; off_m: how far a map's depths are from the nearest true one
    in the resolution cell, and from the pixel's own, [ny, nx] each."""

    capture: RadarCapture
    axis: dict[str, float] | None
    first_depth_m: float
    middle_m: float
    off_m: Off

    def values(self, method: str) -> dict[str, Any]:
        """A method's settings."""
        if self.axis is None:
            return {}
        known: dict[str, Any] = {
            "x": self.axis,
            "y": self.axis,
            "tolerance": None if self.axis is AXIS else 1e-3,
        }
        if "band" in method:
            z = {
                "start_m": round(self.middle_m - 0.04, 4),
                "stop_m": round(self.middle_m + 0.04, 4),
                "step_m": 0.002,
            }
            return known | {"z": z} | ({"count": SWEPT} if "broad" in method else {})
        tones: dict[str, dict[str, Any]] = {
            "joint": {"tones_hz": LadderConfig().tones_hz},
            "prior-2fsk": {"far_hz": 79.5e9},
        }  # of all captures
        return known | {"first_depth_m": self.first_depth_m} | tones.get(method, {})


def cases(points: int, hands: int, assorted: int, captures: list[Path]) -> list[Case]:
    """So many scenes of each family, and folders of captures whose true surface lies beside the
    echoes."""
    kinds = [", ".join(kind) for kind in product(TROUBLES, KINDS)]
    drawn = {
        "points": (points, kinds),
        "hands": (hands, list(POSES)),
        "assorted": (assorted, ["all"]),
    }
    found = [
        Case(name, of[n % len(of)], n) for name, (count, of) in drawn.items() for n in range(count)
    ]
    return found + [Case("captures", str(folder), n) for n, folder in enumerate(captures)]


def known(case: Case, seed: int, work: Path) -> Known:
    """The scene of a case; work: where assorted scenes keep meshes."""
    rng = np.random.default_rng([seed, case.number, len(case.family)])
    if case.family == "points":
        return _points(case.kind, rng)
    if case.family == "captures":
        capture = NativeCapture(Path(case.kind))
        if capture.truth is None:
            raise HandbenchError(
                f"{capture.folder}: has no truth.ply; expected a simulated capture"
            )
        return Known(capture.echoes(1), None, 0.0, 0.0, off_mesh(read_mesh(capture.truth)))
    work.mkdir(parents=True, exist_ok=True)
    return _built(
        _hand(case.kind, rng)
        if case.family == "hands"
        else assorted_scene(case.number + seed, work),
        rng,
    )


def _points(trouble_kind: str, rng: np.random.Generator) -> Known:
    trouble, kind = trouble_kind.split(", ")
    surface, middle_m = KINDS[kind](rng), float(rng.uniform(0.25, 0.35))
    capture, clutter_m = recorded(surface, middle_m, trouble, rng, TONES_HZ)

    def off_m(depth: DepthMap) -> tuple[np.ndarray, np.ndarray]:
        y, x = (
            depth.y_m[:, None] + WITHIN_M[:, None, None, None],
            depth.x_m + WITHIN_M[:, None, None],
        )
        cells_m = np.abs(depth.z_m - middle_m - surface(*np.broadcast_arrays(x, y)))
        nearest_m = cells_m.min(axis=(0, 1))
        for x_m, y_m, z_m in clutter_m:
            near = np.hypot(depth.x_m - x_m, depth.y_m[:, None] - y_m) <= BESIDE_M
            nearest_m = np.where(near, np.fmin(nearest_m, np.abs(depth.z_m - z_m)), nearest_m)
        return nearest_m, cells_m[len(WITHIN_M) // 2, len(WITHIN_M) // 2]

    first_m, volume_m = middle_m + rng.uniform([-0.1, -0.015], [0.1, 0.015])
    return Known(capture, AXIS, float(first_m), float(volume_m), off_m)


def _hand(letter: str, rng: np.random.Generator) -> Scene:
    """The hand of one of many people before the whole array: a part of it would have grating lobes,
    copies of what glints elsewhere in the image."""
    distance_m, person = float(rng.uniform(0.25, 0.4)), int(rng.integers(MOST_PEOPLE))
    target = {"kind": "hand", "pose": letter, "material": SKIN, "edge_m": 3e-3, "person": person}
    target |= {"distance_m": distance_m, "rotation_deg": rng.uniform(-20, 20, 3).tolist()}
    sensor = {"sweep": [], "tones_hz": TONES_HZ.tolist()}
    noise_rad, mount_m = (
        float(np.exp(rng.uniform(*np.log(NOISE_RAD)))),
        [0.0, 0.0, distance_m + BEHIND_M],
    )
    values = {
        "version": 1,
        "name": letter,
        "seed": int(rng.integers(1 << 30)),
        "target": target,
        "sensor": sensor,
    }
    around = {"noise": {"phase_noise_rad": noise_rad}, "mount": {"offset_m": mount_m}}
    return build(parse(SceneFile, values | around, letter), Path())


def _built(scene: Scene, rng: np.random.Generator) -> Known:
    vertices_m, target = np.asarray(scene.target_mesh.vertices), scene.target_mesh
    surface = mesh(vertices_m, np.asarray(target.triangles))
    for body in echo_scene(scene).room:  # the stand, where the radar sees it
        surface += mesh(body.vertices_m, body.faces)
    first_m = scene.file.target.distance_m + float(rng.uniform(-0.05, 0.05))
    return Known(
        echoes(scene).capture,
        WIDE_AXIS,
        first_m,
        float(vertices_m[:, 2].min()) + 0.03,
        off_mesh(surface),
    )


def off_mesh(surface: TriangleMesh) -> Off:
    """`Known.off_m` of a mesh; beside it that of its nearest part, infinite further away than
    BESIDE_M."""

    def off_m(depth: DepthMap) -> tuple[np.ndarray, np.ndarray]:
        step_m = float(depth.x_m[1] - depth.x_m[0]) / FINE
        around = int(np.ceil(WITHIN_M[-1] / step_m))
        ends = [(axis[0], FINE * (len(axis) - 1) + around + 1) for axis in (depth.x_m, depth.y_m)]
        z_m = depth_on_grid(
            surface, *(first_m + step_m * np.arange(-around, end) for first_m, end in ends)
        )
        away, place = distance_transform_edt(np.isnan(z_m), return_indices=True)
        z_m = np.where(away * step_m <= BESIDE_M, z_m[tuple(place)], np.inf)
        nearest_m, (ny, nx) = np.full(depth.z_m.shape, np.inf), depth.z_m.shape
        for i, j in product(range(2 * around + 1), repeat=2):
            cell_m = z_m[i : i + FINE * ny - 1 : FINE, j : j + FINE * nx - 1 : FINE]
            nearest_m = np.fmin(nearest_m, np.abs(depth.z_m - cell_m))
        return nearest_m, np.abs(depth.z_m - z_m[around:-around:FINE, around:-around:FINE])

    return off_m

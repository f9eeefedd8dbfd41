"""Scenes whose true surface is known, of several families: points on surfaces, rough and smooth, for calibration and of
kinds that it leaves out; smooth meshed hands; scenes with every effect of the simulation and imperfect antennas; and
captures whose truth is known."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from itertools import product
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from scipy.ndimage import distance_transform_edt

from bench.datasets.native import NativeCapture
from bench.scenes.echoes import echo_scene, echoes
from bench.scenes.hand import hand_mesh
from bench.scenes.hand_pose import POSES
from bench.studies.ablation.assorted_scenes import assorted_scene
from bench.studies.smoothness import HAND_M, visible_facets
from bench.studies.stability.random_scenes import (
    AXIS,
    HALF_M,
    KINDS,
    POINTS,
    TROUBLES,
    WITHIN_M,
    Surface,
    recorded,
    scattered,
)
from bench.studies.stability.scenes import small_array
from groundtruth.mesh.depth import depth_on_grid
from groundtruth.mesh.mesh_files import mesh, read_mesh
from radar.data.capture import RadarCapture
from radar.data.depthmap import DepthMap
from radar.methods.fsk_config import LadderConfig
from radar.simulation.forward import Scatterers, simulate
from radar.support.errors import HandbenchError

if TYPE_CHECKING:
    import open3d as o3d

LADDER_HZ = LadderConfig().tones_hz
SWEPT = 32  # tones of the volumes: as wide a band as the paper's 128, repeated in depth after 0.47 m
TONES_HZ = np.unique(np.concatenate([np.linspace(72e9, 82e9, SWEPT), LADDER_HZ]))
CALIBRATED = ("tilted", "step", "patches")  # surfaces
PITCH_M = 1e-3  # of smooth surfaces' points: a quarter of the wavelength
BLOCK = 50  # scenes of points: one of each kind
HAND_AXIS = {"start_m": -0.1, "stop_m": 0.1, "step_m": 0.001}
ASSORTED_AXIS = {"start_m": -0.15, "stop_m": 0.15, "step_m": 0.001}
HAND_EDGE_M = 3e-3
HAND_NOISE_DB = (-50.0, -10.0)  # of a channel's echo: 47 × 47 channels gain 33 dB
BESIDE_M = 5e-3  # a depth that far beside the surface is held to the nearest part of it; further away it is wrong
FINE = 2  # reference depths a pixel, along x and y


@dataclass(frozen=True)
class Case:
    """A scene: family, kind and number, of which all else follows; what a record of it is called."""

    family: str
    kind: str
    number: int

    def __str__(self) -> str:
        return f"{self.family} {self.kind} {self.number}"


@dataclass(frozen=True)
class Known:
    """Echoes, what methods are configured with, and how far a map's depths [ny, nx] are from the nearest depth of the
    true surface, metres."""

    capture: RadarCapture
    axis: dict[str, float] | None  # None: every setting is the method's default
    first_depth_m: float
    middle_m: float
    off_m: Callable[[DepthMap], np.ndarray]
    tolerance: float | None = 1e-3

    def values(self, method: str, middle_m: float) -> dict[str, Any]:
        """A method's settings; middle_m: of the volume's depths."""
        if self.axis is None:
            return {}
        known = {"x": self.axis, "y": self.axis, "tolerance": self.tolerance}
        if "band" not in method:
            return known | {"first_depth_m": self.first_depth_m}
        z = {"start_m": round(middle_m - 0.04, 4), "stop_m": round(middle_m + 0.04, 4), "step_m": 0.002}
        return known | {"z": z} | ({"count": SWEPT} if "broad" in method else {})


def patches(rng: np.random.Generator) -> Surface:
    """Two curved patches side by side, up to 40 mm apart in depth, hollow or round."""
    curvature_per_m, place_m, height_m = rng.uniform(-20, 20, 2), rng.uniform(-0.01, 0.01), rng.uniform(0, 0.04)

    def z_m(x: np.ndarray, y: np.ndarray) -> np.ndarray:
        left, right = (curvature / 2 * (x**2 + y**2) for curvature in curvature_per_m)
        return np.where(x > place_m, height_m + right, left)

    return z_m


SURFACES = {"patches": patches} | KINDS
FINISHES = ("rough", "smooth")


def cases(points: int, hands: int, assorted: int, captures: list[Path]) -> list[Case]:
    """So many scenes of each family, and folders of captures whose true surface lies beside the echoes."""
    kinds = [", ".join(kind) for kind in product(FINISHES, TROUBLES, SURFACES)]
    found = [Case("points", kinds[n % BLOCK], n) for n in range(points)]
    found += [Case("hands", list(POSES)[n * 7 % len(POSES)], n) for n in range(hands)]
    found += [Case("assorted", "", n) for n in range(assorted)]
    return found + [Case("captures", str(folder), n) for n, folder in enumerate(captures)]


def known(case: Case, seed: int, work: Path) -> Known:
    """The scene of a case."""
    rng = np.random.default_rng([seed, case.number, len(case.family)])
    if case.family == "captures":
        return _captured(NativeCapture(Path(case.kind)))
    if case.family == "points":
        finish, trouble, kind = case.kind.split(", ")
        return _points(finish, trouble, kind, rng)
    return _hand(case.kind, rng) if case.family == "hands" else _assorted(case.number + seed, rng, work)


def _points(finish: str, trouble: str, kind: str, rng: np.random.Generator) -> Known:
    surface, middle_m = SURFACES[kind](rng), float(rng.uniform(0.25, 0.35))
    points = scattered(surface, middle_m, trouble, rng)
    clutter_m = points.position_m[POINTS:]
    if finish == "smooth":
        points = _even(points, lambda x, y: middle_m + surface(x, y))
    capture = recorded(points, trouble, rng, TONES_HZ)

    def off_m(depth: DepthMap) -> np.ndarray:
        y, x = (depth.y_m[:, None] + WITHIN_M[:, None, None, None], depth.x_m + WITHIN_M[:, None, None])
        off_m = np.abs(depth.z_m - middle_m - surface(*np.broadcast_arrays(x, y))).min(axis=(0, 1))
        for place_m in clutter_m:
            beside_m = np.hypot(depth.x_m - place_m[0], depth.y_m[:, None] - place_m[1])
            off_m = np.where(beside_m <= BESIDE_M, np.fmin(off_m, np.abs(depth.z_m - place_m[2])), off_m)
        return np.asarray(off_m)

    return Known(capture, AXIS, middle_m + float(rng.uniform(-0.1, 0.1)), middle_m, off_m, None)


def _even(points: Scatterers, z_m: Surface) -> Scatterers:
    """The surface's points even and alike, which makes it a mirror; with the first of the random ones, which may glint,
    and the clutter."""
    along_m = np.arange(-HALF_M, HALF_M, PITCH_M)
    x, y = (values.ravel() for values in np.meshgrid(along_m, along_m))
    kept = np.r_[0, POINTS : len(points.position_m)]
    places_m = np.vstack([points.position_m[kept], np.column_stack([x, y, z_m(x, y)])])
    return Scatterers(places_m, np.concatenate([points.weight[kept], np.ones(len(x))]))


def _hand(letter: str, rng: np.random.Generator) -> Known:
    surface = mesh(*_vertices_faces(_hand_mesh(letter)))
    surface.rotate(surface.get_rotation_matrix_from_xyz(np.radians(rng.uniform(-20, 20, 3))), np.zeros(3))
    facets = visible_facets(surface)
    samples = simulate(facets, TONES_HZ, small_array(2))
    level = np.sqrt(np.mean(np.abs(samples) ** 2)) * 10 ** (rng.uniform(*HAND_NOISE_DB) / 20)
    noise = rng.standard_normal((2, *samples.shape)) * level / np.sqrt(2)
    capture = RadarCapture((samples + noise[0] + 1j * noise[1])[None].astype(np.complex64), TONES_HZ, small_array(2))
    surface.translate(HAND_M)
    first_m = HAND_M[2] + float(rng.uniform(-0.1, 0.1))
    return Known(capture, HAND_AXIS, first_m, HAND_M[2] - 0.01, lambda depth: off_mesh_m(depth, surface))


@cache
def _hand_mesh(letter: str) -> o3d.geometry.TriangleMesh:
    return hand_mesh(POSES[letter], HAND_EDGE_M)


def _vertices_faces(surface: o3d.geometry.TriangleMesh) -> tuple[np.ndarray, np.ndarray]:
    return np.asarray(surface.vertices), np.asarray(surface.triangles)


def _assorted(seed: int, rng: np.random.Generator, work: Path) -> Known:
    work.mkdir(parents=True, exist_ok=True)
    scene = assorted_scene(seed, work)
    first_m = float(scene.file.target.distance_m + rng.uniform(-0.05, 0.05))
    nearest_m = float(np.asarray(scene.target_mesh.vertices)[:, 2].min())
    capture, surface = echoes(scene).capture, mesh(*_vertices_faces(scene.target_mesh))
    for body in echo_scene(scene).room:  # the stand, where the radar sees it
        surface += mesh(body.vertices_m, body.faces)
    return Known(capture, ASSORTED_AXIS, first_m, nearest_m + 0.025, lambda depth: off_mesh_m(depth, surface))


def _captured(capture: NativeCapture) -> Known:
    if capture.truth is None:
        raise HandbenchError(f"{capture.folder}: has no truth.ply; expected a simulated capture")
    surface = read_mesh(capture.truth)
    return Known(capture.echoes(1), None, 0.0, 0.0, lambda depth: off_mesh_m(depth, surface))


def off_mesh_m(depth: DepthMap, surface: o3d.geometry.TriangleMesh) -> np.ndarray:
    """|z − the nearest depth of a mesh within the pixel's resolution cell| [ny, nx]; beside the mesh that of its
    nearest part, infinite further away than BESIDE_M."""
    step_m = float(depth.x_m[1] - depth.x_m[0]) / FINE
    around = int(np.ceil(WITHIN_M[-1] / step_m))
    fine = [
        axis[0] + step_m * np.arange(-around, FINE * (len(axis) - 1) + around + 1) for axis in (depth.x_m, depth.y_m)
    ]
    z_m = depth_on_grid(surface, *fine)
    away, nearest = distance_transform_edt(np.isnan(z_m), return_indices=True)
    z_m = np.where(away * step_m <= BESIDE_M, z_m[tuple(nearest)], np.nan)
    offsets = range(0, 2 * around + 1)
    end_y, end_x = (FINE * (n - 1) + 1 for n in depth.z_m.shape)
    cells = (z_m[i : i + end_y : FINE, j : j + end_x : FINE] for i in offsets for j in offsets)
    off_m = np.full(depth.z_m.shape, np.inf)
    for cell_m in cells:
        off_m = np.fmin(off_m, np.abs(depth.z_m - cell_m))
    return off_m

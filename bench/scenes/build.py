"""Scenes with their true geometry, built from scene files."""

import operator
from dataclasses import dataclass
from functools import reduce
from pathlib import Path

import numpy as np

from handbench.bench.scenes.bones import forearm_direction
from handbench.bench.scenes.scene_file import (
    BUILT_IN_ARRAY,
    AnyTarget,
    CalibrationTarget,
    DihedralTarget,
    HandTarget,
    MeshTarget,
    PlateTarget,
    SceneFile,
    SphereTarget,
)
from handbench.bench.scenes.shapes import dihedral_mesh, plate_mesh, sphere_mesh
from handbench.bench.scenes.stand import rig
from handbench.calibration.target import Target, default_target, load_target
from handbench.calibration.transforms import Transform
from handbench.groundtruth.cameras import Camera
from handbench.groundtruth.mesh.surface import read_mesh
from handbench.radar.data.arrays import AntennaArray, load_positions, qar50
from handbench.support.config import load
from handbench.support.errors import HandbenchError
from handbench.support.files import inside
from handbench.support.rays import TriangleMesh

CROP_MARGIN_M = 0.004
BLOCK_GAP_M = 0.003  # the crop box ends this far above the block
FOREARM_IN_BLOCK_M = 0.012
# a forearm whose direction has less of the photo frame's y than this is held from the side
STANDS = -0.8


@dataclass(frozen=True)
class Scene:
    """A scene with its true geometry.

    target_mesh: the target's surface in the radar frame. target: description of the calibration
    target (None for other targets). cameras: empty if no photographs are taken. box_m [2, 3]: lower
    and upper corner, in the photo frame, of the box to which reconstructions are cropped; it
    contains the target without plate and block. block_m [2, 3]: corners of the block under a hand's
    forearm in the photo frame (None: no block; there is one only if the forearm points down).
    array: the radar's antennas.
    """

    file: SceneFile
    array: AntennaArray
    target_mesh: TriangleMesh  # radar frame
    radar_from_target: Transform
    radar_from_photo: Transform
    cameras: tuple[Camera, ...]
    box_m: np.ndarray
    block_m: np.ndarray | None = None
    target: Target | None = None

    @property
    def balls_m(self) -> np.ndarray:
        """Centres [n, 3] of the calibration target's steel balls in the radar frame, metres; empty
        for other targets."""
        if self.target is None:
            return np.empty((0, 3))
        return self.radar_from_target.points(self.target.centres_m + self.target.ball_offsets_m)


def load_scene(path: str | Path) -> Scene:
    """Read a scene file and build its scene. Other files that it refers to must be in the same
    folder."""
    return build(load(SceneFile, path, "a scene description"), Path(path).parent)


def build(file: SceneFile, folder: str | Path = ".") -> Scene:
    """Build the scene of a parsed scene file.

    folder: of the files that the scene file refers to. Raises HandbenchError if the target reaches
    behind the plane of the antennas, or too close to the back plate.
    """
    folder, target = Path(folder), None
    array = antenna_array(file.sensor.array, folder)  # before what takes time
    if isinstance(file.target, CalibrationTarget):
        described = file.target.file
        target = (
            load_target(inside(folder, described, "target.file")) if described else default_target()
        )
    surface = _surface(file.target, target, folder)
    radar_from_target = file.target.radar_from_target()
    surface.transform(radar_from_target.matrix)
    vertices_m = np.asarray(surface.vertices)
    nearest_m = float(vertices_m[:, 2].min())
    if nearest_m <= 0:
        raise HandbenchError(
            f"scene '{file.name}': the target extends {-1e3 * nearest_m:.0f} mm behind the plane "
            "of the array; enlarge target.distance_m"
        )
    radar_from_photo = file.mount.radar_from_photo()
    in_photo_m = radar_from_photo.inverse().points(vertices_m)
    lower_m, upper_m = in_photo_m.min(axis=0), in_photo_m.max(axis=0)
    box_m = np.stack([lower_m - CROP_MARGIN_M, upper_m + CROP_MARGIN_M])
    block_m = None
    if isinstance(file.target, HandTarget):
        down = (
            radar_from_photo.rotation[:, 1]
            @ radar_from_target.rotation
            @ forearm_direction(file.target.angles)
        )
        if down < STANDS:
            block_m = _block(in_photo_m)
            box_m[0, 1] = block_m[1, 1] + BLOCK_GAP_M
    if box_m[0, 2] < 0:
        raise HandbenchError(
            f"scene '{file.name}': the target extends {-1e3 * lower_m[2]:.0f} mm behind the back "
            f"plate, or is closer than {1e3 * CROP_MARGIN_M:.0f} mm to it; change mount.offset_m "
            "to move the back plate away from the radar"
        )
    aim_m = np.array([0.0, 0.0, file.target.distance_m])
    cameras = rig(file.photos, aim_m, radar_from_photo, file.seed) if file.photos else ()
    return Scene(
        file, array, surface, radar_from_target, radar_from_photo, cameras, box_m, block_m, target
    )


def antenna_array(name: str, folder: Path) -> AntennaArray:
    """Return the built-in antenna array, or that in a folder next to the scene file (tx_m.csv and
    rx_m.csv)."""
    if name == BUILT_IN_ARRAY:
        return qar50()
    place = inside(folder, name, f"sensor.array (built in: {BUILT_IN_ARRAY})")
    return AntennaArray(load_positions(place / "tx_m.csv"), load_positions(place / "rx_m.csv"))


def _surface(spec: AnyTarget, target: Target | None, folder: Path) -> TriangleMesh:
    match spec:
        case HandTarget():
            # imports numba, which readers of scenes do not need
            from handbench.bench.scenes.hand import hand_mesh

            return hand_mesh(spec.angles, spec.edge_m, spec.build)
        case SphereTarget():
            return sphere_mesh(spec.radius_m, spec.edge_m)
        case PlateTarget():
            return plate_mesh(spec.width_m, spec.height_m, spec.thickness_m, spec.edge_m)
        case DihedralTarget():
            return dihedral_mesh(spec.side_m, spec.edge_m)
        case MeshTarget():
            surface = read_mesh(inside(folder, spec.path, "target.path"))
            surface.scale({"m": 1.0, "mm": 1e-3}[spec.unit], np.zeros(3))
            return surface
    assert target is not None  # all others are above
    return spheres(target)


def spheres(target: Target) -> TriangleMesh:
    """Return the surfaces of all foam spheres of a calibration target as one mesh in the target's
    frame, accurate to 0.01 mm."""
    placed = (
        sphere_mesh(e.sphere_radius_m, np.pi * e.sphere_radius_m / 60).translate(e.centre_m)
        for e in target.element
    )
    return reduce(operator.add, placed)


def _block(target_m: np.ndarray) -> np.ndarray:
    """Return the lower and upper corner [2, 3], in the photo frame, of a block on which the forearm
    rests, with the last 12 mm of the forearm inside. target_m [n, 3]: vertices of hand and forearm
    in the photo frame."""
    lowest_m = target_m[:, 1].min()
    x, z = target_m[target_m[:, 1] < lowest_m + 0.02][:, [0, 2]].mean(axis=0)
    top = lowest_m + FOREARM_IN_BLOCK_M
    return np.array([[x - 0.05, top - 0.04, z - 0.03], [x + 0.05, top, z + 0.03]])

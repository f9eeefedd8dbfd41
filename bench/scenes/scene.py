"""Scene files: what stands before the radar and the cameras, with its true geometry."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import numpy as np
from pydantic import Field, model_validator
from scipy.spatial.transform import Rotation

from bench.results import Name
from bench.scenes.hand import hand_mesh
from bench.scenes.poses import POSES
from bench.scenes.rig import rig
from bench.scenes.stand import stand_board
from calibration import Config, HandbenchError, inside, load, suggest
from calibration.meshes import mesh, read_mesh
from calibration.target import Target, default_target, load_target
from calibration.transforms import Transform
from groundtruth.board import Board
from groundtruth.cameras import Camera

if TYPE_CHECKING:
    import open3d as o3d

BUILT_IN_ARRAY = "qar50"
CROP_MARGIN_M = 0.004
BLOCK_GAP_M = 0.003  # the crop box ends this far above the block
FOREARM_IN_BLOCK_M = 0.012
PHOTO_AXES = np.diag([-1.0, 1.0, -1.0])  # the board faces the radar: its z is the radar's -z


class _Placed(Config):
    """Where the target's own frame stands in the radar frame."""

    distance_m: float = Field(default=0.30, gt=0)
    offset_m: tuple[float, float] = (0.0, 0.0)
    rotation_deg: tuple[float, float, float] = (0.0, 0.0, 0.0)  # about the fixed x, y, z axes, in this order

    def radar_from_target(self) -> Transform:
        """The placement as a transform."""
        return _rigid("target", "radar", _rotation(self.rotation_deg), (*self.offset_m, self.distance_m))


class HandTarget(_Placed):
    """A parametric hand; `distance_m` is the range of its palm's mid-plane."""

    kind: Literal["hand"]
    pose: str
    distance_m: float = Field(default=0.31, gt=0)
    offset_m: tuple[float, float] = (0.0, -0.030)
    edge_m: float = Field(default=1e-3, ge=5e-4, le=5e-3)

    @model_validator(mode="after")
    def _known_pose(self) -> HandTarget:
        if self.pose not in POSES:
            raise ValueError(f"unknown pose; {suggest(self.pose, list(POSES))}")
        return self


class CalibrationTarget(_Placed):
    """The calibration target; `file` (beside the scene file) replaces the default one."""

    kind: Literal["calibration_target"]
    file: str | None = None
    rotation_deg: tuple[float, float, float] = (4.0, -6.0, 8.0)


class MeshTarget(_Placed):
    """Any closed mesh from a file beside the scene file."""

    kind: Literal["mesh"]
    path: str
    unit: Literal["m", "mm"] = "m"


class Sweep(Config):
    """`count` equidistant frequencies, both ends included."""

    start_hz: float = Field(gt=0)
    stop_hz: float = Field(gt=0)
    count: int = Field(ge=1, le=100_000)


class Sensor(Config):
    """The radar: a built-in array or an array file, and its frequencies (sweeps, then tones)."""

    array: str = BUILT_IN_ARRAY
    sweep: tuple[Sweep, ...] = (Sweep(start_hz=72e9, stop_hz=82e9, count=128),)
    tones_hz: tuple[Annotated[float, Field(gt=0)], ...] = ()

    @property
    def frequencies_hz(self) -> np.ndarray:
        """All frequencies [n] in the order of the file."""
        return np.concatenate([*(np.linspace(s.start_hz, s.stop_hz, s.count) for s in self.sweep), self.tones_hz])


class Noise(Config):
    """Disturbances of the echoes; 0 means none."""

    phase_noise_rad: float = Field(default=0.0, ge=0)


class Photos(Config):
    """The photographs to take."""

    cameras: int = Field(default=8, ge=2, le=100)
    width: int = Field(default=2400, ge=64, le=12_000)
    height: int = Field(default=1600, ge=64, le=12_000)
    full_well_e: float = Field(default=15_000.0, gt=0)  # electrons at white: sets the photon noise
    read_noise_e: float = Field(default=6.0, ge=0)
    blur_px: float = Field(default=0.5, ge=0)  # Gaussian, standard deviation
    texture_contrast: float = Field(default=1.0, ge=0)  # 1 = natural skin or foam


class Mount(Config):
    """The stand: pose of the board's frame in the radar frame, before which the board faces the radar squarely."""

    offset_m: tuple[float, float, float] = (0.004, -0.006, 0.400)
    rotation_deg: tuple[float, float, float] = (3.0, -4.0, 2.0)

    def radar_from_photo(self) -> Transform:
        """The true transform."""
        return _rigid("photo", "radar", _rotation(self.rotation_deg) @ PHOTO_AXES, self.offset_m)


class SceneFile(Config):
    """The content of a scene file."""

    version: Literal[1]
    name: Name
    seed: int = Field(default=0, ge=0)
    target: Annotated[HandTarget | CalibrationTarget | MeshTarget, Field(discriminator="kind")]
    sensor: Sensor = Sensor()
    noise: Noise = Noise()
    photos: Photos | None = None
    mount: Mount = Mount()


@dataclass(frozen=True)
class Scene:
    """A scene with its true geometry. `target` is None but for a calibration target; `cameras` is empty without
    photographs; `box_m` [2, 3] is the crop box in the photo frame: the target without plate and block; `block_m`
    [2, 3], likewise in the photo frame, is what the forearm stands on (None for other targets)."""

    file: SceneFile
    target_mesh: o3d.geometry.TriangleMesh  # radar frame
    radar_from_target: Transform
    radar_from_photo: Transform
    board: Board
    cameras: tuple[Camera, ...]
    box_m: np.ndarray
    folder: Path
    block_m: np.ndarray | None = None
    target: Target | None = None

    @property
    def balls_m(self) -> np.ndarray:
        """Centres [n, 3] of the calibration target's balls in the radar frame."""
        return self.radar_from_target.points(self.target.centres_m)


def load_scene(path: str | Path) -> Scene:
    """Read a scene file and build the scene; other files that it names lie in its folder."""
    return build(load(SceneFile, path, "a scene description"), Path(path).parent)


def build(file: SceneFile, folder: str | Path = ".") -> Scene:
    """The scene of a parsed scene file; files that it names are looked up in `folder`."""
    target = _calibration_target(file.target, Path(folder))
    surface = _surface(file.target, target, Path(folder))
    radar_from_target = file.target.radar_from_target()
    surface.transform(radar_from_target.matrix)
    radar_from_photo = file.mount.radar_from_photo()
    in_photo_m = radar_from_photo.inverse().points(np.asarray(surface.vertices))
    lower_m, upper_m = in_photo_m.min(axis=0), in_photo_m.max(axis=0)
    box_m = np.stack([lower_m - CROP_MARGIN_M, upper_m + CROP_MARGIN_M])
    block_m = None
    if isinstance(file.target, HandTarget):
        block_m = _block(in_photo_m)
        box_m[0, 1] = block_m[1, 1] + BLOCK_GAP_M
    if box_m[0, 2] < 0:
        raise HandbenchError(
            f"scene '{file.name}': the target reaches {-1e3 * lower_m[2]:.0f} mm behind the back plate or closer than "
            f"{1e3 * CROP_MARGIN_M:.0f} mm to it; move mount.offset_m away from the radar"
        )
    aim_m = np.array([0.0, 0.0, file.target.distance_m])
    photos = file.photos
    cameras = rig(photos.cameras, photos.width, photos.height, aim_m, radar_from_photo, file.seed) if photos else ()
    return Scene(
        file, surface, radar_from_target, radar_from_photo, stand_board(), cameras, box_m, Path(folder), block_m, target
    )


def named_files(file: SceneFile, folder: str | Path) -> list[Path]:
    """Files and folders beside the scene file that it names: their content belongs to the scene."""
    folder = Path(folder)
    names = [getattr(file.target, key, None) for key in ("file", "path")]
    names += [] if file.sensor.array == BUILT_IN_ARRAY else [file.sensor.array]
    paths = [inside(folder, name, f"scene '{file.name}'") for name in names if name]
    for path in paths:
        if not path.exists():
            raise HandbenchError(f"{path}: is missing, but scene '{file.name}' names it; check the path")
    return paths


def _calibration_target(spec: Config, folder: Path) -> Target | None:
    if not isinstance(spec, CalibrationTarget):
        return None
    return load_target(inside(folder, spec.file, "target.file")) if spec.file else default_target()


def _surface(spec: Config, target: Target | None, folder: Path) -> o3d.geometry.TriangleMesh:
    if isinstance(spec, HandTarget):
        return hand_mesh(POSES[spec.pose], spec.edge_m)
    if isinstance(spec, MeshTarget):
        surface = read_mesh(inside(folder, spec.path, "target.path"))
        surface.scale({"m": 1.0, "mm": 1e-3}[spec.unit], np.zeros(3))
        return surface
    return spheres(target)


def spheres(target: Target) -> o3d.geometry.TriangleMesh:
    """The foam spheres' surfaces as one mesh in the target's frame, flat to 0.01 mm."""
    from calibration.meshes import load_open3d

    o3d = load_open3d()
    whole = mesh(np.zeros((0, 3)), np.zeros((0, 3), dtype=np.int32))
    for element in target.element:
        ball = o3d.geometry.TriangleMesh.create_sphere(element.sphere_radius_m, resolution=60)
        whole += ball.translate(element.centre_m)
    return whole


def _block(target_m: np.ndarray) -> np.ndarray:
    """A block [2, 3] under the forearm, in the photo frame; the forearm sinks into it a little."""
    lowest_m = target_m[:, 1].min()
    x, z = target_m[target_m[:, 1] < lowest_m + 0.02][:, [0, 2]].mean(axis=0)
    top = lowest_m + FOREARM_IN_BLOCK_M
    return np.array([[x - 0.05, top - 0.04, z - 0.03], [x + 0.05, top, z + 0.03]])


def _rigid(source: str, to: str, rotation: np.ndarray, offset_m: tuple[float, ...]) -> Transform:
    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = rotation, offset_m
    return Transform(source, to, matrix)


def _rotation(angles_deg: tuple[float, float, float]) -> np.ndarray:
    return Rotation.from_euler("xyz", angles_deg, degrees=True).as_matrix()

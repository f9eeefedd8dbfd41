"""The content of a scene file: target, radar, cameras and stand, and the effects in the echoes."""

from collections.abc import Collection
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import AfterValidator, Discriminator, Field, Tag, model_validator

from handbench.bench.scenes.bones import person_pose
from handbench.bench.scenes.hand_pose import POSES, Pose, between
from handbench.bench.scenes.people import MOST_PEOPLE, Person, person, placement
from handbench.calibration.transforms import Transform
from handbench.radar.data.grid import Sweep
from handbench.radar.simulation.catalogue import EFFECTS
from handbench.radar.simulation.scene import Material, Motion, Noise, Roughness, SensorFaults
from handbench.support.config import Config, Name, Near, Tone, parse, suggest
from handbench.support.errors import HandbenchError
from handbench.support.files import inside

BUILT_IN_ARRAY = "qar50"
MOST_TONES = 20_000  # of a scene; echoes of the built-in array take 1.4 GB
PHOTO_AXES = np.diag([-1.0, 1.0, -1.0])  # the board faces the radar: its z is the radar's -z
Angles = tuple[float, float, float]  # about the fixed x, y and z axes, in this order


class _Placed(Config):
    """Position of a target in the radar frame, and its motion.

    distance_m: z of the target's origin; offset_m: its x and y. rotation_deg: turns about the fixed
    x, y and z axes, in this order.
    """

    distance_m: float = Field(default=0.30, gt=0, le=100)
    offset_m: tuple[Near, Near] = (0.0, 0.0)
    rotation_deg: Angles = (0.0, 0.0, 0.0)
    motion: Motion = Motion()

    def radar_from_target(self) -> Transform:
        """Return the transform from the target's frame to the radar frame."""
        return _placed("target", self.rotation_deg, np.eye(3), (*self.offset_m, self.distance_m))


class _Solid(_Placed):
    """A target of one material. roughness: relief of its surface that its mesh is too coarse to
    show."""

    material: Material = Material()
    roughness: Roughness = Roughness()


def require_one_of(name: str, known: Collection[str]) -> str:
    """Return the name. Raises ValueError if it is not one of the known ones."""
    if name not in known:
        raise ValueError(f"this name is unknown; {suggest(name, list(known))}")
    return name


EFFECT_NAMES = [effect.id for effect in EFFECTS]
EffectName = Annotated[str, AfterValidator(lambda name: require_one_of(name, EFFECT_NAMES))]
Letter = Annotated[str, AfterValidator(lambda pose: require_one_of(pose, POSES)), Tag("letter")]
AnyPose = Annotated[
    Letter | Annotated[Pose, Tag("Pose")],
    Discriminator(lambda pose: "letter" if isinstance(pose, str) else "Pose"),
]


def person_angles(pose: str | Pose, number: int) -> Pose:
    """Return the joint angles with which the person `number` makes a pose."""
    return person_pose(POSES[pose] if isinstance(pose, str) else pose, number)


class HandMotion(Motion):
    """The motion of a hand, whose fingers may also move: to `pose`, which they reach after
    duration_s. The joint angles are linear in time until then, and constant afterwards."""

    pose: AnyPose | None = None
    duration_s: float | None = Field(default=None, ge=1e-3, le=1e4)

    @model_validator(mode="after")
    def _both_or_none(self) -> "HandMotion":
        if (self.pose is None) != (self.duration_s is None):
            raise ValueError("pose and duration_s are not both given; give both or neither")
        return self


class HandTarget(_Solid):
    """A parametric right hand.

    pose: a letter of the manual alphabet, or joint angles (a table [target.pose]). distance_m: z of
    the palm's centre in the radar frame. edge_m: length of the mesh's edges. person: number of the
    person whose hand it is (0: the mean hand).
    """

    kind: Literal["hand"]
    pose: AnyPose
    distance_m: float = Field(default=0.31, gt=0, le=100)
    offset_m: tuple[Near, Near] = (0.0, -0.030)
    edge_m: float = Field(default=1e-3, ge=5e-4, le=5e-3)
    person: int = Field(default=0, ge=0, le=MOST_PEOPLE)
    motion: HandMotion = HandMotion()

    @property
    def angles(self) -> Pose:
        """The joint angles with which this person makes the pose."""
        return person_angles(self.pose, self.person)

    def angles_at(self, time_s: float) -> Pose:
        """Return the joint angles at a time since the start of the motion; before it, those of the
        same motion."""
        motion = self.motion
        if motion.pose is None or motion.duration_s is None:
            return self.angles
        reached = person_angles(motion.pose, self.person)
        return between(self.angles, reached, min(time_s / motion.duration_s, 1.0))

    @property
    def build(self) -> Person:
        """The proportions of this person's hand, as factors on the mean hand."""
        return person(self.person)


class CalibrationTarget(_Placed):
    """The calibration target: foam spheres with steel balls inside. file: its description, in the
    scene file's folder (None: the default target)."""

    kind: Literal["calibration_target"]
    file: str | None = None
    rotation_deg: Angles = (4.0, -6.0, 8.0)


class MeshTarget(_Solid):
    """A target whose surface is a closed mesh from a file. path: the file, in the scene file's
    folder. unit: of its coordinates."""

    kind: Literal["mesh"]
    path: str
    unit: Literal["m", "mm"] = "m"


class _Shape(_Solid):
    edge_m: float = Field(default=1e-3, ge=1e-4, le=5e-3)  # length of the mesh's edges


class SphereTarget(_Shape):
    """A sphere with its centre at the target's origin."""

    kind: Literal["sphere"]
    radius_m: float = Field(default=0.03, gt=0, le=0.5)


class PlateTarget(_Shape):
    """A flat plate that faces the radar, with its front in the x-y plane of the target's frame."""

    kind: Literal["plate"]
    width_m: float = Field(default=0.12, gt=0, le=1)
    height_m: float = Field(default=0.12, gt=0, le=1)
    thickness_m: float = Field(default=2e-3, gt=0, le=0.1)


class DihedralTarget(_Shape):
    """A corner reflector: two square plates, side_m wide, that meet along the y axis of the
    target's frame at a right angle open towards the radar."""

    kind: Literal["dihedral"]
    side_m: float = Field(default=0.06, gt=0, le=0.5)


AnyTarget = (
    HandTarget | CalibrationTarget | MeshTarget | SphereTarget | PlateTarget | DihedralTarget
)


class Sensor(SensorFaults):
    """The radar.

    array: the built-in array, or a folder with another one. sweep, tones_hz: the frequencies,
    measured in this order (first all sweeps, then the single tones), one every step_time_s seconds.
    frame_period_s: time from one frame's start to the next, while the target moves on (None: it
    starts at the same place in every frame). polarisation_deg: direction of the antennas' electric
    field, from x towards y. The inherited keys describe the radar's imperfections.
    """

    array: str = BUILT_IN_ARRAY
    sweep: tuple[Sweep, ...] = (Sweep(),)
    tones_hz: tuple[Tone, ...] = ()
    step_time_s: float = Field(default=1e-3, ge=0, le=100)
    frame_period_s: float | None = Field(default=None, gt=0, le=1e4)
    # of the antennas' field, from x towards y
    polarisation_deg: float = Field(default=90.0, ge=-360, le=360)

    @model_validator(mode="after")
    def _some_tone(self) -> "Sensor":
        count = sum(sweep.count for sweep in self.sweep) + len(self.tones_hz)
        if count == 0:
            raise ValueError("the radar has no tones to measure at; add a sweep or tones_hz")
        if count > MOST_TONES:
            raise ValueError(
                f"sweep and tones_hz make {count} tones, more than {MOST_TONES}; take a smaller "
                "count"
            )
        frame_s = count * self.step_time_s
        if self.frame_period_s is not None and self.frame_period_s < frame_s * (1 - 1e-9):
            raise ValueError(
                f"frame_period_s is {self.frame_period_s:g}, but a frame of {count} tones takes "
                f"{frame_s:g} s; expected at least that"
            )
        return self

    @property
    def frequencies_hz(self) -> np.ndarray:
        """All frequencies [n] in Hz, in the order in which they are measured."""
        return np.concatenate([*(sweep.frequencies_hz for sweep in self.sweep), self.tones_hz])


class Photos(Config):
    """The photographs to simulate: cameras, pictures, sensor and blur."""

    cameras: int = Field(default=8, ge=2, le=100)
    width: int = Field(default=2400, ge=64, le=10_000)
    height: int = Field(default=1600, ge=64, le=10_000)
    # electrons at white: sets the photon noise
    full_well_e: float = Field(default=15_000.0, gt=0, le=1e9)
    read_noise_e: float = Field(default=6.0, ge=0, le=1e9)
    blur_px: float = Field(default=0.5, ge=0, le=100)  # Gaussian, standard deviation


class Mount(Config):
    """Pose of the stand's board in the radar frame.

    offset_m [3]: position of the board's centre. rotation_deg: turns about the fixed x, y and z
    axes, in this order, starting from a board that faces the radar.
    """

    offset_m: tuple[Near, Near, Near] = (0.004, -0.006, 0.400)
    rotation_deg: Angles = (3.0, -4.0, 2.0)

    def radar_from_photo(self) -> Transform:
        """Return the true transform from the photo frame (that of the board) to the radar frame."""
        return _placed("photo", self.rotation_deg, PHOTO_AXES, self.offset_m)


class Stand(Config):
    """The stand in the radar's view.

    reflectivity_db: echo amplitude of its plate and block relative to metal (None: absorber covers
    them, no echo). empty: also simulate a capture of the empty room (empty.h5). subtract: subtract
    the echoes of the empty room from those of the scene.
    """

    reflectivity_db: float | None = Field(default=None, le=0)
    empty: bool = False
    subtract: bool = False


class SceneFile(Config):
    """The content of a scene file.

    effects: names of the effects to simulate, or "auto" for every effect that the scene has a cause
    for. noise, sensor and target also contain the causes of effects. photos: None for no
    photographs. mount: pose of the stand's board.
    """

    version: Literal[1]
    name: Name
    seed: int = Field(default=0, ge=0)
    effects: Literal["auto"] | tuple[EffectName, ...] = "auto"
    target: Annotated[AnyTarget, Field(discriminator="kind")]
    sensor: Sensor = Sensor()
    noise: Noise = Noise()
    stand: Stand = Stand()
    photos: Photos | None = None
    mount: Mount = Mount()

    def varied(self, changes: dict[str, Any], suffix: str) -> "SceneFile":
        """Return the scene with other values, and with the suffix added to its name.

        changes: as the content of a scene file, with only the keys that change. Raises
        HandbenchError for an unknown key or a wrong value."""
        values = _replaced(self.model_dump(mode="json", exclude_unset=True), changes)
        name = f"{self.name}-{suffix}"
        return parse(SceneFile, values | {"name": name}, f"scene '{name}'")

    def of_person(self, number: int) -> "SceneFile":
        """Return the scene with the hand of the person `number`, held as that person holds it, with
        a name and a seed of its own. Raises HandbenchError if the target is not a hand."""
        if not isinstance(self.target, HandTarget):
            raise HandbenchError(
                f"scene '{self.name}': its target is of kind '{self.target.kind}', but persons "
                'apply only to kind = "hand"; leave persons out, or change the target'
            )
        target, (shift_m, tilt_deg) = self.target, placement(number, self.seed)
        *offset_m, distance_m = np.add((*target.offset_m, target.distance_m), shift_m).tolist()
        held = {
            "person": number,
            "distance_m": distance_m,
            "offset_m": tuple(offset_m),
            "rotation_deg": tuple(np.add(target.rotation_deg, tilt_deg).tolist()),
        }
        own = {"name": f"{self.name}-person-{number:02}", "seed": self.seed + 1000 * number}
        return self.model_copy(update=own | {"target": target.model_copy(update=held)})


def _replaced(old: Any, new: Any) -> Any:
    """Return nested values with the new ones in their place."""
    if isinstance(old, dict) and isinstance(new, dict):
        return old | {key: _replaced(old.get(key), value) for key, value in new.items()}
    return new


def named_files(file: SceneFile, folder: Path) -> list[Path]:
    """Return the paths of the files and folders in `folder` that a scene file refers to; their
    content is part of the scene. Raises HandbenchError if one of them is missing."""
    names = [getattr(file.target, key, None) for key in ("file", "path")]
    if file.sensor.array != BUILT_IN_ARRAY:
        names.append(file.sensor.array)
    paths = [inside(folder, name, f"scene '{file.name}'") for name in names if name]
    for path in paths:
        if not path.exists():
            raise HandbenchError(
                f"{path}: is missing, although scene '{file.name}' uses it; check the path"
            )
    return paths


def _placed(
    source: str, angles_deg: Angles, axes: np.ndarray, offset_m: tuple[float, ...]
) -> Transform:
    """Return the transform, without scale, from the frame `source` to the radar frame.

    A point is first mapped by axes [3, 3], then turned by angles_deg about the fixed x, y and z
    axes in this order, then shifted by offset_m [3].
    """
    from scipy.spatial.transform import Rotation

    matrix = np.eye(4)
    matrix[:3, :3] = Rotation.from_euler("xyz", angles_deg, degrees=True).as_matrix() @ axes
    matrix[:3, 3] = offset_m
    return Transform(source, "radar", matrix)

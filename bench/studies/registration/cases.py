"""Placements of the calibration target, made as well as its description says, and what may go wrong with them."""

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from bench.scenes.build import Scene, build
from bench.scenes.scene_file import SceneFile
from calibration.target.description import Element, Target, default_target, save_target
from radar.support.config import parse

TURN_DEG = 30.0  # of the target, about each axis, at most
PHASE_NOISE_RAD = 0.0281  # of the paper's table
MADE = "made.toml"  # the target as it was really made, beside the scene

FAULTS = {
    "none": "the target as described, in view",
    "two hidden": "two elements of the square are covered: from the radar, in every second placement from cameras too",
    "fifth missing": "the element that breaks the symmetry is missing: likewise",
    "wrong file": "the description is of a target whose square is 20 mm larger",
    "clutter": "a metal ball stands beside the target whose echo is up to 16 dB stronger than the target's balls'",
}


@dataclass(frozen=True)
class Case:
    """One placement. scene: as it stands; described: what the user believes the target to be; fault: of FAULTS."""

    number: int
    fault: str
    scene: Scene
    described: Target

    @property
    def heard(self) -> tuple[int, ...]:
        """Indices of the elements that the radar sees."""
        hidden = {"two hidden": (self.number % 4, (self.number + 1) % 4), "fifth missing": (4,)}.get(self.fault, ())
        return tuple(i for i in range(len(self.described.element)) if i not in hidden)

    @property
    def seen(self) -> tuple[int, ...]:
        """Indices of the elements that the cameras see: the same, or, in every second placement, all."""
        return self.heard if self.number // 8 % 2 == 0 else tuple(range(len(self.described.element)))


def case(number: int, folder: Path, fault: str = "none", photographs: bool = True) -> Case:
    """Placement `number`: distance 0.26 to 0.32 m, 20 mm aside, turned by ±30° about each axis; the board's frame and
    the antennas' polarisation drawn too, and the target's making within its description's tolerances."""
    rng = np.random.default_rng([number, 6])
    described = default_target()
    folder.mkdir(parents=True, exist_ok=True)
    save_target(folder / MADE, made(described, rng))
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
        **({"photos": {"cameras": 8}} if photographs else {}),
    }
    scene = build(parse(SceneFile, values, f"placement {number}"), folder)
    return Case(number, fault, scene, wrong(described) if fault == "wrong file" else described)


def made(target: Target, rng: np.random.Generator) -> Target:
    """The target as a workshop makes it, drawn from the tolerances of its description."""
    return target.model_copy(
        update={
            "foam_permittivity": max(1.0, target.foam_permittivity + target.foam_permittivity_sigma * rng.normal()),
            "element": tuple(_made(element, target, rng) for element in target.element),
        }
    )


def _made(element: Element, target: Target, rng: np.random.Generator) -> Element:
    offset_m = np.array(element.ball_offset_m) + target.ball_offset_sigma_m * rng.normal(size=3)
    return element.model_copy(
        update={
            "sphere_radius_m": element.sphere_radius_m + target.sphere_radius_sigma_m * rng.normal(),
            "ball_offset_m": tuple(offset_m.tolist()),
        }
    )


def wrong(target: Target) -> Target:
    """A description of another target: the square 20 mm larger."""
    larger = 1 + 0.02 / 0.12
    return target.model_copy(
        update={
            "element": tuple(
                e.model_copy(update={"centre_m": tuple((larger * np.array(e.centre_m)).tolist())})
                for e in target.element
            )
        }
    )


def only(scene: Scene, shown: tuple[int, ...]) -> Scene:
    """The scene with some of the target's elements alone, for its echoes."""
    target = scene.target
    return replace(scene, target=target.model_copy(update={"element": tuple(target.element[i] for i in shown)}))

"""The calibration target: foam spheres, visible in photographs, with steel balls inside, visible to
the radar.

After Wirth et al. 2024 (arXiv 2403.10981); sizes are parameters, since theirs are not public. The
fifth element breaks the square's symmetry. A sensor's candidates are matched to the elements by
distances; ambiguous matches are refused.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TypeVar

import numpy as np
import tomlkit
from pydantic import Field

from handbench.calibration.transforms import umeyama
from handbench.support.config import Config, Near, load
from handbench.support.errors import HandbenchError
from handbench.support.files import write_text

SQUARE_M = 0.12  # side of the default target's square
# how far two distances may differ: detection, the target's making, the photographs' scale
TOLERANCE_M = 0.002
MAX_CANDIDATES = 80
HEADER = """\
# Calibration target: foam spheres, a steel ball at the centre of each; metres.
# Seen from the radar, x points to the left, y up and z away. At least three elements, not on a
# line, without symmetry.
"""


class Element(Config):
    """One foam sphere with a steel ball in it: centre and radii in the target's frame, metres.
    ball_offset_m: from the sphere's centre to the ball's, where it was measured."""

    centre_m: tuple[Near, Near, Near]
    sphere_radius_m: float = Field(gt=0, le=1)
    ball_radius_m: float = Field(gt=0, le=1)
    ball_offset_m: tuple[Near, Near, Near] = (0.0, 0.0, 0.0)


class Target(Config):
    """The calibration target: a rigid arrangement of at least three elements (foam spheres with a
    steel ball inside).

    Standard deviations of its manufacture: foam_permittivity_sigma (common to all spheres),
    ball_offset_sigma_m (each ball's position in its sphere, per axis), and sphere_radius_sigma_m.
    """

    element: tuple[Element, ...] = Field(min_length=3, max_length=50)
    foam_permittivity: float = Field(default=1.03, ge=1, le=20)
    foam_permittivity_sigma: float = Field(default=0.003, ge=0)
    ball_offset_sigma_m: float = Field(default=5e-5, ge=0)
    sphere_radius_sigma_m: float = Field(default=5e-5, ge=0)

    @property
    def centres_m(self) -> np.ndarray:
        """The foam spheres' centres [n, 3], metres."""
        return np.array([e.centre_m for e in self.element])

    @property
    def ball_offsets_m(self) -> np.ndarray:
        """The offsets [n, 3] from the foam spheres' centres to their balls', metres."""
        return np.array([e.ball_offset_m for e in self.element])

    @property
    def foam_delay_m(self) -> np.ndarray:
        """One-way optical path [n], metres, that the foam adds to an echo from each ball's surface:
        (√ε_r − 1)·(R_sphere − r_ball). The ball is in the sphere's middle, so that every antenna
        sees the same delay to first order."""
        depth = np.array([e.sphere_radius_m - e.ball_radius_m for e in self.element])
        return (np.sqrt(self.foam_permittivity) - 1) * depth


@dataclass(frozen=True)
class Candidate:
    """What may be an element of the target, as measured by one sensor: centre_m [3], covariance_m2
    [3, 3], and the indices of the elements that have its size."""

    centre_m: np.ndarray
    covariance_m2: np.ndarray
    elements: tuple[int, ...]


Assignment = dict[int, int]  # element → candidate
CandidateT = TypeVar("CandidateT", bound=Candidate)


def default_target() -> Target:
    """Make the default target: four 50 mm spheres at the corners of a 120 mm square and a fifth, 30
    mm, off its symmetry axes. The target's frame has its origin at the square's centre, the square
    in x and y, and z away from the radar."""
    half = SQUARE_M / 2
    square = [(-half, -half), (half, -half), (half, half), (-half, half)]
    corners = [
        Element(centre_m=(x, y, 0.0), sphere_radius_m=0.025, ball_radius_m=0.005) for x, y in square
    ]
    fifth = Element(centre_m=(0.018, 0.030, -0.010), sphere_radius_m=0.015, ball_radius_m=0.005)
    return Target(element=(*corners, fifth))


def load_target(path: str | Path) -> Target:
    """Read a target's description from a TOML file. Raises HandbenchError for a malformed one."""
    return load(Target, path, "a calibration target description")


def save_target(path: str | Path, target: Target) -> None:
    """Write a target description (TOML), atomically."""
    write_text(path, HEADER + tomlkit.dumps(target.model_dump()))


def match(candidates: Sequence[CandidateT], target: Target, sensor: str) -> dict[int, CandidateT]:
    """Find out which candidate is which element of the target. Returns the matched candidates by
    element, for the largest set that a rigid motion (without reflection) maps to the target's
    elements. sensor: name of the candidates in errors.

    Raises HandbenchError if fewer than min(4, all) elements match, if they are on a line, or if the
    match is ambiguous: a symmetric target, or its asymmetric element not found.
    """
    needed = min(4, len(target.element))
    found = assignments(candidates[:MAX_CANDIDATES], target)
    if not found or len(found[0]) < needed:
        raise HandbenchError(
            f"{sensor}: {len(found[0]) if found else 0} of {len(candidates)} detections match "
            f"elements of the target; expected at least {needed} of {len(target.element)}; check "
            "the description of the target, the scale, and that all elements are in view"
        )
    best = found[0]
    if len(found) > 1:
        seen = ", ".join(str(element + 1) for element in sorted(best))
        raise HandbenchError(
            f"{sensor}: the elements {seen} of the target can be matched in {len(found)} ways; "
            "use a target without symmetry, and check that all its elements are in view"
        )
    return {element: candidates[candidate] for element, candidate in best.items()}


def assignments(candidates: Sequence[Candidate], target: Target) -> list[Assignment]:
    """List all ways to assign candidates to elements, element → candidate, of the largest size:
    distances between candidates equal those of their elements within TOLERANCE_M, and a rotation
    maps all elements to their candidates."""
    centres_m = np.array([candidate.centre_m for candidate in candidates]).reshape(-1, 3)
    wanted_m, measured_m = _pairwise(target.centres_m), _pairwise(centres_m)
    count = len(target.element)
    found: list[Assignment] = []
    best = 3

    def extend(element: int, chosen: Assignment) -> None:
        nonlocal best, found
        if len(chosen) + count - element < best:
            return  # cannot become as large as the best one
        if element == count:
            if _is_rotation(chosen, target.centres_m, centres_m):
                found = [chosen] if len(chosen) > best else [*found, chosen]
                best = len(chosen)
            return
        for i, candidate in enumerate(candidates):
            others = list(chosen)
            gaps = measured_m[i, [chosen[o] for o in others]] - wanted_m[element, others]
            if element in candidate.elements and (np.abs(gaps) < TOLERANCE_M).all():
                extend(element + 1, {**chosen, element: i})
        extend(element + 1, chosen)  # the element is not seen

    extend(0, {})
    return found


def _is_rotation(chosen: Assignment, elements_m: np.ndarray, centres_m: np.ndarray) -> bool:
    """Tell whether a rigid motion without reflection maps the chosen elements to their candidates,
    within TOLERANCE_M: distances alone do not exclude a reflection."""
    source, target = elements_m[list(chosen)], centres_m[list(chosen.values())]
    matrix = umeyama(source, target)
    offset = target - source @ matrix[:3, :3].T - matrix[:3, 3]
    return bool(np.linalg.norm(offset, axis=1).max() < TOLERANCE_M)


def _pairwise(points_m: np.ndarray) -> np.ndarray:
    return np.linalg.norm(points_m[:, None] - points_m[None], axis=2)

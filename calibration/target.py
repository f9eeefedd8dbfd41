"""The calibration target: foam spheres, visible in photographs, with steel balls inside, visible to
the radar. It is described in a file, and detected objects are matched to its elements.

The target is after Wirth et al. 2024 (arXiv 2403.10981); sizes are parameters, since theirs are not
public. Its fifth element breaks the square's symmetry. Detected objects are matched to the elements
by their distances; an ambiguous match is an error.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from pydantic import Field

from handbench.calibration.transforms import umeyama
from handbench.support.config import Config, Near, load
from handbench.support.errors import HandbenchError

SQUARE_M = 0.12  # side of the default target's square
# how far two distances may differ: detection, the target's making, the photographs' scale
TOLERANCE_M = 0.002


class Element(Config):
    """One foam sphere with a steel ball in it. centre_m: the sphere's centre in the target's frame;
    ball_offset_m: measured vector from the sphere's centre to the ball's (default: 0)."""

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
        """The vectors [n, 3] from the foam spheres' centres to their balls' centres, metres."""
        return np.array([e.ball_offset_m for e in self.element])

    @property
    def foam_delay_m(self) -> np.ndarray:
        """One-way optical path [n], metres, that the foam adds to the echo of each ball: (√ε_r −
        1)·(R_sphere − r_ball). The ball is in the sphere's middle, so that the delay is the same
        for all antennas to first order."""
        depth = np.array([e.sphere_radius_m - e.ball_radius_m for e in self.element])
        return (np.sqrt(self.foam_permittivity) - 1) * depth


@dataclass(frozen=True)
class Candidate:
    """An object detected by one sensor that may be an element of the target: its centre_m [3],
    covariance_m2 [3, 3], and the indices of the elements that have its size. peak_m [3]: the point
    of a ball's surface from which its echo comes (None: seen in photographs)."""

    centre_m: np.ndarray
    covariance_m2: np.ndarray
    elements: tuple[int, ...]
    peak_m: np.ndarray | None = None


Assignment = dict[int, int]  # element → candidate


def default_target() -> Target:
    """Return the default target: four spheres of 50 mm diameter at the corners of a 120 mm square,
    and a fifth one of 30 mm off its symmetry axes. The origin of the target's frame is the square's
    centre; the square is in x and y, and z points away from the radar."""
    half = SQUARE_M / 2
    square = [(-half, -half), (half, -half), (half, half), (-half, half)]
    corners = [
        Element(centre_m=(x, y, 0.0), sphere_radius_m=0.025, ball_radius_m=0.005) for x, y in square
    ]
    fifth = Element(centre_m=(0.018, 0.030, -0.010), sphere_radius_m=0.015, ball_radius_m=0.005)
    return Target(element=(*corners, fifth))


def load_target(path: str | Path) -> Target:
    """Read a target's description from a TOML file. Raises HandbenchError for a malformed file."""
    return load(Target, path, "a calibration target description")


def match(candidates: Sequence[Candidate], target: Target, sensor: str) -> dict[int, Candidate]:
    """Find which detected object (candidate) is which element of the target: the matched candidates
    by element index. They are the largest set that a rigid motion without reflection maps to the
    target's elements.

    sensor: what detected the candidates, for messages. Raises HandbenchError if fewer than four
    elements match (or fewer than all, if the target has three), if they are on a line, or if the
    match is ambiguous: the target is symmetric, or the element that breaks its symmetry was not
    found.
    """
    needed = min(4, len(target.element))
    best, *others = assignments(candidates, target) or [{}]
    if len(best) < needed:
        raise HandbenchError(
            f"{sensor}: match {len(best)} elements of the target; expected at "
            f"least {needed} of {len(target.element)}; check the description of the target, the "
            "scale, that all elements are in view, and that the sensor resolves them"
        )
    if others:
        seen = ", ".join(str(element + 1) for element in sorted(best))
        raise HandbenchError(
            f"{sensor}: the elements {seen} of the target can be matched in {1 + len(others)} "
            "ways; use a target without symmetry, and check that all its elements are in view"
        )
    return {element: candidates[candidate] for element, candidate in best.items()}


def assignments(candidates: Sequence[Candidate], target: Target) -> list[Assignment]:
    """List all ways to assign detected objects (candidates) to elements, as dictionaries element
    index → candidate index, that have the largest number of elements.

    The distances between candidates must equal those between their elements within TOLERANCE_M, and
    a rotation must map all these elements to their candidates.
    """
    from scipy.spatial.distance import cdist  # here, since to read a target takes no scipy

    centres_m = np.array([candidate.centre_m for candidate in candidates]).reshape(-1, 3)
    wanted_m, measured_m = cdist(target.centres_m, target.centres_m), cdist(centres_m, centres_m)
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
        wanted = wanted_m[element, list(chosen)]
        for i, candidate in enumerate(candidates):
            if element in candidate.elements:
                gaps = measured_m[i, list(chosen.values())] - wanted
                if (np.abs(gaps) < TOLERANCE_M).all():
                    extend(element + 1, {**chosen, element: i})
        extend(element + 1, chosen)  # the element is not seen

    extend(0, {})
    return found


def _is_rotation(chosen: Assignment, elements_m: np.ndarray, centres_m: np.ndarray) -> bool:
    """Return True if a rigid motion without reflection maps the chosen elements to their
    candidates, within TOLERANCE_M. Equal distances are not enough for that: a mirror image has them
    too."""
    source, target = elements_m[list(chosen)], centres_m[list(chosen.values())]
    matrix = umeyama(source, target)
    offset = target - source @ matrix[:3, :3].T - matrix[:3, 3]
    return bool(np.linalg.norm(offset, axis=1).max() < TOLERANCE_M)

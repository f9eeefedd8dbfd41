"""The calibration target: foam spheres that photographs see, with steel balls inside that radar sees.

After Wirth et al. 2024 (arXiv 2403.10981); sizes are parameters, since theirs are not public. The fifth element breaks
the square's symmetry.
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import tomlkit
from pydantic import Field

from handbench.support.config import Config, load
from handbench.support.files import write_text

SQUARE_M = 0.12  # side of the default target's square
HEADER = """\
# Calibration target: foam spheres, a steel ball at the centre of each; metres.
# Seen from the radar, x points to the left, y up and z away. At least three elements, not on a line, without symmetry.
"""


class Element(Config):
    """One foam sphere with a steel ball in it (target frame, metres); ball_offset_m: from the sphere's centre to the
    ball's, where it was measured."""

    centre_m: tuple[float, float, float]
    sphere_radius_m: float = Field(gt=0)
    ball_radius_m: float = Field(gt=0)
    ball_offset_m: tuple[float, float, float] = (0.0, 0.0, 0.0)


class Target(Config):
    """A rigid arrangement of at least three elements, with how well it was made (standard deviations): of the foam's
    permittivity, which all spheres share, of each ball's place in its sphere, per axis, and of each sphere's radius."""

    element: tuple[Element, ...] = Field(min_length=3)
    foam_permittivity: float = Field(default=1.03, ge=1)
    foam_permittivity_sigma: float = Field(default=0.003, ge=0)
    ball_offset_sigma_m: float = Field(default=5e-5, ge=0)
    sphere_radius_sigma_m: float = Field(default=5e-5, ge=0)

    @property
    def centres_m(self) -> np.ndarray:
        """The foam spheres' centres [n, 3], metres."""
        return np.array([e.centre_m for e in self.element])

    @property
    def ball_offsets_m(self) -> np.ndarray:
        """The balls' centres against their spheres' [n, 3], metres."""
        return np.array([e.ball_offset_m for e in self.element])

    @property
    def foam_delay_m(self) -> np.ndarray:
        """Extra one-way optical path [n] of an echo from each ball's surface, (√ε_r − 1)·(R_sphere − r_ball); the
        sphere is centred on the ball, so that every antenna sees the same delay to first order."""
        depth = np.array([e.sphere_radius_m - e.ball_radius_m for e in self.element])
        return (np.sqrt(self.foam_permittivity) - 1) * depth


@dataclass(frozen=True)
class Candidate:
    """A sensor's estimate of an element's centre. centre_m: [3]; covariance_m2: [3, 3]; elements: indices of
    the elements that it can be, by its size."""

    centre_m: np.ndarray
    covariance_m2: np.ndarray
    elements: tuple[int, ...]


def default_target() -> Target:
    """Four 50 mm spheres at the corners of a 120 mm square and a fifth, 30 mm, off its symmetry axes; the target's
    frame has its origin at the square's centre, the square in x and y, and z away from the radar."""
    half = SQUARE_M / 2
    square = [(-half, -half), (half, -half), (half, half), (-half, half)]
    corners = [Element(centre_m=(x, y, 0.0), sphere_radius_m=0.025, ball_radius_m=0.005) for x, y in square]
    fifth = Element(centre_m=(0.018, 0.030, -0.010), sphere_radius_m=0.015, ball_radius_m=0.005)
    return Target(element=(*corners, fifth))


def load_target(path: str | Path) -> Target:
    """Read a target description (TOML)."""
    return load(Target, path, "a calibration target description")


def save_target(path: str | Path, target: Target) -> None:
    """Write a target description (TOML), atomically."""
    write_text(path, HEADER + tomlkit.dumps(target.model_dump()))

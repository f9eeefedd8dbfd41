"""A calibration target as photographs and radar would see it, made by formulas of their own."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from handbench.calibration import optical_detection, radar_detection
from handbench.calibration.registration import Pairs, solve
from handbench.calibration.target import Candidate
from handbench.calibration.transforms import Transform
from handbench.radar.data.grid import Axis, VoxelGrid

ANY = tuple(range(5))
# A quarter of the voxels of the product: every target of a test is inside, and a ball's image is
# 4 mm wide and 15 mm deep.
SIDE_M = Axis(start_m=-0.12, stop_m=0.12, step_m=0.004).values_m()
VOLUME = VoxelGrid(SIDE_M, SIDE_M, Axis(start_m=0.2, stop_m=0.45, step_m=0.008).values_m())


def pose(rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Any rotation [3, 3] and a translation [3] of up to 0.5 m."""
    return Rotation.random(rng=rng).as_matrix(), rng.uniform(-0.5, 0.5, 3)


def search_coarsely(monkeypatch: pytest.MonkeyPatch) -> None:
    """Have the registration look for balls in VOLUME only, and for spheres at a quarter of the
    votes' maxima."""
    monkeypatch.setattr(radar_detection, "VOLUME", VOLUME)
    monkeypatch.setattr(optical_detection, "MAX_MODES", 10)


def candidates(
    centres_m: np.ndarray, elements: tuple[int, ...] = ANY, covariance_m2: np.ndarray | None = None
) -> list[Candidate]:
    """Bare centres [n, 3] as candidates; by default each can be any element, ± 0.1 mm per axis."""
    covariance_m2 = 1e-8 * np.eye(3) if covariance_m2 is None else covariance_m2
    return [Candidate(c, covariance_m2, elements) for c in np.asarray(centres_m)]


def cap(rng: np.random.Generator, radius_m: float, part: float, density_m2: float) -> np.ndarray:
    """Outward unit vectors [n, 3], even on the part of a sphere that is nearest to −z."""
    n = int(part * 4 * np.pi * radius_m**2 * density_m2)
    z = 2 * part * rng.random(n) - 1
    azimuth = 2 * np.pi * rng.random(n)
    return np.stack(
        [np.sqrt(1 - z**2) * np.cos(azimuth), np.sqrt(1 - z**2) * np.sin(azimuth), z], axis=1
    )


def align(source: Sequence[Candidate], target: Sequence[Candidate]) -> Transform:
    """The motion that carries source centres to target centres, pair by pair; see `solve`."""
    names = [f"pair {i + 1}" for i in range(len(source))]
    return solve(Pairs.of(source, target, names))

"""Foam spheres in point clouds."""

from __future__ import annotations

import numpy as np
import pytest

from handbench.calibration.spheres.description import Element, Target
from handbench.calibration.spheres.optical_detection import find_spheres, fit_sphere
from tests.calibration.seen_target import cap, pose

NOISE_M = 2e-4
DENSITY_M2 = 3e6  # 3 points per mm²


def scene(
    rng: np.random.Generator, target: Target, part: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Points, noisy normals and true centres: caps of the spheres, the plate beside them, and stray
    points."""
    points, normals = [], []
    for element in target.element:
        outward = cap(rng, element.sphere_radius_m, part, DENSITY_M2)
        radius_m = element.sphere_radius_m + NOISE_M * rng.standard_normal((len(outward), 1))
        points.append(element.centre_m + radius_m * outward)
        normals.append(outward)
    plate = rng.uniform([-0.12, -0.12, 0.025], [0.12, 0.12, 0.025], (60_000, 3))
    behind = [
        np.hypot(*(plate[:, :2] - e.centre_m[:2]).T) < e.sphere_radius_m for e in target.element
    ]
    plate = plate[~np.any(behind, axis=0)]  # nobody sees the plate through a sphere
    points.append(plate + [0, 0, NOISE_M] * rng.standard_normal(plate.shape))
    normals.append(np.tile([0.0, 0, -1], (len(plate), 1)))
    points.append(rng.uniform(-0.15, 0.15, (4000, 3)))
    normals.append(rng.standard_normal((4000, 3)))
    p, n = np.concatenate(points), np.concatenate(normals)
    n = n / np.linalg.norm(n, axis=1, keepdims=True) + 0.1 * rng.standard_normal(
        n.shape
    )  # about 6° per axis
    rotation, shift_m = pose(rng)
    return p @ rotation.T + shift_m, n @ rotation.T, target.centres_m @ rotation.T + shift_m


@pytest.mark.slow
@pytest.mark.parametrize("part", [0.15, 0.3])
def test_all_spheres_are_found_and_nothing_else(rng, target, part):
    points, normals, centres = scene(rng, target, part)
    found = find_spheres(points, normals, target)
    assert len(found) == len(target.element)
    for sphere in found:
        element = int(np.linalg.norm(centres - sphere.centre_m, axis=1).argmin())
        assert element in sphere.elements
        # 600 voxels or more, ± 0.2 mm each at worst: 0.01 mm, times 3 to 8 since a smaller cap
        # leaves its depth less certain, with a radius that is known to ± 0.05 mm
        assert np.linalg.norm(sphere.centre_m - centres[element]) < (5e-5 if part > 0.2 else 8e-5)


def surface(kind: str, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """20 000 points of something that is none of the target's spheres, and outward normals."""
    u, v = rng.uniform(-1, 1, (2, 20_000))
    zero = np.zeros_like(u)
    if kind == "cylinder":
        normals = np.stack([np.cos(np.pi * u), np.sin(np.pi * u), zero], 1)
        points = 0.025 * normals + np.stack([zero, zero, 0.1 * v], 1)
    else:
        normals = rng.standard_normal((len(u), 3))
        normals /= np.linalg.norm(normals, axis=1, keepdims=True)
        points = {"other sphere": 0.020, "bowl": 0.025}[kind] * normals
        normals = -normals if kind == "bowl" else normals
    return points + NOISE_M * rng.standard_normal(points.shape), normals


@pytest.mark.parametrize("kind", ["cylinder", "other sphere", "bowl"])
def test_other_surfaces_are_no_spheres(rng, target, kind):
    assert find_spheres(*surface(kind, rng), target) == []


@pytest.mark.parametrize(
    ("part", "patch_m", "radius_sigma_m", "trials", "low", "high"),
    [
        (0.35, 0, 0, 150, 2.4, 3.6),
        (0.35, 0.003, 0, 150, 2.4, 5.2),
        (0.15, 0, 2e-4, 60, 2, 4),
        (0.45, 0, 2e-4, 60, 2, 4),
    ],
)
def test_the_covariance_is_honest(rng, part, patch_m, radius_sigma_m, trials, low, high):
    """The normalised squared error of a centre averages 3, the degrees of freedom, within three
    standard errors. Also where errors are equal within patches, as those of a dense reconstruction
    are; there a part of what they share is fitted away, and standard deviations may come out a
    quarter too small (3 · 1.3² = 5.2): taken as independent, the same errors would give 20. And
    where spheres are made to ± 0.2 mm, which would move them by that in depth."""
    nees = []
    for _ in range(trials):
        outward = cap(rng, 0.025, part, 0.6e6)
        error_m = NOISE_M * rng.standard_normal(len(outward))
        if patch_m:
            cells = np.floor(0.025 * outward / patch_m)
            error_m = error_m[np.unique(cells, axis=0, return_inverse=True)[1].ravel()]
        made_m = 0.025 + radius_sigma_m * rng.standard_normal()
        points_m = (made_m + error_m)[:, None] * outward
        start_m = np.array([1e-3, -1e-3, 1e-3])
        miss_m, covariance_m2 = fit_sphere(points_m, outward, start_m, 0.025, radius_sigma_m)
        nees.append(miss_m @ np.linalg.solve(covariance_m2, miss_m))
    assert low < np.mean(nees) < high


def test_the_foam_delays_an_echo_from_the_balls_surface():
    """25 mm of foam of √ε_r = 1.02 about a ball of 5 mm: 20 mm of foam are 0.4 mm longer, one
    way."""
    element = Element(centre_m=(0.0, 0.0, 0.0), sphere_radius_m=0.025, ball_radius_m=0.005)
    target = Target(element=(element,) * 5, foam_permittivity=1.02**2)
    assert target.foam_delay_m == pytest.approx([4e-4] * 5, rel=1e-9)

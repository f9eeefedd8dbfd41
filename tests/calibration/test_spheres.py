"""Foam spheres in point clouds."""

from __future__ import annotations

import numpy as np
import pytest

from handbench.calibration.optical_detection import find_spheres, fit_sphere
from handbench.calibration.target import Element, Target
from tests.calibration.seen_target import cap, pose

NOISE_M = 2e-4
DENSITY_M2 = 1.2e6  # a point or so a voxel


def scene(
    rng: np.random.Generator, target: Target, part: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Points, noisy normals and true centres: caps of the spheres, the plate beside them, and stray
    points."""
    plate = rng.uniform([-0.12, -0.12, 0.025], [0.12, 0.12, 0.025], (24_000, 3))
    points, normals = [rng.uniform(-0.15, 0.15, (1600, 3))], [rng.standard_normal((1600, 3))]
    for element in target.element:
        outward = cap(rng, element.sphere_radius_m, part, DENSITY_M2)
        radius_m = element.sphere_radius_m + NOISE_M * rng.standard_normal((len(outward), 1))
        points.append(element.centre_m + radius_m * outward)
        normals.append(outward)
        off_m = np.linalg.norm(plate[:, :2] - element.centre_m[:2], axis=1)
        plate = plate[off_m > element.sphere_radius_m]  # nobody sees it through a sphere
    points.append(plate + [0, 0, NOISE_M] * rng.standard_normal(plate.shape))
    normals.append(np.tile([0.0, 0, -1], (len(plate), 1)))
    p, n = np.concatenate(points), np.concatenate(normals)
    n /= np.linalg.norm(n, axis=1, keepdims=True)
    n += 0.1 * rng.standard_normal(n.shape)  # about 6° per axis
    rotation, shift_m = pose(rng)
    return p @ rotation.T + shift_m, n @ rotation.T, target.centres_m @ rotation.T + shift_m


@pytest.mark.parametrize(("part", "within_m"), [(0.15, 8e-5), (0.3, 5e-5)])
def test_all_spheres_are_found_and_nothing_else(rng, target, part, within_m):
    """600 voxels or more, ± 0.2 mm each at worst: 0.01 mm, times 3 to 8 since a smaller cap leaves
    its depth less certain, with a radius that is known to ± 0.05 mm."""
    points, normals, centres = scene(rng, target, part)
    found = find_spheres(points, normals, target)
    assert len(found) == len(target.element)
    for sphere in found:
        off_m = np.linalg.norm(centres - sphere.centre_m, axis=1)
        assert off_m.argmin() in sphere.elements and off_m.min() < within_m


@pytest.mark.parametrize(
    ("radius_m", "outwards", "flat"), [(0.025, 1, True), (0.020, 1, False), (0.025, -1, False)]
)
def test_other_surfaces_are_no_spheres(rng, target, radius_m, outwards, flat):
    """A cylinder, a sphere of another size, and a bowl."""
    normals = rng.standard_normal((8000, 3)) * [1, 1, not flat]
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    points_m = radius_m * normals + NOISE_M * rng.standard_normal(normals.shape)
    points_m[:, 2] += flat * rng.uniform(-0.1, 0.1, len(normals))
    assert find_spheres(points_m, outwards * normals, target) == []


@pytest.mark.parametrize("trials", [30, pytest.param(150, marks=pytest.mark.slow)])
@pytest.mark.parametrize(
    ("part", "patch_m", "radius_sigma_m"),
    [(0.35, 0, 0), (0.35, 0.003, 0), (0.15, 0, 2e-4), (0.45, 0, 2e-4)],
)
def test_the_covariance_is_honest(rng, part, patch_m, radius_sigma_m, trials):
    """The normalised squared error of a centre averages 3, the degrees of freedom, within three
    standard errors. Also where errors are equal within patches, as those of a dense reconstruction
    are; there a part of what they share is fitted away, and standard deviations may come out a
    quarter too small (3 · 1.3² = 5.1): taken as independent, the same errors would give 20. And
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
    chance = 3 * np.sqrt(6 / trials)
    assert 3 - chance < np.mean(nees) < (5.1 if patch_m else 3) + chance


def test_the_foam_delays_an_echo_from_the_balls_surface():
    """25 mm of foam of √ε_r = 1.02 about a ball of 5 mm: 20 mm of foam are 0.4 mm longer, one
    way."""
    element = Element(centre_m=(0.0, 0.0, 0.0), sphere_radius_m=0.025, ball_radius_m=0.005)
    target = Target(element=(element,) * 5, foam_permittivity=1.02**2)
    assert target.foam_delay_m == pytest.approx([4e-4] * 5, rel=1e-9)

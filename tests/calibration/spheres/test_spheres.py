"""Foam spheres in point clouds."""

from __future__ import annotations

import numpy as np
import pytest

from handbench.calibration.spheres.description import Target
from handbench.calibration.spheres.optical_detection import (
    OrientedPoints,
    _shared,
    find_spheres,
    fit_sphere,
)
from handbench.support.errors import HandbenchError
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


@pytest.mark.parametrize(
    ("part", "oriented"), [(0.15, True), (0.15, False), (0.3, True), (0.45, False)]
)
def test_all_spheres_are_found_and_nothing_else(rng, target, part, oriented):
    points, normals, centres = scene(rng, target, part)
    found = find_spheres(points, normals if oriented else None, target)
    assert len(found) == len(target.element)
    for sphere in found:
        element = int(np.linalg.norm(centres - sphere.centre_m, axis=1).argmin())
        assert element in sphere.elements
        # 600 voxels or more, ± 0.2 mm each at worst: 0.01 mm, times 3 to 8 since a smaller cap
        # leaves its depth less certain, with a radius that is known to ± 0.05 mm
        assert np.linalg.norm(sphere.centre_m - centres[element]) < (5e-5 if part > 0.2 else 8e-5)
        assert sphere.radius_m == pytest.approx(target.element[element].sphere_radius_m, rel=0.01)
        assert (
            part - 0.03 < sphere.coverage < part + 0.15
        )  # the rim's lattice cells count whole; so do stray points'
        assert sphere.inliers > 500


def surface(kind: str, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """20 000 points of something that is none of the target's spheres, and outward normals."""
    u, v = rng.uniform(-1, 1, (2, 20_000))
    zero = np.zeros_like(u)
    if kind == "plate":
        points, normals = np.stack([0.1 * u, 0.1 * v, zero], 1), np.stack([zero, zero, zero - 1], 1)
    elif kind == "block":
        side = rng.integers(0, 3, len(u))
        points, normals = (
            np.stack([0.03 * u, 0.03 * v, zero - 0.03], 1),
            np.stack([zero, zero, zero - 1], 1),
        )
        turn = np.arange(3)[None, :] + side[:, None]
        points, normals = (
            np.take_along_axis(points, turn % 3, 1),
            np.take_along_axis(normals, turn % 3, 1),
        )
    elif kind == "cylinder":
        normals = np.stack([np.cos(np.pi * u), np.sin(np.pi * u), zero], 1)
        points = 0.025 * normals + np.stack([zero, zero, 0.1 * v], 1)
    else:
        normals = rng.standard_normal((len(u), 3))
        normals /= np.linalg.norm(normals, axis=1, keepdims=True)
        points = {"other sphere": 0.020, "bowl": 0.025}[kind] * normals
        normals = -normals if kind == "bowl" else normals
    return points + NOISE_M * rng.standard_normal(points.shape), normals


@pytest.mark.parametrize("kind", ["plate", "block", "cylinder", "other sphere", "bowl"])
def test_other_surfaces_are_no_spheres(rng, target, kind):
    assert find_spheres(*surface(kind, rng), target) == []


@pytest.mark.parametrize(("patch_m", "low", "high"), [(0.0, 2.4, 3.6), (0.003, 2.4, 5.2)])
def test_the_covariance_is_honest(rng, patch_m, low, high):
    """The normalised squared error of a centre averages 3, the degrees of freedom: over 150 trials
    3 ± 0.6 (three standard errors). Also where errors are alike within patches, as those of a dense
    reconstruction are; there a part of what they share is fitted away, and standard deviations may
    come out a quarter too small (3 · 1.3² = 5.2). Taken as independent, the same errors would give
    20."""
    nees = []
    for _ in range(150):
        outward = cap(rng, 0.025, 0.35, 0.6e6)
        error = NOISE_M * rng.standard_normal(len(outward))
        if patch_m:
            owner = np.unique(np.floor(0.025 * outward / patch_m), axis=0, return_inverse=True)[
                1
            ].ravel()
            error = NOISE_M * rng.standard_normal(owner.max() + 1)[owner]
        cloud = OrientedPoints((0.025 + error)[:, None] * outward, outward, oriented=True)
        sphere = fit_sphere(cloud, np.array([1e-3, -1e-3, 1e-3]), 0.025, (0,))
        nees.append(sphere.centre_m @ np.linalg.solve(sphere.covariance_m2, sphere.centre_m))
    assert low < np.mean(nees) < high


@pytest.mark.parametrize("part", [0.15, 0.45])
def test_a_radius_that_is_not_quite_as_described_is_allowed_for(rng, part):
    """Spheres made to ± 0.2 mm: the normalised squared error averages 3 ± 1 over 60 trials (three
    standard errors). Taken as described, the same spheres would be off by 0.2 mm in depth, with
    standard deviations of 0.01 mm."""
    nees, described = [], []
    for _ in range(60):
        outward = cap(rng, 0.025, part, 0.6e6)
        made_m = 0.025 + 2e-4 * rng.standard_normal()
        cloud = OrientedPoints(
            (made_m + 1e-4 * rng.standard_normal(len(outward)))[:, None] * outward,
            outward,
            oriented=True,
        )
        sphere = fit_sphere(cloud, np.array([1e-3, -1e-3, 1e-3]), 0.025, (0,), radius_sigma_m=2e-4)
        nees.append(sphere.centre_m @ np.linalg.solve(sphere.covariance_m2, sphere.centre_m))
        sphere = fit_sphere(cloud, np.array([1e-3, -1e-3, 1e-3]), 0.025, (0,))
        described.append(sphere.centre_m @ np.linalg.solve(sphere.covariance_m2, sphere.centre_m))
    assert np.mean(nees) == pytest.approx(3, abs=1)
    assert np.mean(described) > 50


@pytest.mark.parametrize(
    ("points", "normals", "expected"),
    [
        (np.zeros((5, 3)), None, "expected [n, 3]"),
        (np.zeros((50, 2)), None, "expected [n, 3]"),
        (np.full((50, 3), np.nan), None, "NaN or infinite"),
        (np.zeros((50, 3)), np.zeros((49, 3)), "expected finite numbers of shape (50, 3)"),
        (np.zeros((50, 3)), np.full((50, 3), np.inf), "expected finite numbers"),
    ],
)
def test_a_malformed_cloud_is_refused(target, points, normals, expected):
    with pytest.raises(HandbenchError) as caught:
        find_spheres(points, normals, target)
    assert expected in str(caught.value)


def test_a_degenerate_cloud_holds_no_spheres(target):
    assert find_spheres(np.zeros((50, 3)), None, target) == []


@pytest.mark.parametrize("counts", [(9,) * 5, (9,) * 40, (2, 2, 18, 18, 18, 18)])
def test_points_that_err_alike_count_as_one(counts):
    """All points of a patch err alike: their sums vary n̄ = Σn²/Σn times as much as independent
    ones; with 3 unknowns fitted to P = (Σn)²/Σn² patches, P/(P − 3) times that."""
    counts = np.array(counts)
    patch = np.repeat(np.arange(len(counts)), counts)
    points_m = np.array([0.1, 0.0, 0.0]) * patch[:, None]
    score = np.where(patch % 2, 1e-4, -1e-4)
    patches = counts.sum() ** 2 / (counts**2).sum()
    expected = (counts**2).sum() / counts.sum() * patches / (patches - 3)
    assert _shared(points_m, score, 0.01) == pytest.approx(expected, rel=1e-12)
    assert _shared(points_m, 0 * score, 0.01) == 1.0

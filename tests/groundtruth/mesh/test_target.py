"""The target among what was photographed: synthetic clouds of a board's plate with something before
it."""

import numpy as np
import pytest
from scipy.spatial import KDTree

from handbench.groundtruth.mesh.poisson import OFF_PX, clean, keep_target, remove_board, surface
from handbench.groundtruth.mesh.surface import mesh
from tests.groundtruth.dense.test_volume import PLANE
from tests.groundtruth.mesh.test_mesh import PIXEL_M, RADIUS_M, cap, cloud_of
from tests.refusals import refuse


def plate():
    """Points of a plate at z = 0, larger than what stands on it, with a flake of 9 mm."""
    axis_m = np.arange(-0.15, 0.15, 0.7 * PIXEL_M)
    x, y = np.meshgrid(axis_m, axis_m)
    z = np.random.default_rng(1).normal(scale=0.3e-3, size=x.shape)
    z += 9e-3 * np.exp(-((x - 0.13) ** 2 + (y - 0.13) ** 2) / 3e-6)
    points_m = np.stack([x, y, z], axis=-1).reshape(-1, 3)
    return points_m, np.tile([0.0, 0.0, 1.0], (len(points_m), 1))


def test_the_target_is_kept_where_it_touches_the_board_and_that_is_the_largest_part():
    """All of it, down to the margin; Poisson runs on for 4 pixels."""
    place_m = np.array([0.0, 0.0, 0.6 * RADIUS_M])
    points_m, normals = cap(30_000, place_m, lowest=-0.95)
    front = points_m[:, 2] > 0
    noise = np.random.default_rng(2).normal(scale=0.1 * PIXEL_M, size=points_m.shape)
    parts = plate(), ((points_m + noise)[front], normals[front])
    cloud = clean(cloud_of(*(np.concatenate(column) for column in zip(*parts, strict=True))))
    cloud = remove_board(cloud, PLANE)
    found = surface(cloud)
    target = keep_target(found, PLANE, cloud.pixel_m)
    vertices_m = np.asarray(found.vertices)
    off_m = np.abs(np.linalg.norm(vertices_m - place_m, axis=1) - RADIUS_M)
    assert len(target.parts) == 1 and off_m.max() < 4.5 * PIXEL_M
    seen_m = cap(3000, place_m, lowest=-0.9)[0]
    seen_m = seen_m[seen_m[:, 2] > 1.5 * OFF_PX * PIXEL_M]
    assert KDTree(vertices_m).query(seen_m)[0].max() < 3 * PIXEL_M


def strips(counts, heights_m):
    """A mesh of separate strips of equal triangles, so many each, at their heights."""
    vertices_m, faces = [], []
    for k, (count, height_m) in enumerate(zip(counts, heights_m, strict=True)):
        faces += [[len(vertices_m) + i + step for step in range(3)] for i in range(count)]
        vertices_m += [[1e-3 * i, 0.1 * k + 1e-3 * (i % 2), height_m] for i in range(count + 2)]
    return mesh(np.array(vertices_m), np.array(faces))


def test_without_a_board_all_parts_of_a_hundredth_of_the_largest_are_kept():
    found = strips((200, 2, 1, 197), (0.0,) * 4)
    target = keep_target(found, None, 0.0)
    assert target.parts == pytest.approx((0.5, 0.4925, 0.005))
    assert target.dropped == pytest.approx(0.0025)
    assert len(found.triangles) == 399 and len(found.vertices) == 399 + 6


def test_a_part_that_stays_below_twice_the_margin_is_the_boards():
    target = keep_target(strips((200, 50, 50), (0.0099, 0.0101, 0.02)), PLANE, 0.005 / OFF_PX)
    assert target.parts == pytest.approx((1 / 6, 1 / 6)) and target.dropped == pytest.approx(2 / 3)
    low = strips((200,), (0.0099,))
    refuse(lambda: keep_target(low, PLANE, 0.005 / OFF_PX), "target", "10.0 mm")

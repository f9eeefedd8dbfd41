"""The target among what was photographed: synthetic clouds of a board's plate with something before
it."""

import numpy as np
import pytest
from scipy.spatial import KDTree

from handbench.groundtruth.mesh.mesh_files import mesh
from handbench.groundtruth.mesh.poisson import clean, surface
from handbench.groundtruth.mesh.target import OFF_PX, keep_target, remove_board
from handbench.support.errors import HandbenchError
from tests.groundtruth.dense.test_volume import PLANE
from tests.groundtruth.mesh.test_mesh import PIXEL_M, RADIUS_M, cap, cloud_of


def plate(half_m=0.15, noise_m=0.3e-3):
    """Points of a plate at z = 0, larger than everything before it, with flakes of noise up to 5 mm
    above it."""
    random = np.random.default_rng(1)
    axis = np.arange(-half_m, half_m, 0.7 * PIXEL_M)
    x, y = np.meshgrid(axis, axis)
    z = random.normal(scale=noise_m, size=x.shape)
    z += 9e-3 * (
        (np.hypot(x - 0.13, y - 0.13) < 6e-3) * np.exp(-((x - 0.13) ** 2 + (y - 0.13) ** 2) / 3e-6)
    )
    points_m = np.stack([x, y, z], axis=-1).reshape(-1, 3)
    return points_m, np.tile([0.0, 0.0, 1.0], (len(points_m), 1))


def ball(x_m, z_m, count=30_000):
    """What stands before the plate, or touches it where z_m is its radius or less."""
    points_m, normals = cap(count, centre=(x_m, 0.0, z_m), lowest=-0.95)
    noise = np.random.default_rng(2).normal(scale=0.1 * PIXEL_M, size=points_m.shape)
    front = points_m[:, 2] > 0
    return (points_m + noise)[front], normals[front]


def together(*parts):
    return clean(cloud_of(*(np.concatenate(column) for column in zip(*parts, strict=True))))


def kept(cloud):
    """Vertices and record, as the mesh stage makes them."""
    cloud = remove_board(cloud, PLANE)
    found = surface(cloud)
    target = keep_target(found, PLANE, cloud.pixel_m)
    return np.asarray(found.vertices), target


@pytest.mark.parametrize("z_m", [0.09, 0.6 * RADIUS_M], ids=["before the board", "touching it"])
def test_the_target_is_kept_where_the_board_is_the_largest_part(z_m):
    cloud = together(plate(), ball(0.0, z_m))
    vertices_m, target = kept(cloud)
    assert (
        np.abs(np.linalg.norm(vertices_m - (0, 0, z_m), axis=1) - RADIUS_M).max() < 4.5 * PIXEL_M
    )  # Poisson runs on for 4 pixels
    assert vertices_m[:, 2].max() > z_m + 0.99 * RADIUS_M
    seen = cap(3000, centre=(0.0, 0.0, z_m), lowest=-0.9)[0]
    seen = seen[seen[:, 2] > 1.5 * OFF_PX * PIXEL_M]
    assert KDTree(vertices_m).query(seen)[0].max() < 3 * PIXEL_M  # all of it, down to the margin
    assert len(target.parts) == 1


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
    with pytest.raises(HandbenchError, match=r"nothing rises more than 10\.0 mm"):
        keep_target(strips((200,), (0.0099,)), PLANE, 0.005 / OFF_PX)

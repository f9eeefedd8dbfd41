"""Fusion of depth maps made by hand: parallel cameras before a wall, whole pixels apart."""

from dataclasses import replace

import numpy as np
import pytest

from handbench.groundtruth.dense.dense import ViewDepth
from handbench.groundtruth.dense.fusion import AGREEMENT_PX, FEW_VIEWS, Cloud, fuse
from handbench.groundtruth.dense.views import View

FOCAL_PX, WALL_M = 100.0, 1.0
PIXEL_M = WALL_M / FOCAL_PX
SIZE = (12, 16)
TOWARDS = np.array([0.0, 0.0, -1.0])


def wall(i, off_m=0.0, normal=TOWARDS, size=SIZE):
    """The depth map of camera i, i pixels to the right, whose depths are `off_m` too large."""
    K = np.array([[FOCAL_PX, 0, 7], [0, FOCAL_PX, 5], [0, 0, 1]])
    depth_m = np.full(size, WALL_M + off_m)
    flat = np.zeros(size, np.float32)
    view = View(f"v{i}", flat, K, np.eye(3), np.array([-i * PIXEL_M, 0, 0]), flat, flat)
    return ViewDepth(view, depth_m, np.broadcast_to(normal, (*size, 3)).copy())


def test_points_are_means_and_spreads_are_standard_deviations(tmp_path):
    """In units of a pixel; all four agree, and those of camera 0 at pixels that all of them show.
    A kept cloud comes back."""
    offs_m = PIXEL_M * np.array([0.0, 0.3, -0.2, 0.5])
    cloud = fuse([wall(i, off_m) for i, off_m in enumerate(offs_m)])
    everyone = cloud.views.all(axis=1)
    assert everyone.sum() == 4 * SIZE[0] * (SIZE[1] - 3)
    np.testing.assert_allclose(cloud.points_m[everyone, 2], WALL_M + offs_m.mean(), rtol=1e-6)
    np.testing.assert_allclose(cloud.spread_m[everyone], offs_m.std(ddof=1), rtol=1e-9)
    np.testing.assert_allclose(cloud.normals[everyone], np.tile(TOWARDS, (everyone.sum(), 1)))
    assert cloud.names == ("v0", "v1", "v2", "v3")
    assert cloud.pixel_m == pytest.approx(PIXEL_M, rel=0.01)
    # seen by three: the offsets of the three that do
    first = (cloud.views == (False, True, True, True)).all(axis=1)
    assert first.any()
    np.testing.assert_allclose(cloud.spread_m[first], offs_m[1:].std(ddof=1), rtol=1e-9)
    cloud.save(tmp_path / "cloud.npz")
    np.testing.assert_equal(vars(Cloud.load(tmp_path / "cloud.npz")), vars(cloud))


def test_a_cloud_names_the_views_that_agree():
    """The third is farther off than AGREEMENT_PX allows, the fourth looks elsewhere: nobody agrees
    with them, nor do they with anybody; all others do where they look."""
    maps = [
        wall(0),
        wall(1),
        wall(2, 1.1 * AGREEMENT_PX * PIXEL_M),
        wall(3, 0.0, (0.9, 0.0, -(0.19**0.5))),
        wall(4),
    ]
    cloud = fuse(maps)
    assert not cloud.views[:, 2].any() and not cloud.views[:, 3].any()
    middle = np.abs(cloud.points_m[:, 0]) < 2.5 * PIXEL_M
    assert middle.sum() == 3 * 5 * SIZE[0] and cloud.views[middle][:, [0, 1, 4]].all()
    nearer = fuse([*maps[:2], wall(2, 0.9 * AGREEMENT_PX * PIXEL_M), *maps[3:]])
    assert nearer.views[:, 2].any()


def test_what_varies_from_pixel_to_pixel_is_averaged_as_a_surface_does():
    """Four walls with white noise: means of 3 × 3 pixels have a third of its standard deviation
    (noise that is the same over the whole of a map keeps all of it, above). Chance: 1500 places of
    nine pixels know a variance to 7 %."""
    size, draws = (60, 80), np.random.default_rng(5)

    def noisy(i, noise_m):
        made = wall(i, 0.0, size=size)
        made.depth_m[:] += noise_m
        return made

    sigma_m = 0.1 * PIXEL_M
    white = fuse([noisy(i, sigma_m * draws.standard_normal(size)) for i in range(4)])
    inside = (white.views.sum(axis=1) == 4) & (np.abs(white.points_m[:, 1] - 0.25) < 0.2)
    assert np.sqrt(np.mean(white.spread_m[inside] ** 2)) == pytest.approx(sigma_m / 3, rel=0.07)


def behind_the_wall(i):
    """The depth map, without known depths, of a camera that sees the wall's back."""
    made = wall(i, np.nan)
    R, t = np.diag([-1.0, 1, -1]), np.array([i * PIXEL_M, 0, 2 * WALL_M])
    return replace(made, view=replace(made.view, R=R, t=t))


def test_two_views_suffice_unless_many_could_see_a_point():
    """Views that see through the wall count; those that show something before it do not, nor do
    those that see its back."""

    def middle(*others):
        cloud = fuse([wall(0), wall(1), *others])
        return cloud.views[np.abs(cloud.points_m[:, 0]) < 2.5 * PIXEL_M]

    through = [wall(i, 0.2 * i) for i in range(1, FEW_VIEWS)]
    assert not len(middle(*through))
    hidden, averted = [wall(i, -0.1 * i) for i in range(1, 4)], [behind_the_wall(i) for i in (8, 9)]
    for others in ([], through[1:], [*through[1:], *hidden], [*through[1:], *averted]):
        views = middle(*others)
        assert len(views) == 2 * 5 * SIZE[0] and views[:, :2].all() and not views[:, 2:].any()


def test_unknown_depths_and_pictures_of_other_sizes():
    maps = [wall(0), wall(1, size=(10, 16)), wall(2, size=(12, 9))]
    maps[1].depth_m[4] = np.nan
    cloud = fuse(maps)
    assert np.isfinite(cloud.points_m).all() and np.isfinite(cloud.spread_m).all()
    row = np.round(cloud.points_m[:, 1] / PIXEL_M).astype(int) + 5
    column = np.round(cloud.points_m[:, 0] / PIXEL_M).astype(int) + 7
    assert not cloud.views[row == 4, 1].any() and not cloud.views[row >= 10, 1].any()
    assert not cloud.views[column >= 11, 2].any() and cloud.views[column < 9, 2].any()

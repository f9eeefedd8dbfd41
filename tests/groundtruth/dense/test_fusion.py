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
TOWARDS = (0.0, 0.0, -1.0)


def wall(i, off_m=0.0, normal=TOWARDS, size=SIZE):
    """The depth map of camera i, i pixels to the right, whose depths are `off_m` too large."""
    K = np.array([[FOCAL_PX, 0, 7], [0, FOCAL_PX, 5], [0, 0, 1]])
    flat = np.zeros(size, np.float32)
    view = View(f"v{i}", flat, K, np.eye(3), np.array([-i * PIXEL_M, 0, 0]), flat, flat)
    return ViewDepth(view, WALL_M + off_m + flat.astype(float), np.full((*size, 3), normal))


def in_the_middle(cloud):
    """Which points five columns of pixels show in the pictures of cameras 0 to 4."""
    return np.abs(cloud.points_m[:, 0]) < 2.5 * PIXEL_M


def test_points_are_means_and_spreads_are_standard_deviations(tmp_path):
    """In units of a pixel; all four agree, and those of camera 0 at pixels that all of them show;
    where three see a point, theirs. A kept cloud comes back."""
    offs_m = PIXEL_M * np.array([0.0, 0.3, -0.2, 0.5])
    cloud = fuse([wall(i, off_m) for i, off_m in enumerate(offs_m)])
    everyone, three = (
        cloud.views.all(axis=1),
        (cloud.views == (False, True, True, True)).all(axis=1),
    )
    assert everyone.sum() == 4 * SIZE[0] * (SIZE[1] - 3) and three.any()
    np.testing.assert_allclose(cloud.points_m[everyone, 2], WALL_M + offs_m.mean(), rtol=1e-6)
    np.testing.assert_allclose(cloud.spread_m[everyone], offs_m.std(ddof=1), rtol=1e-9)
    np.testing.assert_allclose(cloud.spread_m[three], offs_m[1:].std(ddof=1), rtol=1e-9)
    np.testing.assert_allclose(cloud.normals[everyone], np.tile(TOWARDS, (everyone.sum(), 1)))
    assert cloud.names == ("v0", "v1", "v2", "v3")
    assert cloud.pixel_m == pytest.approx(PIXEL_M, rel=0.01)
    cloud.save(tmp_path / "cloud.npz")
    np.testing.assert_equal(vars(Cloud.load(tmp_path / "cloud.npz")), vars(cloud))


@pytest.mark.parametrize(("off_px", "agrees"), [(1.1, False), (0.9, True)])
def test_a_cloud_names_the_views_that_agree(off_px, agrees):
    """The third may be farther off than AGREEMENT_PX allows, the fourth looks elsewhere: nobody
    agrees with them, nor do they with anybody; all others do where they look."""
    third = wall(2, off_px * AGREEMENT_PX * PIXEL_M)
    cloud = fuse([wall(0), wall(1), third, wall(3, 0.0, (0.9, 0.0, -(0.19**0.5))), wall(4)])
    assert cloud.views[:, 2].any() == agrees and not cloud.views[:, 3].any()
    assert cloud.views[in_the_middle(cloud)][:, [0, 1, 4]].all()


def test_what_varies_from_pixel_to_pixel_is_averaged_as_a_surface_does():
    """Four walls with white noise: means of 3 × 3 pixels have a third of its standard deviation
    (noise that is the same over the whole of a map keeps all of it, above). Chance: 1500 places of
    nine pixels know a variance to 7 %."""
    size, draws, sigma_m = (60, 80), np.random.default_rng(5), 0.1 * PIXEL_M
    maps = [wall(i, size=size) for i in range(4)]
    for made in maps:
        made.depth_m[:] += sigma_m * draws.standard_normal(size)
    white = fuse(maps)
    inside = white.views.all(axis=1) & (np.abs(white.points_m[:, 1] - 0.25) < 0.2)
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
        return cloud.views[in_the_middle(cloud)]

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
    column, row = np.round(cloud.points_m[:, :2] / PIXEL_M).astype(int).T + [[7], [5]]
    assert not cloud.views[(row == 4) | (row >= 10), 1].any()
    assert not cloud.views[column >= 11, 2].any() and cloud.views[column < 9, 2].any()

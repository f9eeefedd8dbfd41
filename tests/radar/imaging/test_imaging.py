"""Fast imaging meets its tolerance, on white noise and on a single channel, for any geometry."""

from functools import cache

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from handbench.radar.data.arrays import AntennaArray, AntennaPairs, qar50
from handbench.radar.data.grid import VoxelGrid
from handbench.radar.imaging.api import image_points, image_volume, project_volume
from handbench.radar.imaging.peaks import strongest_voxels
from handbench.radar.imaging.reference import imaging_error
from handbench.support.errors import HandbenchError
from tests.radar.direct_sums import direct_sum
from tests.radar.samples import noise, relative_error
from tests.strategies import examples

pytestmark = pytest.mark.usefixtures("planned")
PAPER_HZ = np.linspace(72e9, 82e9, 128)
FEW_HZ = PAPER_HZ[::8]


def cut(nx=41, ny=43, nz=33, x_m=0.1, y_m=-0.15) -> VoxelGrid:
    """A corner of the paper's volume, where waves come in most obliquely."""
    return VoxelGrid(
        x_m + 1e-3 * np.arange(nx), y_m + 1e-3 * np.arange(ny), 0.245 + 1e-3 * np.arange(nz)
    )


def at_random_voxels(grid: VoxelGrid, count: int = 60) -> tuple[np.ndarray, np.ndarray]:
    chosen = np.random.default_rng(2).integers(0, np.prod(grid.shape), count)
    return chosen, grid.points_m().reshape(-1, 3)[chosen]


@cache
def summed_at_random_voxels(shape: tuple[int, ...]) -> tuple[np.ndarray, np.ndarray]:
    """Places of some voxels of a cut, and the direct sums of white noise there."""
    chosen, points = at_random_voxels(cut(*shape))
    return chosen, direct_sum(noise((128, 94, 94)), PAPER_HZ, qar50(), points)


@pytest.mark.parametrize("tolerance", [1e-2, 1e-3, 1e-4, 1e-5, None])
def test_volume_of_white_noise_meets_the_tolerance(tolerance):
    shape = () if tolerance else (11, 9, 7)  # each voxel is a sum of its own on the exact path
    volume = image_volume(noise((128, 94, 94)), PAPER_HZ, qar50(), cut(*shape), tolerance)
    chosen, reference = summed_at_random_voxels(shape)
    # The exact path is a float32 sum of N terms of random sign: √N · 6e-8 of its size; 1e-5 is the
    # project's bar.
    assert relative_error(volume.ravel()[chosen], reference) < (tolerance or 1e-5)


def test_the_faces_of_a_volume_are_as_good_as_its_middle():
    """Nothing is known beyond a grid's ends, and few random voxels lie there. Reference: the direct
    sum. With the bands of the grid alone, without what chirps leak out of them, the faces' error is
    2.6e-3 here."""
    grid, samples = cut(301, 3, 81, x_m=-0.15, y_m=-0.001), noise((16, 94, 94))
    volume = image_volume(samples, FEW_HZ, qar50(), grid, 1e-5)
    face = np.ones(grid.shape, bool)
    face[3:-3, :, 3:-3] = False
    chosen = np.random.default_rng(1).choice(np.flatnonzero(face), 200, replace=False)
    reference = direct_sum(samples, FEW_HZ, qar50(), grid.points_m().reshape(-1, 3)[chosen])
    # The tolerance is the whole image's; its faces have 1.1 of it (measured).
    assert relative_error(volume.ravel()[chosen], reference) < 2e-5


@pytest.mark.parametrize("channel", [(0, 0), (46, 93), (60, 3)])
def test_one_live_channel_meets_the_tolerance(channel):
    # All the image's energy at one end of the band: what is good on average only fails here.
    samples = np.zeros((16, 94, 94), np.complex64)
    samples[:, *channel] = noise((16,))
    grid = cut()
    volume = image_volume(samples, FEW_HZ, qar50(), grid, 1e-3)
    chosen, points = at_random_voxels(grid, 300)
    assert (
        relative_error(volume.ravel()[chosen], direct_sum(samples, FEW_HZ, qar50(), points)) < 1e-3
    )


@examples(15)
@given(
    t=st.integers(1, 30),
    r=st.integers(1, 30),
    tones=st.integers(1, 12),
    size_m=st.tuples(*[st.sampled_from([0.0, 0.003, 0.02, 0.1])] * 3),
    range_m=st.sampled_from([0.1, 0.3, 1.0, 20.0]),
    tolerance=st.sampled_from([1e-2, 1e-3, 1e-4, 1e-5]),
    apart=st.booleans(),
    seed=st.integers(0, 2**31),
)
def test_points_of_any_box_and_array_meet_the_tolerance(
    t, r, tones, size_m, range_m, tolerance, apart, seed
):
    generator = np.random.default_rng(seed)
    array = AntennaArray(
        generator.uniform(-0.07, 0.07, (t, 3)), generator.uniform(-0.07, 0.07, (r, 3))
    )
    tones_hz = np.sort(generator.uniform(70e9, 85e9, tones))
    points = generator.uniform(-0.5, 0.5, (200, 3)) * size_m + [0.0, 0.05, 0.07 + range_m]
    samples = noise((tones, t, r), seed)
    image = image_points(samples, tones_hz, array, points, tolerance, apart)
    reference = direct_sum(samples, tones_hz, array, points, apart)
    # Where all points lie together, the terms may cancel there by chance: compare with the terms'
    # own size.
    size = np.linalg.norm(samples) * np.sqrt(len(points))
    assert np.linalg.norm(image - reference) < tolerance * max(np.linalg.norm(reference), size)


@examples(10)
@given(
    counts=st.tuples(*[st.integers(1, 40)] * 3),
    step_m=st.sampled_from([2e-4, 1e-3, 4e-3]),
    tolerance=st.sampled_from([1e-2, 1e-4]),
    apart=st.booleans(),
    seed=st.integers(0, 2**31),
)
def test_volumes_of_any_shape_meet_the_tolerance(counts, step_m, tolerance, apart, seed):
    generator = np.random.default_rng(seed)
    array = AntennaArray(generator.uniform(-0.1, 0.1, (9, 3)), generator.uniform(-0.1, 0.1, (8, 3)))
    tones_hz = np.sort(generator.uniform(70e9, 85e9, 5))
    # Steps of the axes differ by up to two, uneven ones included.
    x_m, y_m, z_m = (np.cumsum(step_m * generator.uniform(1, 2, n)) for n in counts)
    grid = VoxelGrid(x_m - 0.02, y_m, z_m + 0.2)
    samples = noise((5, 9, 8), seed)
    volume = image_volume(samples, tones_hz, array, grid, tolerance, apart)
    exact = image_volume(samples, tones_hz, array, grid, None, apart)
    size = np.linalg.norm(samples) * np.sqrt(volume.size)
    assert np.linalg.norm(volume - exact) < tolerance * max(np.linalg.norm(exact), size)


@pytest.mark.parametrize(
    "positions", [300, 1500]
)  # with skeletons of positions, and too many for them
def test_a_scan_meets_the_tolerance(positions):
    generator = np.random.default_rng(3)
    scan = AntennaPairs(
        *2 * [np.c_[generator.uniform(-0.1, 0.1, (positions, 2)), np.zeros(positions)]]
    )
    tones_hz, samples = np.linspace(22.2e9, 26.2e9, 11), noise((11, positions))
    grid = VoxelGrid(2e-3 * np.arange(30), 2e-3 * np.arange(25), 0.07 + 1e-3 * np.arange(20))
    chosen, points = at_random_voxels(grid)
    volume = image_volume(samples, tones_hz, scan, grid, 1e-3)
    assert (
        relative_error(volume.ravel()[chosen], direct_sum(samples, tones_hz, scan, points)) < 1e-3
    )


def test_projection_equals_the_volume_s():
    grid, samples = cut(), noise((16, 94, 94))
    index, magnitude = project_volume(samples, FEW_HZ, qar50(), grid, 1e-3)
    volume = image_volume(samples, FEW_HZ, qar50(), grid, 1e-3)
    strongest, expected = strongest_voxels(volume)
    assert np.array_equal(strongest, np.abs(volume).argmax(axis=0))
    assert np.array_equal(index, strongest)
    np.testing.assert_allclose(
        magnitude, expected, rtol=1e-5
    )  # float32: with and without the carrier
    assert np.isnan(magnitude[0][index == 0]).all()


def test_the_check_after_the_fact_finds_a_wrong_volume():
    grid, samples = cut(), noise((16, 94, 94))
    volume = image_volume(samples, FEW_HZ, qar50(), grid, 1e-3)
    assert imaging_error(volume, samples, FEW_HZ, qar50(), grid) < 1e-3
    assert imaging_error(1.01 * volume, samples, FEW_HZ, qar50(), grid) == pytest.approx(
        0.01, rel=0.2
    )


def test_volumes_beyond_the_memory_limit_are_refused_and_projected_all_the_same(monkeypatch):
    monkeypatch.setenv("HANDBENCH_MEMORY_GB", "0.005")
    fine = VoxelGrid(2e-4 * np.arange(200), 2e-4 * np.arange(150), 0.25 + 2e-4 * np.arange(100))
    samples = noise((16, 94, 94))
    with pytest.raises(
        HandbenchError, match=r"needs 0\.024 GB.*more than the 0\.005 GB.*steps larger"
    ):
        image_volume(samples, FEW_HZ, qar50(), fine, 1e-3)
    assert project_volume(samples, FEW_HZ, qar50(), fine, 1e-3)[0].shape == fine.shape[1:]
    monkeypatch.setenv("HANDBENCH_MEMORY_GB", "0.00001")
    with pytest.raises(HandbenchError, match=r"grid of \(100, 150, 200\) voxels.*the 1e-05 GB"):
        project_volume(samples, FEW_HZ + 1, qar50(), fine, 1e-3)
    monkeypatch.setenv("HANDBENCH_MEMORY_GB", "much")
    with pytest.raises(HandbenchError, match="HANDBENCH_MEMORY_GB: is 'much'"):
        image_volume(samples, FEW_HZ, qar50(), fine, 1e-3)


@pytest.mark.parametrize("tolerance", [0.0, 1e-9, 0.5, float("nan")])
def test_a_tolerance_that_cannot_be_met_is_refused(tolerance):
    with pytest.raises(HandbenchError, match=r"expected 1e-06 to 0\.1"):
        image_points(noise((16, 94, 94)), FEW_HZ, qar50(), np.zeros((1, 3)) + 0.3, tolerance)


def test_points_metres_apart_do_not_plan_what_lies_between_them():
    samples = noise((16, 94, 94))
    points = np.array([[0.0, 0.0, 0.3], [3.0, 0.1, 0.4], [0.01, 0.0, 0.31], [-2.0, 9.0, 30.0]])
    reference = direct_sum(samples, FEW_HZ, qar50(), points)
    assert (
        relative_error(image_points(samples, FEW_HZ, qar50(), points, 1e-3), reference) < 2e-3
    )  # four points only


def test_no_points_make_no_image():
    assert image_points(
        noise((2, 94, 94)), FEW_HZ[:2], qar50(), np.zeros((0, 3)), 1e-3, per_tone=True
    ).shape == (2, 0)

"""Fast imaging meets its tolerance, on white noise and on a single channel, for any geometry."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from handbench.radar.data.arrays import AntennaArray, AntennaPairs, qar50
from handbench.radar.data.grid import VoxelGrid
from handbench.radar.imaging.api import image_points, image_volume, project_volume
from handbench.radar.imaging.device import strongest_voxels
from handbench.radar.imaging.exact import imaging_error
from tests.radar.direct_sums import direct_sum
from tests.radar.samples import noise, relative_error
from tests.refusals import refuse
from tests.strategies import examples

pytestmark = pytest.mark.usefixtures("planned")
PAPER_HZ = np.linspace(72e9, 82e9, 128)
FEW_HZ = PAPER_HZ[::8]
NOISE = noise((16, 94, 94))


def cut(nx=41, ny=43, nz=33, x_m=0.1, y_m=-0.15) -> VoxelGrid:
    """A corner of the paper's volume, where waves come in most obliquely."""
    starts_m, counts = (x_m, y_m, 0.245), (nx, ny, nz)
    return VoxelGrid(
        *(start_m + 1e-3 * np.arange(n) for start_m, n in zip(starts_m, counts, strict=True))
    )


def error(volume, samples, tones_hz, aperture, grid, chosen=None) -> float:
    """Relative error of a volume at chosen voxels, or at 60 random ones."""
    if chosen is None:
        chosen = np.random.default_rng(2).integers(0, volume.size, 60)
    reference = direct_sum(samples, tones_hz, aperture, grid.points_at_m(chosen))
    return relative_error(volume.ravel()[chosen], reference)


@pytest.mark.parametrize("tolerance", [1e-2, 1e-3, 1e-4, 1e-5, None])
def test_volume_of_white_noise_meets_the_tolerance(tolerance):
    """The exact path is a float32 sum of N terms of random sign: √N · 6e-8 of its size; 1e-5 is the
    project's bar."""
    # each voxel is a sum of its own on the exact path
    grid, samples = cut() if tolerance else cut(11, 9, 7), noise((128, 94, 94))
    volume = image_volume(samples, PAPER_HZ, qar50(), grid, tolerance)
    assert error(volume, samples, PAPER_HZ, qar50(), grid) < (tolerance or 1e-5)


def test_the_faces_of_a_volume_are_as_good_as_its_middle():
    """Nothing is known beyond a grid's ends, and few random voxels lie there. With the bands of the
    grid alone, without what chirps leak out of them, the faces' error is 2.6e-3 here."""
    grid = cut(301, 3, 81, x_m=-0.15, y_m=-0.001)
    volume = image_volume(NOISE, FEW_HZ, qar50(), grid, 1e-5)
    face = np.ones(grid.shape, bool)
    face[3:-3, :, 3:-3] = False
    chosen = np.random.default_rng(1).choice(np.flatnonzero(face), 200, replace=False)
    # The tolerance is the whole image's; its faces have 1.1 of it (measured).
    assert error(volume, NOISE, FEW_HZ, qar50(), grid, chosen) < 2e-5


@pytest.mark.parametrize("channel", [(0, 0), (46, 93), (60, 3)])
def test_one_live_channel_meets_the_tolerance(channel):
    """All the image's energy is at one end of the band: what is good on average only fails here."""
    samples = np.zeros_like(NOISE)
    samples[:, *channel] = noise((16,))
    volume = image_volume(samples, FEW_HZ, qar50(), cut(), 1e-3)
    assert error(volume, samples, FEW_HZ, qar50(), cut()) < 1e-3


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
    array = AntennaArray(*(generator.uniform(-0.07, 0.07, (n, 3)) for n in (t, r)))
    tones_hz = np.sort(generator.uniform(70e9, 85e9, tones))
    points_m = generator.uniform(-0.5, 0.5, (200, 3)) * size_m + [0.0, 0.05, 0.07 + range_m]
    samples = noise((tones, t, r), seed)
    image = image_points(samples, tones_hz, array, points_m, tolerance, apart)
    reference = direct_sum(samples, tones_hz, array, points_m, apart)
    # Where all points lie together, the terms may cancel there by chance: compare with the terms'
    # own size.
    size = np.linalg.norm(samples) * np.sqrt(len(points_m))
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
    array = AntennaArray(*(generator.uniform(-0.1, 0.1, (n, 3)) for n in (9, 8)))
    tones_hz = np.sort(generator.uniform(70e9, 85e9, 5))
    # Steps of the axes differ by up to two, uneven ones included.
    x_m, y_m, z_m = (np.cumsum(step_m * generator.uniform(1, 2, n)) for n in counts)
    grid, samples = VoxelGrid(x_m - 0.02, y_m, z_m + 0.2), noise((5, 9, 8), seed)
    volume, exact = (
        image_volume(samples, tones_hz, array, grid, t, apart) for t in (tolerance, None)
    )
    size = np.linalg.norm(samples) * np.sqrt(volume.size)
    assert np.linalg.norm(volume - exact) < tolerance * max(np.linalg.norm(exact), size)


@pytest.mark.parametrize("receivers", [0.0, 0.01])
@pytest.mark.parametrize("count", [300, 1500])
def test_a_scan_meets_the_tolerance(count, receivers):
    """With skeletons of its positions, and with too many for them; of one antenna, and of two."""
    places_m = np.random.default_rng(3).uniform(-0.1, 0.1, (count, 3)) * [1, 1, 0]
    scan = AntennaPairs(places_m, places_m + receivers)
    tones_hz, samples = np.linspace(22.2e9, 26.2e9, 11), noise((11, count))
    grid = VoxelGrid(2e-3 * np.arange(30), 2e-3 * np.arange(25), 0.07 + 1e-3 * np.arange(20))
    volume = image_volume(samples, tones_hz, scan, grid, 1e-3)
    assert error(volume, samples, tones_hz, scan, grid) < 1e-3


def test_projection_equals_the_volume_s():
    index, magnitude = project_volume(NOISE, FEW_HZ, qar50(), cut(), 1e-3)
    volume = image_volume(NOISE, FEW_HZ, qar50(), cut(), 1e-3)
    strongest, expected = strongest_voxels(volume.real, volume.imag)
    np.testing.assert_array_equal(strongest, np.abs(volume).argmax(axis=0))
    np.testing.assert_array_equal(index, strongest)
    # float32: with and without the carrier
    np.testing.assert_allclose(magnitude, expected, rtol=1e-5)
    np.testing.assert_allclose(magnitude[1], np.abs(volume).max(axis=0), rtol=1e-5)
    assert np.isnan(magnitude[0][index == 0]).all()


def test_the_check_after_the_fact_finds_a_wrong_volume():
    volume = image_volume(NOISE, FEW_HZ, qar50(), cut(), 1e-3)
    errors = [imaging_error(by * volume, NOISE, FEW_HZ, qar50(), cut()) for by in (1, 1.01)]
    assert errors[0] < 1e-3
    assert errors[1] == pytest.approx(0.01, rel=0.2)


def test_volumes_beyond_the_memory_limit_are_refused_and_projected_all_the_same(monkeypatch):
    monkeypatch.setenv("HANDBENCH_MEMORY_GB", "0.005")
    fine = VoxelGrid(2e-4 * np.arange(200), 2e-4 * np.arange(150), 0.25 + 2e-4 * np.arange(100))
    refuse(lambda: image_volume(NOISE, FEW_HZ, qar50(), fine, 1e-3), "0.024 GB", "0.005 GB")
    assert project_volume(NOISE, FEW_HZ, qar50(), fine, 1e-3)[0].shape == fine.shape[1:]
    monkeypatch.setenv("HANDBENCH_MEMORY_GB", "0.00001")
    refuse(lambda: project_volume(NOISE, FEW_HZ + 1, qar50(), fine, 1e-3), "1e-05 GB")
    monkeypatch.setenv("HANDBENCH_MEMORY_GB", "much")
    refuse(lambda: image_volume(NOISE, FEW_HZ, qar50(), fine, 1e-3), "HANDBENCH_MEMORY_GB", "much")


def test_points_metres_apart_do_not_plan_what_lies_between_them():
    points_m = np.array([[0.0, 0.0, 0.3], [3.0, 0.1, 0.4], [0.01, 0.0, 0.31], [-2.0, 9.0, 30.0]])
    image = image_points(NOISE, FEW_HZ, qar50(), points_m, 1e-3)
    # twice the tolerance: four points only
    assert relative_error(image, direct_sum(NOISE, FEW_HZ, qar50(), points_m)) < 2e-3

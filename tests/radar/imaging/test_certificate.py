"""A certificate is no smaller than the error it certifies. Reference: the sum as it stands, in
float64."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from handbench.radar.data.arrays import AntennaArray, PlanarScan, qar50
from handbench.radar.data.grid import VoxelGrid
from handbench.radar.imaging.api import image_points, image_volume, project_volume
from handbench.radar.imaging.certificate import FACTOR, certified
from handbench.radar.imaging.cpu.exact import exact_sums
from tests.radar.direct_sums import direct_echoes, direct_sum
from tests.radar.samples import noise, relative_error
from tests.strategies import examples

pytestmark = pytest.mark.usefixtures("planned")

TONES_HZ = np.linspace(72e9, 82e9, 5)
MOST = 2 * FACTOR  # looser than this, a certificate says little


def random_array(generator, t, r):
    return AntennaArray(
        generator.uniform(-0.07, 0.07, (t, 3)), generator.uniform(-0.07, 0.07, (r, 3))
    )


def echoes_of(kind, generator, array, grid, tolerance):
    """Echoes that a tolerance finds easy (noise) or hardest: what the fast image itself gets wrong,
    over and over. Hard cases have leaks, targets outside and single channels."""
    samples = noise((len(TONES_HZ), *array.channels), int(generator.integers(1 << 30)))
    points_m = grid.points_m().reshape(-1, 3)
    for _ in range(3 if kind == "made" else 0):
        fast = image_volume(samples, TONES_HZ, array, grid, tolerance).reshape(1, -1)
        made = direct_echoes(
            points_m, (fast - exact_sums(samples, TONES_HZ, array, points_m))[0], TONES_HZ, array
        )
        samples = (made / (np.abs(made).max() or 1.0)).astype(np.complex64)
    return samples


@examples(20)
@given(
    kind=st.sampled_from(["noise", "made"]),
    t=st.integers(2, 20),
    r=st.integers(2, 20),
    tolerance=st.sampled_from([1e-2, 1e-3, 1e-4, 1e-5]),
    counts=st.tuples(*[st.integers(2, 20)] * 3),
    apart=st.booleans(),
    seed=st.integers(0, 2**31),
)
def test_no_error_is_above_its_certificate(kind, t, r, tolerance, counts, apart, seed):
    generator = np.random.default_rng(seed)
    array = random_array(generator, t, r)
    grid = VoxelGrid(
        *(low + 0.004 * np.arange(n) for low, n in zip((-0.05, 0.0, 0.25), counts, strict=True))
    )
    samples = echoes_of(kind, generator, array, grid, tolerance)
    with certified() as certificate:
        volume = image_volume(samples, TONES_HZ, array, grid, tolerance, apart).reshape(
            5 if apart else 1, -1
        )
    exact = exact_sums(samples, TONES_HZ, array, grid.points_m().reshape(-1, 3), apart)
    errors = [relative_error(image, true) for image, true in zip(volume, exact, strict=True)]
    assert max(errors) <= certificate.bound <= MOST * max(errors)


def test_the_sum_in_float64_is_right_to_its_last_digits():
    uneven_hz = np.sort(np.random.default_rng(1).uniform(72e9, 82e9, 40))
    points = np.array([[0.01, 0.02, 0.3], [-0.1, 0.05, 1.0]])
    repeated_hz = np.r_[
        [80e9] * 3, np.linspace(82e9, 72e9, 29), [81e9] * 8
    ]  # more than once, descending
    for tones_hz in (np.linspace(72e9, 82e9, 40), uneven_hz, repeated_hz):
        samples = noise((40, 94, 94))
        off = exact_sums(samples, tones_hz, qar50(), points)[0] - direct_sum(
            samples, tones_hz, qar50(), points
        )
        assert np.abs(off).max() < 1e-12 * np.abs(samples).sum()


@pytest.mark.parametrize("plane", [False, True])
def test_projections_planes_and_points_are_certified_too(plane):
    grid = VoxelGrid(
        0.002 * np.arange(40), 0.002 * np.arange(50), 0.3 + 0.002 * np.arange(1 if plane else 20)
    )
    samples, scan = (
        noise((5, 94, 94)),
        PlanarScan(np.random.default_rng(0).uniform(-0.1, 0.1, (60, 3)) * [1, 1, 0]),
    )
    with certified() as certificate:
        project_volume(samples, TONES_HZ, qar50(), grid, 1e-3)
        image_points(samples, TONES_HZ, qar50(), grid.points_m(), 1e-3)
        image_volume(noise((5, 60)), TONES_HZ, scan, grid, 1e-3)
    assert certificate.images == 3 and 1e-5 < certificate.bound < 1e-2


def test_an_exact_image_is_certified_to_single_precision_and_an_empty_one_to_nothing():
    grid = VoxelGrid(0.002 * np.arange(9), 0.002 * np.arange(9), 0.3 + 0.002 * np.arange(9))
    with certified() as certificate:
        image_volume(noise((5, 94, 94)), TONES_HZ, qar50(), grid, None)
    assert 0 < certificate.bound < 1e-5  # √N · 6e-8 for N terms of random sign, times FACTOR
    with certified() as certificate:
        image_volume(np.zeros((5, 94, 94), np.complex64), TONES_HZ, qar50(), grid, 1e-3)
    assert certificate.bound == 0

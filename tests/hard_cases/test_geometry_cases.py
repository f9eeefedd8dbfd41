"""Hard geometry: voxels on and behind the array, lone antennas and voxels, far origins, long
ranges, many tones; and what has no answer.

Every sweep is imaged exactly and to each tolerance, on white noise, and compared with the direct
sum in balls, by a relative L2 error over the points and a few draws of samples. A tolerance is a
promise; the exact sum's waves are off by 4·2⁻²⁴ each, its sums of N terms of random sign in single
precision by √N·2⁻²⁴, its paths by three roundings in double precision a leg.
"""

import numpy as np
import pytest

from handbench.radar.data.arrays import AntennaArray
from handbench.radar.data.grid import VoxelGrid
from handbench.radar.imaging.api import image_points, image_volume
from handbench.radar.simulation.forward import Scatterers, simulate
from tests.radar.samples import always_planned, noise
from tests.references.balls import LIGHT_M_S, U_SINGLE, U, echoes, images, middles, off
from tests.refusals import refuse

TONES_HZ = np.linspace(72e9, 82e9, 9)
STEER = 4 * U_SINGLE  # of a wave: its phase rounds to π/2 U, cosine and sine to 2 U
TOLERANCES = (None, 1e-2, 1e-3, 1e-4, 1e-5, 1e-6)
LINE_M = np.linspace(-0.07, 0.07, 30)[:, None] * [1, 0, 0]
UP_M = 1e-3 * np.arange(9)
NOWHERE = (-np.inf, np.inf, np.nan, 1e300, 1.1e7)


def plate(t=12, r=10):
    """Antennas anywhere on a plate of 14 cm."""
    places = np.random.default_rng(0).uniform(-0.07, 0.07, (t + r, 3)) * [1, 1, 0]
    return AntennaArray(places[:t], places[t:])


PLATE = plate()


def cloud(z_m, half_m=0.015, count=40):
    """Points [count, 3] within half_m of a place on the axis, metres."""
    return np.random.default_rng(1).uniform(-half_m, half_m, (count, 3)) + [0, 0, z_m]


@pytest.fixture
def promised(within):
    """Assert that what is made to each tolerance is as near to the balls as was asked."""

    def check(make, expected, terms, range_m, tones_hz=TONES_HZ, least=0.0, tolerances=TOLERANCES):
        paths = 2 * np.pi * np.abs(tones_hz).max() / LIGHT_M_S * 2 * range_m * 3 * U
        exact = 2 * STEER + np.sqrt(terms) * U_SINGLE + paths
        size = max(np.linalg.norm(middles(expected)), least)
        for tolerance in tolerances:
            error = np.linalg.norm(off(make(tolerance), expected)) / size
            place = f"tolerance {tolerance}"
            within(error / (tolerance or exact), 1, "of what was asked", place)

    return check


@pytest.fixture
def imaged(promised):
    """Assert that images of points are as near as was asked; draws: of samples over which the error
    is taken, for few points need many."""

    def check(points_m, array=PLATE, tones_hz=TONES_HZ, draws=3, **asked):
        samples = [noise((len(tones_hz), *array.channels), n) for n in range(draws)]
        expected = images(np.array(samples), array, tones_hz, points_m)
        range_m = np.ptp([*points_m, *array.tx_m], axis=0).max()

        def make(tolerance):
            with always_planned():
                return [image_points(s, tones_hz, array, points_m, tolerance) for s in samples]

        terms = 2 * sum(array.channels) + len(tones_hz)
        promised(make, expected, terms, range_m, tones_hz, **asked)

    return check


@pytest.mark.parametrize("z_m", [0.3, 0.05, 1e-2, 1e-3, 0.0, -1e-3, -0.3])
def test_images_of_voxels_through_the_array(z_m, imaged):
    """Where waves are chirps, R down to 0 and behind."""
    imaged(cloud(z_m) * [1, 1, z_m != 0])


@pytest.mark.parametrize("height_m", [1e-3, 1e-5, 1e-6, 1e-9, 0.0])
def test_images_of_voxels_on_antennas(height_m, imaged):
    """At the kink of |p − a|: above every antenna, and about one."""
    imaged(np.concatenate([PLATE.tx_m, PLATE.rx_m]) + [0, 0, height_m])
    imaged(PLATE.tx_m[0] + cloud(0, height_m))


@pytest.mark.parametrize(
    ("array", "points_m"),
    [
        (plate(1, 1), cloud(0.3)),
        (plate(1, 10), cloud(0.3)),
        (plate(12, 1), cloud(0.3)),
        (AntennaArray(LINE_M, LINE_M), cloud(0.3)),
        (AntennaArray(LINE_M, LINE_M), np.linspace(-4, 4, 60)[:, None] * LINE_M[0]),
        (AntennaArray(0 * LINE_M, 0 * LINE_M), cloud(0.3)),
    ],
    ids=["1 x 1", "1 x 10", "12 x 1", "on a line", "voxels on that line", "all in one place"],
)
def test_images_of_few_collinear_and_coincident_antennas(array, points_m, imaged):
    """Whose waves are all equal."""
    imaged(points_m, array)


@pytest.mark.parametrize("offset_m", [1e3, 1e6, 9e6])
@pytest.mark.parametrize("way", [(1, 0, 0), (0, 0, 1), (1, -1, 1)], ids=str)
def test_images_far_from_the_origin(way, offset_m, imaged):
    """Scene and array moved together."""
    shift_m = offset_m * np.array(way)
    array = AntennaArray(PLATE.tx_m + shift_m, PLATE.rx_m + shift_m)
    imaged(cloud(0.3) + shift_m, array)


@pytest.mark.parametrize(
    ("range_m", "half_m"),
    [(20, 0.05), (20, 1e-3), (100, 5e-3), (1e3, 1e-3), (1e3, 0.05), (1e5, 0.05), (1e6, 0.05)],
)
def test_images_at_long_ranges(range_m, half_m, imaged):
    """Whose phase is 10⁴ to 10⁹ turns."""
    imaged(cloud(range_m, half_m), draws=6)


@pytest.mark.parametrize(
    "tones_hz",
    [
        TONES_HZ[:1],
        np.full(9, 80e9),
        80e9 + np.arange(9.0),
        TONES_HZ[::-1].copy(),
        np.geomspace(1e6, 1e12, 9),
    ],
    ids=["one tone", "equal tones", "1 Hz apart", "descending", "six decades"],
)
def test_images_of_tones_of_every_kind(tones_hz, imaged):
    """Skeletons of tones that are all equal."""
    imaged(cloud(0.3), tones_hz=tones_hz)


def test_images_of_4096_uneven_tones(imaged):
    """Without a drift along the tones."""
    tones_hz = np.random.default_rng(2).uniform(72e9, 82e9, 4096)
    imaged(cloud(0.3, count=4), plate(3, 2), tones_hz, draws=1, tolerances=(None, 1e-5))


def uneven(seed, count):
    return np.cumsum(10 ** np.random.default_rng(seed).uniform(-5, -2.5, count))


TWO_HEAPS_M = np.r_[1e-5 * np.arange(40), 0.1 + 1e-5 * np.arange(40)]
GRIDS = {
    "steps from 10 um to 3 mm": (uneven(3, 40) - 0.02, uneven(4, 12), 0.3 + uneven(5, 24)),
    "two heaps 10 cm apart": (TWO_HEAPS_M, UP_M[:4], 0.3 + TWO_HEAPS_M[::3]),
    "every voxel twice": (np.repeat(2e-4 * np.arange(40), 2), UP_M, np.array([0.3, 0.3])),
    "through the array": tuple(2e-3 * np.arange(-n, n) for n in (8, 6, 5)),
    "steps of 1e-09 m": tuple(1e-9 * np.arange(n) for n in (40, 12, 20)),
    "one row": (1e-3 * np.arange(30), UP_M[:1], UP_M[:1] + 0.3),
    "one column of depths": (UP_M[:1], UP_M[:1], 0.3 + 1e-3 * np.arange(30)),
}


@pytest.mark.parametrize("name", GRIDS)
def test_volumes_of_uneven_and_tiny_grids(name, promised):
    """By interpolation between nodes."""
    grid, samples = VoxelGrid(*GRIDS[name]), noise((len(TONES_HZ), *PLATE.channels))
    points_m = grid.points_m().reshape(-1, 3)
    chosen = np.random.default_rng(4).integers(0, len(points_m), 60)
    [expected] = images(samples[None], PLATE, TONES_HZ, points_m[chosen])

    def make(tolerance):
        return image_volume(samples, TONES_HZ, PLATE, grid, tolerance).ravel()[chosen]

    terms = 2 * sum(PLATE.channels) + len(TONES_HZ)
    least = np.linalg.norm(samples) * np.sqrt(len(chosen))  # they may cancel by chance
    promised(make, expected, terms, 0.5, least=least)


WIDE = plate(40, 40)
CLOSE = {f"z = {z_m} m": cloud(0) * [1, 1, 0.02] + [0, 0, z_m] for z_m in (0.3, 0.03, 3e-3, 1e-3)}
CLOSE |= {
    f"{r_m} m above antennas": WIDE.tx_m[:3] + [0, 0, r_m] for r_m in (1e-3, 1e-6, 1e-12, 1e-24)
}
CLOSE |= {"range 1e5 m": cloud(1e5), "behind the array": cloud(-0.3)}


@pytest.mark.parametrize("name", CLOSE)
def test_echoes_of_points_close_to_antennas(name, promised):
    """Which fade as 1/R, R → 0."""
    points_m = CLOSE[name]
    weights = np.random.default_rng(5).standard_normal(len(points_m))
    scatterers = Scatterers(points_m, weights)
    promised(
        lambda tolerance: simulate(scatterers, TONES_HZ, WIDE, tolerance=tolerance),
        echoes(weights, WIDE, TONES_HZ, points_m),
        2 * len(points_m),
        np.abs(points_m).max(),
        tolerances=(None, 1e-2, 1e-3, 1e-5),
    )


@pytest.mark.parametrize("tolerance", [1e-5, None])
def test_a_scatterer_on_an_antenna_has_no_echo(tolerance):
    """1/R has no value at R = 0: an echo of NaN would spoil all samples."""
    point = Scatterers(PLATE.tx_m[4:5], np.ones(1))
    refuse(lambda: simulate(point, TONES_HZ, PLATE, tolerance=tolerance), "scatterers", "antenna")


@pytest.mark.parametrize("value", NOWHERE)
def test_voxels_and_antennas_at_no_place_have_no_phase(value):
    """An image of NaN, or a search for their neighbours without an end; beyond 10⁷ m float64 rounds
    paths to more than a phase of 1e-5 rad can bear."""
    points_m = cloud(0.3)
    points_m[3, 1] = value
    samples = noise((len(TONES_HZ), *PLATE.channels))
    for tolerance in (1e-3, None):
        refuse(lambda t=tolerance: image_points(samples, TONES_HZ, PLATE, points_m, t), "points_m")
    refuse(lambda: AntennaArray(points_m, PLATE.rx_m), "tx_m")


@pytest.mark.parametrize(
    "axis", [UP_M[:0], np.r_[UP_M, 0.0], UP_M[::-1], np.r_[UP_M, np.nan]], ids=str
)
def test_axes_that_do_not_ascend_have_no_nodes(axis):
    """Nodes are counted from the first voxel to the last."""
    refuse(lambda: VoxelGrid(axis, UP_M, 0.3 + UP_M), "x_m")

"""Images of captures that lack pairs, of lists of pairs and of waves in a medium, against sums
written here: over the pairs that are there, with the wave's own speed, in float64 (an independent
reference: it shares no code with radar)."""

import numpy as np
import pytest

from handbench.radar.data.arrays import AntennaArray, BistaticScan, PlanarScan, qar50
from handbench.radar.data.capture import RadarCapture
from handbench.radar.data.grid import Axis, VoxelGrid
from handbench.radar.imaging.api import image_points, image_volume, project_volume
from handbench.radar.imaging.certificate import certified
from handbench.radar.imaging.plan import SCAN
from handbench.radar.methods.fsk import path_rise
from handbench.radar.methods.registry import method
from tests.radar.samples import noise, relative_error

pytestmark = pytest.mark.usefixtures("planned")

C = 299_792_458.0
SINGLE = 3e-6  # relative error of sums in single precision, several times what was measured
ARRAY = qar50()
HEARD = np.random.default_rng(5).random(ARRAY.channels) > 0.3  # 30 % of the pairs missing at random
TONES_HZ = np.array([82e9, 81.8e9, 79.5e9])


def plain_sum(samples, tones_hz, tx_m, rx_m, pairs, points_m, speed_m_s=C):
    """Σ over tones apart [f, points] and pairs of s · exp(j2πf(|p − t| + |p − r|)/v): the formula
    as it stands."""
    images = np.zeros((len(tones_hz), len(points_m)), np.complex128)
    for t, r in pairs:
        path_m = np.linalg.norm(points_m - tx_m[t], axis=1) + np.linalg.norm(
            points_m - rx_m[r], axis=1
        )
        for f, tone_hz in enumerate(tones_hz):
            images[f] += samples[f, t, r] * np.exp(2j * np.pi * tone_hz * path_m / speed_m_s)
    return images


def echo(point_m, tones_hz, tx_m, rx_m, speed_m_s=C):
    """Samples [f, t, r] of a point, by the convention of docs/conventions.md."""
    path_m = np.linalg.norm(point_m - tx_m, axis=1)[:, None] + np.linalg.norm(
        point_m - rx_m, axis=1
    )
    return np.exp(-2j * np.pi * np.asarray(tones_hz)[:, None, None] * path_m / speed_m_s)


@pytest.mark.parametrize("tolerance", [None, 1e-3, 1e-5])
def test_points_and_volumes_are_sums_over_the_pairs_that_are_there(tolerance):
    """White noise, the hardest samples; direct and planned; the error is the tolerance or single
    precision."""
    samples = np.where(HEARD, noise((3, *ARRAY.channels)), 0)
    array = AntennaArray(ARRAY.tx_m, ARRAY.rx_m, HEARD)
    grid = VoxelGrid(
        1e-3 * np.arange(-20, 20), 1e-3 * np.arange(-15, 15), 0.3 + 1e-3 * np.arange(4)
    )
    volume = image_volume(samples, TONES_HZ, array, grid, tolerance)
    some = np.random.default_rng(0).integers(0, volume.size, 60)
    points = grid.points_at_m(some)
    expected = plain_sum(samples, TONES_HZ, ARRAY.tx_m, ARRAY.rx_m, np.argwhere(HEARD), points)
    assert relative_error(volume.ravel()[some], expected.sum(axis=0)) < (tolerance or SINGLE)
    assert relative_error(
        image_points(samples, TONES_HZ, array, points, tolerance, apart=True), expected
    ) < (tolerance or SINGLE)
    assert (
        relative_error(
            image_points(noise((3, *ARRAY.channels)), TONES_HZ, array, points, None),
            expected.sum(0),
        )
        > 0.1
    )


@pytest.mark.parametrize(
    "id", ["2fsk", "3fsk", "nfsk", "joint", "prior-2fsk", "broadband", "narrowband"]
)
@pytest.mark.parametrize("tolerance", [None, 1e-4])
def test_every_method_finds_a_point_without_three_tenths_of_the_pairs(id, tolerance):
    point_m, tones_hz = (
        np.array([0.004, -0.003, 0.29]),
        np.unique([*np.linspace(72e9, 82e9, 26), 81.3e9, 80.5e9, 77e9, 81.8e9, 79.5e9]),
    )
    samples = np.where(HEARD, echo(point_m, tones_hz, ARRAY.tx_m, ARRAY.rx_m), 0)[None].astype(
        np.complex64
    )
    capture = RadarCapture(samples, tones_hz, AntennaArray(ARRAY.tx_m, ARRAY.rx_m, HEARD))
    chosen = method(id)
    values = {
        "x": Axis(start_m=-0.01, stop_m=0.01, step_m=1e-3),
        "y": Axis(start_m=-0.01, stop_m=0.01, step_m=1e-3),
    }
    values |= {"tolerance": tolerance} | ({"count": 26} if id == "broadband" else {})
    depth = chosen.run(capture, chosen.configure(values, "test"), 0).depth
    row, column = np.unravel_index(depth.amplitude_db.argmax(), depth.z_m.shape)
    assert (depth.x_m[column], depth.y_m[row]) == pytest.approx(point_m[:2], abs=1e-9)
    # Voxels are 1 mm apart; 2-FSK errs by 2 mm in focus, for the paper takes the path's slope as 2.
    assert depth.z_m[row, column] == pytest.approx(point_m[2], abs={"2fsk": 4e-3}.get(id, 1e-3))


def test_fsk_s_depths_are_those_of_the_sum_over_the_pairs_that_are_there():
    """2-FSK by its formula in the paper on float64 images of the plane that it ends at."""
    point_m = np.array([0.004, -0.003, 0.29])
    samples = np.where(HEARD, echo(point_m, TONES_HZ, ARRAY.tx_m, ARRAY.rx_m), 0)
    along = np.arange(-5, 6) * 1e-3
    axis = Axis(start_m=-0.005, stop_m=0.005, step_m=1e-3)
    chosen = method("2fsk")
    capture = RadarCapture(
        samples[None].astype(np.complex64), TONES_HZ, AntennaArray(ARRAY.tx_m, ARRAY.rx_m, HEARD)
    )
    depth = chosen.run(
        capture, chosen.configure({"x": axis, "y": axis, "tolerance": 1e-5}, "test"), 0
    ).depth
    z_e, pairs = 0.45, np.argwhere(HEARD)
    x, y = (part.ravel() for part in np.meshgrid(along, along))
    for _ in range(2):
        images = plain_sum(
            samples[:2],
            TONES_HZ[:2],
            ARRAY.tx_m,
            ARRAY.rx_m,
            pairs,
            np.stack([x, y, 0 * x + z_e], 1),
        )
        phase = np.angle(images[1] * images[0].conj())
        z_m = z_e - C * phase / (4 * np.pi * (TONES_HZ[1] - TONES_HZ[0]))
        z_e = z_m[np.abs(images).mean(axis=0).argmax()]
    seen = np.isfinite(depth.z_m.ravel())
    assert seen.sum() > 15
    # A tolerance of 1e-5 against images up to 10 dB below the peak turns φ by some 1e-4 rad: 2e-5 m
    # at 200 MHz.
    np.testing.assert_allclose(depth.z_m.ravel()[seen], z_m[seen], atol=2e-5)


@pytest.mark.parametrize("tolerance", [None, 1e-3])
def test_a_list_of_pairs_is_summed_pair_by_pair(tolerance):
    generator = np.random.default_rng(1)
    tx_m = np.c_[generator.uniform(-0.05, 0.05, (40, 2)), np.zeros(40)]
    rx_m, pairs = tx_m + [0.02, 0.01, 0.0], np.repeat(np.arange(40)[:, None], 2, axis=1)
    samples, scan = noise((3, 40)), BistaticScan(tx_m, rx_m)
    whole = np.zeros((3, 40, 40), complex)
    whole[:, np.arange(40), np.arange(40)] = samples
    grid = VoxelGrid(
        1e-3 * np.arange(-20, 20), 1e-3 * np.arange(-15, 15), 0.3 + 1e-3 * np.arange(4)
    )
    with certified() as certificate:
        volume = image_volume(samples, TONES_HZ, scan, grid, tolerance)
    points = grid.points_m().reshape(-1, 3)
    expected = plain_sum(whole, TONES_HZ, tx_m, rx_m, pairs, points).sum(axis=0)
    error = relative_error(volume.ravel(), expected)
    assert error < (tolerance or SINGLE) and certificate.images == 1 and certificate.bound > error
    magnitude = project_volume(samples, TONES_HZ, scan, grid, tolerance).magnitude
    reference = np.abs(expected.reshape(grid.shape))
    np.testing.assert_allclose(
        magnitude[1], reference.max(axis=0), atol=(tolerance or SINGLE) * reference.max()
    )


def test_a_scan_of_one_place_each_is_a_planar_scan():
    places = np.c_[np.random.default_rng(2).uniform(-0.05, 0.05, (50, 2)), np.zeros(50)]
    samples, points = noise((3, 50)), np.array([[0.0, 0.01, 0.3], [0.02, 0.0, 0.25]])
    pair, single = (
        image_points(samples, TONES_HZ, a, points, None)
        for a in (BistaticScan(places, places), PlanarScan(places))
    )
    np.testing.assert_allclose(pair, single, rtol=1e-6)


def test_a_point_in_water_is_imaged_where_it_is():
    """The medium's sum by its own speed; tones found by their true frequencies."""
    speed, tones_hz, point_m = 3.3e7, np.linspace(2e9, 4e9, 9), np.array([0.01, 0.02, 0.12])
    few = AntennaArray(ARRAY.tx_m[::6], ARRAY.rx_m[::6])
    samples = echo(point_m, tones_hz, few.tx_m, few.rx_m, speed)
    capture = RadarCapture(samples[None].astype(np.complex64), tones_hz, few, speed)
    found, formula_hz = capture.tones(tones_hz)
    points = point_m + np.random.default_rng(3).uniform(-0.02, 0.02, (40, 3))
    image = image_points(found, formula_hz, capture.aperture, points, 1e-4)
    every = np.argwhere(np.ones(few.channels, bool))
    expected = plain_sum(samples, tones_hz, few.tx_m, few.rx_m, every, points, speed).sum(axis=0)
    assert relative_error(image, expected) < 1e-4
    chosen = method("broadband")
    axis = {"start_m": -0.02, "stop_m": 0.04, "step_m": 0.005}
    values = {"x": axis, "y": axis, "z": {"start_m": 0.1, "stop_m": 0.14, "step_m": 0.005}}
    depth = chosen.run(
        capture, chosen.configure(values | {"start_hz": 2e9, "stop_hz": 4e9, "count": 9}, "test"), 0
    ).depth
    row, column = np.unravel_index(depth.amplitude_db.argmax(), depth.z_m.shape)
    np.testing.assert_allclose(
        [depth.x_m[column], depth.y_m[row], depth.z_m[row, column]], point_m, atol=1e-9
    )


def test_the_path_s_rise_is_that_of_the_pairs():
    """The mean over the pairs that are there, pair by pair."""
    heard = np.zeros((3, 2), bool)
    heard[0, 0] = heard[1, 0] = heard[1, 1] = True
    tx_m, rx_m, p = (
        np.eye(3) * 0.1,
        np.array([[0.0, 0.05, 0.0], [0.2, 0.0, 0.0]]),
        np.array([0.01, 0.02, 0.3]),
    )
    rises = [
        (p - tx_m[t])[2] / np.linalg.norm(p - tx_m[t])
        + (p - rx_m[r])[2] / np.linalg.norm(p - rx_m[r])
        for t, r in np.argwhere(heard)
    ]
    assert path_rise(p[None], AntennaArray(tx_m, rx_m, heard))[0] == pytest.approx(
        np.mean(rises), rel=1e-12
    )


def test_a_long_sum_over_pairs_says_its_time_beforehand(monkeypatch):
    """A term of a scan takes SCAN times as long as one of an array, which is summed by matrix
    products."""
    told = {}
    places, points = (
        np.random.default_rng(4).uniform(-0.1, 0.1, (2, 36, 3)),
        np.tile([[0.0, 0.0, 0.3]], (50, 1)),
    )
    for aperture in (BistaticScan(*places), AntennaArray(places[0, :6], places[1, :6])):
        monkeypatch.setattr(
            "handbench.radar.imaging.api.require_time",
            lambda core_s, what, a=aperture: told.update({type(a): core_s}),
        )
        image_points(noise((3, *aperture.channels)), TONES_HZ, aperture, points, None)
    assert told[BistaticScan] == pytest.approx(SCAN * told[AntennaArray])

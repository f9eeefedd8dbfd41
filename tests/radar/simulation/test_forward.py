"""The forward model: the adjoint of imaging, with and without the fast chain."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from handbench.radar.data.arrays import AntennaArray, PlanarScan, qar50
from handbench.radar.imaging.api import image_points
from handbench.radar.simulation.forward import Scatterers, simulate
from tests.radar.direct_echoes import direct_echoes
from tests.radar.direct_sums import direct_sum
from tests.radar.samples import noise, relative_error
from tests.strategies import examples

pytestmark = pytest.mark.usefixtures("planned")

TONES_HZ = np.linspace(72e9, 82e9, 128)[::8]


def points(count: int, seed: int = 1) -> np.ndarray:
    return np.random.default_rng(seed).uniform([-0.1, -0.1, 0.245], [0.1, 0.1, 0.325], (count, 3))


@examples(10)
@given(
    t=st.integers(1, 6),
    r=st.integers(1, 6),
    n=st.integers(1, 30),
    scan=st.booleans(),
    seed=st.integers(0, 2**31),
)
def test_direct_echoes_are_the_adjoint_of_the_direct_sum(t, r, n, scan, seed):
    generator = np.random.default_rng(seed)
    antennas = generator.uniform(-0.1, 0.1, (2, 6, 3))
    aperture = (
        PlanarScan(antennas[0, :t]) if scan else AntennaArray(antennas[0, :t], antennas[1, :r])
    )
    weights = generator.standard_normal(n) + 1j * generator.standard_normal(n)
    tones_hz = generator.uniform(60e9, 90e9, 3)
    samples = noise((3, *aperture.channels), seed).astype(np.complex128)
    echoes = direct_echoes(points(n, seed), weights, tones_hz, aperture)
    image = direct_sum(samples, tones_hz, aperture, points(n, seed))
    difference = np.vdot(echoes, samples) - np.vdot(weights, image)
    assert abs(difference) < 1e-12 * np.linalg.norm(echoes) * np.linalg.norm(samples)


@pytest.mark.parametrize("tolerance", [1e-2, 1e-5, None])
def test_simulation_is_the_adjoint_of_imaging_at_any_tolerance(tolerance):
    # Both run the same plan, so that even a coarse one is adjoint to single precision.
    generator = np.random.default_rng(4)
    where, samples, weights = points(300), noise((16, 94, 94)), generator.standard_normal(300)
    echoes = simulate(
        Scatterers(where, weights), TONES_HZ, qar50(), spreading=False, tolerance=tolerance
    )
    image = image_points(samples, TONES_HZ, qar50(), where, tolerance)
    difference = np.vdot(echoes.astype(complex), samples) - np.vdot(weights, image)
    assert abs(difference) < 1e-5 * np.linalg.norm(echoes) * np.linalg.norm(samples)


def surface(count: int) -> Scatterers:
    """Facets of a bumpy sheet, some turned away from part of the array, under a layer that
    delays."""
    generator = np.random.default_rng(5)
    normal = generator.normal([0, 0, -1], 0.5, (count, 3))
    normal /= np.linalg.norm(normal, axis=1)[:, None]
    return Scatterers(
        points(count), generator.uniform(size=count), normal, generator.uniform(0, 1e-3, count)
    )


@pytest.mark.parametrize("tolerance", [1e-3, 1e-5])
def test_fast_simulation_of_a_surface_meets_the_tolerance(tolerance):
    scatterers = surface(400)
    exact = simulate(scatterers, TONES_HZ, qar50(), tolerance=None)
    assert (
        relative_error(simulate(scatterers, TONES_HZ, qar50(), tolerance=tolerance), exact)
        < tolerance
    )


def test_exact_simulation_agrees_with_the_formula():
    scatterers = surface(20)
    array = AntennaArray(qar50().tx_m[:5], qar50().rx_m[:4])
    expected = np.zeros((len(TONES_HZ), 5, 4), complex)
    for position, weight, normal, delay in zip(
        scatterers.position_m, scatterers.weight, scatterers.normal, scatterers.delay_m, strict=True
    ):
        to, back = array.tx_m - position, array.rx_m - position
        lengths = [np.linalg.norm(leg, axis=1) for leg in (to, back)]
        gains = [
            np.sqrt(np.maximum(leg @ normal / length, 0)) / length
            for leg, length in zip((to, back), lengths, strict=True)
        ]
        path = lengths[0][:, None] + lengths[1] + 2 * delay
        turns = TONES_HZ[:, None, None] * path / 299_792_458.0
        expected += weight * np.outer(*gains) * np.exp(-2j * np.pi * turns)
    # 20 float32 terms: 1e-6 of their size.
    assert relative_error(simulate(scatterers, TONES_HZ, array, tolerance=None), expected) < 1e-6


def half_seen(scatterers: Scatterers) -> Scatterers:
    """Of its points, a third seen by all antennas, a third by those beyond some antenna of each
    leg, a third by few."""
    generator = np.random.default_rng(6)
    count = len(scatterers.position_m)
    first = np.array(
        [[0] * count, generator.integers(0, 94, count), generator.integers(90, 100, count)]
    )
    first = first[np.arange(count) % 3, np.arange(count)]
    return replace(
        scatterers, seen=tuple(np.arange(94)[:, None] >= start for start in (first, first[::-1]))
    )


@pytest.mark.parametrize("pattern", [0.0, 2.4, 40.0])  # none, 60° wide at half power, and 15°
@pytest.mark.parametrize("oblique", [False, True])
def test_fast_simulation_of_hidden_points_and_patterns_meets_the_tolerance(pattern, oblique):
    scatterers = half_seen(surface(400))
    scatterers = scatterers if oblique else replace(scatterers, normal=None)
    exact = simulate(scatterers, TONES_HZ, qar50(), tolerance=None, pattern=pattern)
    assert relative_error(simulate(scatterers, TONES_HZ, qar50(), pattern=pattern), exact) < 1e-5


def test_hidden_points_and_patterns_are_factors_of_each_leg():
    scatterers = half_seen(surface(3))
    whole = [
        simulate(replace(scatterers, seen=None).where([i]), TONES_HZ, qar50(), tolerance=None)
        for i in range(3)
    ]
    legs = [(leg[None] - scatterers.position_m[:, None]) for leg in (qar50().tx_m, qar50().rx_m)]
    cosines = [-leg[:, :, 2] / np.linalg.norm(leg, axis=2) for leg in legs]
    tx, rx = (seen.T * cosine**2 for seen, cosine in zip(scatterers.seen, cosines, strict=True))
    expected = sum(echo * np.outer(a, b) for echo, a, b in zip(whole, tx, rx, strict=True))
    # float32 factors: 1e-6 of their size.
    assert (
        relative_error(simulate(scatterers, TONES_HZ, qar50(), tolerance=None, pattern=2), expected)
        < 1e-6
    )


def test_points_that_nothing_sees_echo_nothing():
    scatterers = surface(10)
    blind = replace(scatterers, seen=(np.zeros((94, 10), bool), np.ones((94, 10), bool)))
    for tolerance in (None, 1e-5):
        assert not simulate(blind, TONES_HZ, qar50(), tolerance=tolerance).any()
    # Where all antennas see everything, a mask changes nothing at all.
    clear = replace(scatterers, seen=(np.ones((94, 10), bool), np.ones((94, 10), bool)))
    assert np.array_equal(
        simulate(clear, TONES_HZ, qar50()), simulate(scatterers, TONES_HZ, qar50())
    )


@pytest.mark.parametrize("spread_m", [0.0, 1e-4, 2e-3, 1e-2])
def test_lone_points_meet_the_tolerance_too(spread_m):
    where = np.array([0.01, 0.02, 0.3]) + spread_m * np.random.default_rng(2).uniform(
        -1, 1, (20, 3)
    )
    lone = Scatterers(where, np.ones(20))
    fast, exact = (
        simulate(lone, TONES_HZ, qar50(), tolerance=tolerance) for tolerance in (1e-5, None)
    )
    assert relative_error(fast, exact) < 1e-5

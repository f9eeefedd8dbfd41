"""The forward model: the adjoint of imaging, with and without the fast chain."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from radar.arrays import AntennaArray, PlanarScan, qar50
from radar.backprojection import direct_sum
from radar.forward import Scatterers, direct_echoes, simulate
from radar.imaging import image_points
from tests.radar.samples import noise, relative_error

TONES_HZ = np.linspace(72e9, 82e9, 128)[::8]


def points(count: int, seed: int = 1) -> np.ndarray:
    return np.random.default_rng(seed).uniform([-0.1, -0.1, 0.245], [0.1, 0.1, 0.325], (count, 3))


@settings(max_examples=10, deadline=None)
@given(t=st.integers(1, 6), r=st.integers(1, 6), n=st.integers(1, 30), scan=st.booleans(), seed=st.integers(0, 2**31))
def test_direct_echoes_are_the_adjoint_of_the_direct_sum(t, r, n, scan, seed):
    generator = np.random.default_rng(seed)
    antennas = generator.uniform(-0.1, 0.1, (2, 6, 3))
    aperture = PlanarScan(antennas[0, :t]) if scan else AntennaArray(antennas[0, :t], antennas[1, :r])
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
    echoes = simulate(Scatterers(where, weights), TONES_HZ, qar50(), spreading=False, tolerance=tolerance)
    image = image_points(samples, TONES_HZ, qar50(), where, tolerance)
    difference = np.vdot(echoes.astype(complex), samples) - np.vdot(weights, image)
    assert abs(difference) < 1e-5 * np.linalg.norm(echoes) * np.linalg.norm(samples)


def surface(count: int) -> Scatterers:
    """Facets of a bumpy sheet, some turned away from part of the array, under a layer that delays."""
    generator = np.random.default_rng(5)
    normal = generator.normal([0, 0, -1], 0.5, (count, 3))
    normal /= np.linalg.norm(normal, axis=1)[:, None]
    return Scatterers(points(count), generator.uniform(size=count), normal, generator.uniform(0, 1e-3, count))


@pytest.mark.parametrize("tolerance", [1e-3, 1e-5])
def test_fast_simulation_of_a_surface_meets_the_tolerance(tolerance):
    scatterers = surface(400)
    exact = simulate(scatterers, TONES_HZ, qar50(), tolerance=None)
    assert relative_error(simulate(scatterers, TONES_HZ, qar50(), tolerance=tolerance), exact) < tolerance


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

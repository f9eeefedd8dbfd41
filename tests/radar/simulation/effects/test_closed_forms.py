"""Physical optics against closed forms."""

from dataclasses import replace

import numpy as np

from handbench.radar.data.arrays import SPEED_OF_LIGHT_M_S, AntennaArray, qar50
from handbench.radar.simulation.forward import simulate
from handbench.radar.simulation.scene_echoes import facets_of
from tests.radar.samples import relative_error
from tests.radar.simulation.effects.plates import sheet, sphere_body

FAR_M, TONE_HZ = 1e4, np.array([77e9])
WAVELENGTH_M = SPEED_OF_LIGHT_M_S / TONE_HZ[0]


def db(ratio):
    return 10 * np.log10(ratio)


def cross_section_m2(facets, tones_hz, degrees=0.0):
    """σ = 4π/λ² |S R²|² [f] of facets about the origin at a monostatic angle from -z."""
    theta = np.radians(degrees)
    antenna_m = FAR_M * np.array([[np.sin(theta), 0, -np.cos(theta)]])
    samples = simulate(facets, tones_hz, AntennaArray(antenna_m, antenna_m), tolerance=None)
    amplitude_m2 = np.abs(samples[:, 0, 0].astype(complex)) * FAR_M**2
    return 4 * np.pi * (tones_hz / SPEED_OF_LIGHT_M_S * amplitude_m2) ** 2


def test_facets_sum_to_the_integral_of_physical_optics():
    """A metal sphere's σ/πa²: ∫μ e^{jxμ} dμ over the lit half, x = 2ka: S R² = 2πa² (e^{jx}/jx +
    (e^{jx} − 1)/x²). Chords for arcs: edges of 1.6a/128 make a second-order error of
    (2ka·0.0125)²/12 = 1.9 % in power at ka = 60. From ka = 25 on, σ is πa² but for the terminator's
    1/ka, 0.17 dB there."""
    ka, radius_m = np.concatenate([np.linspace(0.2, 10, 50), np.linspace(20, 60, 41)]), 0.01
    facets = facets_of(sphere_body(radius_m, splits=7), np.inf)
    tones_hz = ka * SPEED_OF_LIGHT_M_S / (2 * np.pi * radius_m)
    optics = cross_section_m2(facets, tones_hz) / (np.pi * radius_m**2)
    integral = np.abs(1 + 1j * (1 - np.exp(-2j * ka)) / (2 * ka)) ** 2
    assert np.abs(db(optics[ka >= 25])).max() < 0.2
    assert np.abs(optics / integral - 1).max() < 0.02
    assert np.abs(optics / integral - 1)[ka <= 10].max() < 1e-3


def test_a_plate_has_its_sinc_pattern_down_to_30_db():
    """Of ten wavelengths: 4πA²/λ² (cos θ · sinc(kL sin θ))². Facets of λ/8 stand for points:
    (2π·sin 25°/4)²/24 = 1.8 % of the amplitude, 0.16 dB, at the outermost lobe."""
    side_m, degrees = 10 * WAVELENGTH_M, np.linspace(0, 40, 161)
    oblique = facets_of(sheet(side_m, WAVELENGTH_M / 8), np.inf)
    optics, even = (
        np.concatenate([cross_section_m2(facets, TONE_HZ, angle) for angle in degrees])
        for facets in (oblique, replace(oblique, normal=None))
    )
    theta = np.radians(degrees)
    pattern = np.cos(theta) * np.sinc(2 * side_m / WAVELENGTH_M * np.sin(theta))
    exact = 4 * np.pi * (side_m**2 / WAVELENGTH_M * pattern) ** 2
    lobes = exact > 1e-3 * exact.max()
    assert degrees[lobes].max() > 20
    assert np.abs(db(optics / exact))[lobes].max() < 0.16
    # cos² 25° = −0.9 dB: what leaving out the obliquity costs
    assert np.abs(db(even / exact))[lobes].max() > 0.6


def bumps_m(x, y):
    """A surface as curved as a hand's: bumps of 6 mm every 40 to 60 mm."""
    return 3e-3 * (np.sin(2 * np.pi * x / 0.05 + 0.3) + np.cos(2 * np.pi * (y + 0.4 * x) / 0.06))


def test_refinement_converges_with_the_square_of_the_edge():
    """Midpoints of flat facets: second order, with edges of λ/2, λ/4 and λ/8 against λ/32."""
    array = AntennaArray(qar50().tx_m[::12], qar50().rx_m[::12])
    *coarse, exact = (
        simulate(facets_of(body, np.inf), TONE_HZ, array, tolerance=None)
        for body in (sheet(8 * WAVELENGTH_M, WAVELENGTH_M / n, 0.3, bumps_m) for n in (2, 4, 8, 32))
    )
    errors = np.array([relative_error(samples, exact) for samples in coarse])
    orders = np.log2(errors[:-1] / errors[1:])
    assert (orders > 1.9).all() and (orders < 2.2).all()
    assert errors[1] < 0.03  # a quarter of the wavelength, which scenes are sampled at

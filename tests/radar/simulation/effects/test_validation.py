"""Physical optics against closed forms."""

import numpy as np
import pytest

from tests.radar.simulation.effects.closed_forms import (
    phase_errors_rad,
    plate_over_angle,
    power_over_range,
    refined,
    sphere_over_ka,
)


def db(ratio):
    return 10 * np.log10(ratio)


@pytest.fixture(scope="module")
def sphere():
    ka = np.concatenate([np.linspace(0.2, 10, 50), np.linspace(20, 60, 41)])
    return ka, *sphere_over_ka(ka)


def test_a_large_sphere_has_the_cross_section_pi_a_squared(sphere):
    ka, facets, _, mie = sphere
    large = (
        ka >= 25
    )  # a = 15 mm at 77 GHz; the terminator of physical optics is 1/ka = 0.17 dB there
    assert np.abs(db(facets[large])).max() < 0.2
    assert np.abs(db(mie[large])).max() < 0.2


def test_facets_sum_to_the_integral_of_physical_optics(sphere):
    # Chords for arcs: edges of 1.6a/128 make a second-order error of (2ka·0.0125)²/12 = 1.9 % in
    # power at ka = 60.
    ka, facets, closed, _ = sphere
    assert np.abs(facets / closed - 1).max() < 0.02
    assert np.abs(facets / closed - 1)[ka <= 10].max() < 1e-3


def test_physical_optics_approaches_mie_as_one_over_ka(sphere):
    ka, facets, _, mie = sphere
    # Both go to πa²; of what they differ by, the terminator of physical optics is the largest part:
    # |2/x| in power.
    for low, high, most_db in ((20, 30, 0.4), (30, 60, 0.25)):
        assert np.abs(db(facets / mie))[(ka >= low) & (ka <= high)].max() < most_db
    assert np.abs(db(facets / mie))[ka < 2].max() > 3  # resonance is not physical optics


def test_a_plate_has_its_sinc_pattern_down_to_30_db():
    degrees = np.linspace(0, 40, 161)
    (facets, exact), (even, _) = plate_over_angle(degrees), plate_over_angle(degrees, oblique=False)
    lobes = exact > 1e-3 * exact.max()
    assert degrees[lobes].max() > 20
    # Facets of λ/8 stand for points: (2π·sin 25°/4)²/24 = 1.8 % of the amplitude, 0.16 dB, at the
    # outermost lobe.
    assert np.abs(db(facets / exact))[lobes].max() < 0.16
    assert (
        np.abs(db(even / exact))[lobes].max() > 0.6
    )  # cos² 25° = −0.9 dB: what leaving out the obliquity costs


@pytest.mark.parametrize(("tolerance", "spreading"), [(None, True), (1e-5, False)])
def test_phases_are_those_of_the_exact_distance(tolerance, spreading):
    assert phase_errors_rad(tolerance, spreading).max() < 1e-4


def test_refinement_converges_with_the_square_of_the_edge():
    errors = refined()
    orders = np.log2(errors[:-1] / errors[1:])
    # Midpoints of flat facets: second order. The last step looks steeper since the reference errs
    # by a quarter of it.
    assert np.all(orders[:2] > 1.9)
    assert np.all(orders[:2] < 2.2)
    assert errors[1] < 0.03  # a quarter of the wavelength, which scenes are sampled at


def test_power_falls_with_the_fourth_power_of_range():
    range_m = np.array([0.3, 0.6, 1.2, 2.4, 4.8])
    orders = -np.diff(np.log2(power_over_range(range_m)), axis=1)
    assert orders[0] == pytest.approx(4, abs=1e-5)  # a point: float32
    # A ball's near surface is nearer than its centre by 5 mm: 1/(R − a)² R² tends to R⁻⁴ like 1 +
    # 2a/R.
    assert np.all(np.diff(np.abs(orders[1] - 4)) < 0)
    assert orders[1, -1] == pytest.approx(4, abs=0.003)

"""Small slips in the calibration that no other test would notice."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from matplotlib.text import Text
from scipy.optimize import brentq
from scipy.stats import chi2

from handbench.calibration.array.estimate import estimate_array
from handbench.calibration.array.prior import live_part
from handbench.calibration.registration.register import RigMotion
from handbench.calibration.registration.rigid_fit import Pairs, fit
from handbench.calibration.spheres.description import Element, Target
from handbench.calibration.spheres.radar_detection import EchoSearch
from handbench.calibration.transforms import TRIPLES, triples, umeyama
from handbench.reports.drawings.sheets import INCH_MM
from handbench.reports.drawings.target_drawing import target_sheets
from tests.calibration.array.test_array import (
    PAPER_RAD,
    C,
    Imperfect,
    centres_m,  # noqa: F401
    recorded,
    small_state,
)


def test_few_pairs_propose_all_triples_and_many_a_fixed_draw():
    few = triples(5)
    assert len(few) == len({frozenset(triple) for triple in few.tolist()}) == 10
    many = triples(40)
    assert many.shape == (TRIPLES, 3) and many.max() < 40
    assert all(len(set(triple)) == 3 for triple in many.tolist())
    assert np.array_equal(many, triples(40))


def test_an_antennas_phase_towards_the_target_is_told_better_than_its_place(target, centres_m):  # noqa: F811
    """Place along the line of sight and phase do the same to an echo, and only their sum is told:
    0.043 rad are left of it (measured), against 0.076 rad that the place alone leaves open."""
    found = estimate_array(Imperfect(1).of_target(target, centres_m, PAPER_RAD), target)
    k = 2 * np.pi * found.reference_hz / C
    for side in (found.tx, found.rx):
        along = np.array(side.offset_sigma_m)[:, 2]
        assert np.median(side.phase_sigma_rad) < 0.8 * k * np.median(along)


def test_dead_antennas_leave_and_the_balls_take_over_what_all_have_in_common(target, centres_m):  # noqa: F811
    """Only the split between antennas and balls changes: the living antennas' echoes stay, to
    single precision."""
    state, echoes = small_state(target, centres_m)
    turned = replace(state, tx=replace(state.tx, log_gain=state.tx.log_gain + 0.2 + 2j))
    live_tx, live_rx = (np.arange(count) != 1 for count in state.counts[:2])
    left = live_part(turned, live_tx, live_rx)
    assert abs(left.tx.log_gain.mean()) < 1e-12 and abs(left.rx.log_gain.mean()) < 1e-12
    expected = recorded(turned, echoes)[live_tx][:, live_rx]
    np.testing.assert_allclose(recorded(left, echoes), expected, atol=1e-5 * np.abs(expected).max())


@pytest.mark.parametrize(("largest", "weighs_all_alike"), [(3.3, True), (3.5, False)])
def test_only_what_one_in_a_hundred_pairs_exceeds_loses_weight(largest, weighs_all_alike):
    """Of clean pairs 99 % lie within 3.37 σ (χ² of three), and while all do the fit is plain least
    squares, of which Umeyama's closed form is exact for equal covariances."""
    random = np.random.default_rng(5)
    source_m, sigma_m = 0.1 * random.standard_normal((8, 3)), 1e-4
    miss = random.standard_normal((8, 3))

    def pairs(scale: float) -> Pairs:
        equal_m2 = np.tile(sigma_m**2 / 2 * np.eye(3), (8, 1, 1))
        return Pairs(
            source_m, source_m + scale * sigma_m * miss, equal_m2, equal_m2, tuple("abcdefgh")
        )

    def furthest(scale: float) -> float:
        return float(pairs(scale).distances(plain(scale)).max()) - largest

    def plain(scale: float) -> np.ndarray:
        return umeyama(source_m, pairs(scale).target_m)

    scale = brentq(furthest, 0.1, 10)
    apart_m = np.abs(fit(pairs(scale)).matrix[:3, 3] - plain(scale)[:3, 3]).max()
    assert (apart_m < 1e-6 * sigma_m) == weighs_all_alike


def test_a_shift_may_reach_as_far_as_its_ellipsoids_longest_axis():
    """A shift of 5 mm along x, with σ of 1, 2 and 3 mm along x, y and z."""
    reach = np.sqrt(chi2.ppf(0.95, 3))
    covariance = np.diag([1e-6, 4e-6, 9e-6, 1e-6, 1e-6, 1e-6])
    low_m, high_m = RigMotion(np.array([5e-3, 0, 0, 0, 0, 0]), covariance, "a", "b").interval_m
    assert (low_m, high_m) == (
        pytest.approx(5e-3 - 1e-3 * reach),
        pytest.approx(5e-3 + 3e-3 * reach),
    )


def test_a_threshold_is_told_in_decibels_of_amplitude():
    assert EchoSearch(threshold_db=-20.0).threshold == pytest.approx(0.1)


def test_every_ordinate_stands_at_its_coordinate():
    """Far enough apart that no number has to give way. In the front view x grows to the left."""
    places_mm = [(11, -42, 5), (-63, 20, -17), (40, 55, 33)]
    target = Target(
        element=tuple(
            Element(
                centre_m=tuple(v / 1000 for v in place), sphere_radius_m=0.01, ball_radius_m=0.003
            )
            for place in places_mm
        )
    )
    figure = target_sheets(target, "three", "fit")[0]
    assert any(
        "123.0 × 117.0 × 70.0 mm" in text.get_text() for text in figure.findobj(Text)
    )  # over the foam
    upright = [
        text for text in figure.findobj(Text) if text.get_text() and text.get_rotation() == 90
    ]
    on_page_mm = [
        text.get_transform().transform(text.get_position())[0] * INCH_MM / figure.dpi
        for text in upright
    ]
    shown = sorted(
        zip(on_page_mm, [float(text.get_text().replace("−", "-")) for text in upright], strict=True)
    )
    for ordinates, values, sign in (
        (shown[:4], [40, 11, 0, -63], -1),
        (shown[4:], [-17, 0, 5, 33], 1),
    ):
        assert [value for _, value in ordinates] == values
        # Floating point, as the page is counted in pixels.
        np.testing.assert_allclose(
            np.diff([place for place, _ in ordinates]), sign * np.diff(values), atol=1e-6
        )


def test_the_foam_delays_an_echo_from_the_balls_surface():
    """25 mm of foam of √ε_r = 1.02 about a ball of 5 mm: 20 mm of foam are 0.4 mm longer, one
    way."""
    element = Element(centre_m=(0.0, 0.0, 0.0), sphere_radius_m=0.025, ball_radius_m=0.005)
    target = Target(element=(element,) * 5, foam_permittivity=1.02**2)
    assert target.foam_delay_m == pytest.approx([4e-4] * 5, rel=1e-9)

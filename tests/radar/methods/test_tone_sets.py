"""Sets of tones: closed forms against draws, and against a figure that another implementation found."""

import numpy as np
import pytest

from handbench.cli.main import main
from handbench.radar.methods.tone_sets import best_sets, bound_m, drawn_wraps, mistaken, wrap_probability_of

LADDER_HZ = np.array([82.0e9, 81.8e9, 81.3e9, 79.5e9, 72.0e9])


def test_the_bound_of_three_tones():
    """c σ / (4π √Σ(f − f̄)²) with 0.0264 rad a tone: 0.321 mm for 3-FSK, 0.075 for the ladder, worked out by hand."""
    for tones_hz, known_m in ((np.array([82.0e9, 81.8e9, 79.5e9]), 0.321e-3), (LADDER_HZ, 0.075e-3)):
        assert bound_m(tones_hz, 0.0264 * np.sqrt(2)) == pytest.approx(known_m, abs=0.6e-6)


def test_two_signals_are_mistaken_as_often_as_drawn():
    """Draws of both matched filters; at correlation 0 the known ½ e^{−SNR/2}."""
    assert mistaken(np.array([0.0]), 6.0)[0] == pytest.approx(0.5 * np.exp(-3), rel=1e-9)
    draws, snr = np.random.default_rng(0), 8.0
    for correlation in (0.3, 0.7, 0.9):
        z = draws.standard_normal((4, 400_000)) * np.sqrt(0.5)
        first = np.sqrt(snr) + z[0] + 1j * z[1]
        second = correlation * first + np.sqrt(1 - correlation**2) * (z[2] + 1j * z[3])
        assert mistaken(np.array([correlation]), snr)[0] == pytest.approx((abs(second) > abs(first)).mean(), rel=0.06)


def test_the_ladder_wraps_as_often_as_another_implementation_found():
    """5.5 % within ±60 mm at 0.3 rad a tone (a search of its own, before this one was written), the formula near it."""
    noise_rad = 0.3 * np.sqrt(2)
    assert drawn_wraps(LADDER_HZ, noise_rad, 0.06) == pytest.approx(0.055, abs=0.01)
    assert wrap_probability_of(LADDER_HZ, noise_rad, 0.06) == pytest.approx(0.055, abs=0.015)


def test_the_best_sets_are_better_and_keep_to_what_was_asked():
    band_hz = np.linspace(72e9, 82e9, 41)
    sets = best_sets(5, band_hz, 250e6, 0.3, 0.03, 0.005, kept=3)
    assert len(sets) == 3 and [s.bound_m for s in sets] == sorted(s.bound_m for s in sets)
    for found in sets:
        assert found.tones_hz[0] == 82e9 and found.tones_hz[1] == 81.75e9 and found.tones_hz[-1] == 72e9
        assert found.bound_m < bound_m(LADDER_HZ, 0.3)
        assert drawn_wraps(np.array(found.tones_hz), 0.3, 0.03, seed=9) < 0.01  # of other draws


def test_the_command_shows_them(capsys):
    assert main(["design", "--tones", "4", "--wraps", "0.05", "--reach", "20mm"]) == 0
    shown = capsys.readouterr().out
    assert "Sets of 4 tones" in shown and "ladder of nfsk" in shown
    for wrong in (["--tones", "2"], ["--tones", "4", "--band", "72GHz"], ["--tones", "4", "--pair", "20GHz"]):
        assert main(["design", *wrong]) == 2
    assert main(["design", "--tones", "4", "--noise", "3"]) == 2

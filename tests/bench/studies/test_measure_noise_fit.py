"""The fitted noise has the precision that was asked for."""

import numpy as np
import pytest

from handbench.bench.studies import measure_noise_fit


@pytest.mark.slow
def test_the_fit_comes_to_the_precision(ran, small_bench):
    """One ball's strongest point, so that the closed form is near already."""
    found = ran(measure_noise_fit, str(small_bench), "--precision-mm", "2", "--repeats", "4")
    *steps, fitted = found["rows"]
    assert [step["step"] for step in steps] == ["closed form", "2", "3"]
    assert steps[-1]["precision_mm"] == pytest.approx(2, rel=0.05)
    assert fitted["phase_noise_rad"] == pytest.approx(steps[-1]["phase_noise_rad"], rel=0.05)
    assert steps[0]["phase_noise_rad"] == pytest.approx(
        4 * np.pi * 200e6 / 299792458 * 2e-3, rel=1e-9
    )

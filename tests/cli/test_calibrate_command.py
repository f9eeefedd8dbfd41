"""`handbench calibrate`: what its options mean; the measuring itself is tested where it lives."""

from __future__ import annotations

import numpy as np
import pytest

import handbench.bench.run.photogrammetry
from handbench.calibration.transforms import Transform
from handbench.cli.main import main

COVARIANCE = np.diag([5e-5, 5e-5, 8e-5, 5e-4, 5e-4, 5e-4]) ** 2


def transform(shift_m: float = 0.0) -> Transform:
    matrix = np.eye(4)
    matrix[0, 3] = shift_m
    return Transform("photo", "radar", matrix, COVARIANCE.copy(), np.array([1e-5, 2e-5]))


@pytest.fixture
def measured(monkeypatch):
    """Stands for photographs and echoes: every capture gives a rig shifted by 2 mm."""
    monkeypatch.setattr(
        handbench.bench.run.photogrammetry, "calibrate_captures", lambda *_, **__: transform(2e-3)
    )


def test_an_earlier_calibration_tells_whether_the_rig_moved(
    tmp_path, measured, capsys, monkeypatch
):
    """2 mm against two standard deviations of 0.05 mm: it did, and by between 1.6 and 2.4 mm at
    most."""
    monkeypatch.chdir(tmp_path)
    transform().save(tmp_path / "april.json")
    assert main(["calibrate", "cap", "-o", "may.json", "--since", "april.json"]) == 0
    printed = capsys.readouterr().err
    assert "the rig moved between april.json and may.json: 2 mm at the hand's centre" in printed
    assert (
        "at the hand's centre ± 0.16 × 0.16 × 0.08 mm" in printed
    )  # √(0.05² + (0.3 m · 0.5 mrad)²)

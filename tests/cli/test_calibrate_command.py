"""`handbench calibrate`: what it prints; the measuring itself is tested where it lives."""

from __future__ import annotations

import numpy as np

import handbench.cli.calibrate
from handbench.calibration.transforms import Transform
from handbench.cli.main import main

COVARIANCE = np.diag([5e-5, 5e-5, 8e-5, 5e-4, 5e-4, 5e-4]) ** 2


def test_the_error_at_the_hands_centre_is_printed(tmp_path, capsys, monkeypatch):
    measured = Transform("photo", "radar", np.eye(4), COVARIANCE, np.array([1e-5, 2e-5]))
    monkeypatch.setattr(handbench.cli.calibrate, "calibrate_captures", lambda *_, **__: measured)
    assert main(["calibrate", "cap", "-o", str(tmp_path / "t.json")]) == 0
    printed = capsys.readouterr().err
    assert (
        "at the hand's centre ± 0.16 × 0.16 × 0.08 mm" in printed
    )  # √(0.05² + (0.3 m · 0.5 mrad)²)

"""The whole way of a capture that lacks pairs, through the typed commands."""

import json
import shutil
from dataclasses import replace

import numpy as np

from handbench.cli.main import main
from handbench.radar.data.echoes_file import load_capture, save_capture
from tests.cli.conftest import PIXELS


def test_a_capture_without_some_pairs_is_imaged_and_inspected(made, tmp_path, capsys):
    """The ball without three tenths of its pairs. Of all pairs 0.28 mm was measured, by the
    filters."""
    folder = shutil.copytree(made / "capture", tmp_path / "ball")
    whole = load_capture(folder / "echoes.h5")
    there = np.random.default_rng(0).random(whole.aperture.channels) > 0.3
    some = replace(whole.aperture, measured=there)
    save_capture(folder / "echoes.h5", replace(whole, samples=whole.samples * there, aperture=some))
    assert main(["inspect", str(folder)]) == 0
    assert f"{(~there).sum()} of its 8836 pairs" in capsys.readouterr().out
    depth = str(tmp_path / "depth.npz")
    assert main(["reconstruct", str(folder), "--method", "3fsk", "-o", depth, *PIXELS]) == 0
    assert main(["evaluate", depth, "--mesh", str(folder / "truth.ply")]) == 0
    assert json.loads(capsys.readouterr().out)["mae_mm"] < 1.0

"""Captures of any kind through the typed commands: one image whatever the version that holds the
echoes, and the whole way of a capture that lacks pairs."""

import json
import shutil

import h5py
import numpy as np
import pytest

from handbench.cli.main import main
from handbench.radar.data.echoes_file import load_capture
from tests.cli.conftest import PIXELS

DEPTHS = ["--set", "z.start_m=0.27", "--set", "z.stop_m=0.29", "--set", "z.step_m=0.002"]
ATTRIBUTES = {
    "format": "handbench-echoes",
    "version": 2,
    "units": "m, Hz, m/s",
    "frame": "x left, y up, z away",
}


def anew(capture, folder, time="+jwt", **data):
    """The same folder with an echoes.h5 of version 2 by h5py alone."""
    shutil.copytree(capture, folder)
    with h5py.File(capture / "echoes.h5") as file:
        content = {name: file[name][:] for name in file} | data
    with h5py.File(folder / "echoes.h5", "w") as file:
        file.attrs.update(ATTRIBUTES | {"time": time})
        for name, values in content.items():
            file[name] = values
    return folder


def depths(folder, out, method, *options) -> dict:
    command = ["reconstruct", str(folder), "--method", method, "-o", str(out)]
    assert main([*command, *PIXELS, *options]) == 0
    with np.load(out) as content:
        return {name: content[name] for name in ("z_m", "amplitude_db")}


@pytest.mark.parametrize(("method", "options"), [("narrowband", DEPTHS), ("3fsk", ["--exact"])])
def test_every_version_of_the_same_echoes_gives_the_same_image(made, tmp_path, method, options):
    ball = made / "capture"
    samples = load_capture(ball / "echoes.h5").samples
    pairs = np.random.default_rng(1).permutation(np.argwhere(np.ones(samples.shape[2:], bool)))
    folders = (
        ball,
        anew(ball, tmp_path / "list", samples=samples[:, :, *pairs.T], pairs=pairs),
        anew(ball, tmp_path / "full", "-jwt", samples=samples.conj()),
    )
    one, *others = (depths(f, tmp_path / f"{f.name}.npz", method, *options) for f in folders)
    assert np.isfinite(one["z_m"]).sum() > 50
    for other in others:
        for name in ("z_m", "amplitude_db"):  # metres, dB; NaN is in the same places
            np.testing.assert_allclose(other[name], one[name], rtol=0, atol=1e-6)


def test_a_capture_without_some_pairs_is_imaged_and_inspected(made, tmp_path, capsys):
    """The ball without three tenths of its pairs. Of all pairs 0.28 mm was measured, by the
    filters."""
    whole = load_capture(made / "capture" / "echoes.h5")
    there = np.random.default_rng(0).random(whole.aperture.channels) > 0.3
    listed = {"samples": whole.samples[:, :, there], "pairs": np.argwhere(there)}
    folder = anew(made / "capture", tmp_path / "ball", **listed)
    assert main(["inspect", str(folder)]) == 0
    assert f"{(~there).sum()} of its 8836 pairs" in capsys.readouterr().out
    depths(folder, tmp_path / "depth.npz", "3fsk")
    assert main(["evaluate", str(tmp_path / "depth.npz"), "--mesh", str(folder / "truth.ply")]) == 0
    assert json.loads(capsys.readouterr().out)["mae_mm"] < 1.0

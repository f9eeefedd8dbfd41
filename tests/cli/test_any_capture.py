"""Captures of any kind through the typed commands: one image whatever the version that holds the
echoes, and the whole way of a capture that lacks pairs."""

import json
import shutil

import h5py
import numpy as np
import pytest

from handbench.bench.datasets.native import NativeCapture
from handbench.calibration.array.array_file import save_array
from handbench.cli.main import main
from handbench.radar.data.echoes_file import load_capture
from tests.fuzz.capture_seeds import array_calibration

LATERAL = [
    "--set",
    "x.start_m=-0.02",
    "--set",
    "x.stop_m=0.02",
    "--set",
    "y.start_m=-0.02",
    "--set",
    "y.stop_m=0.02",
]
DEPTHS = ["--set", "z.start_m=0.27", "--set", "z.stop_m=0.29", "--set", "z.step_m=0.002"]
TOLD = {
    "format": "handbench-echoes",
    "version": 2,
    "units": "m, Hz, m/s",
    "frame": "x left, y up, z away",
}


@pytest.fixture(scope="module")
def ball(tmp_path_factory):
    """A capture folder of version 1, of a ball with its true surface, made by the command."""
    from tests.small_benchmark import write_bench

    folder = tmp_path_factory.mktemp("ball")
    bench = write_bench(folder / "bench")
    assert main(["simulate", str(bench.parent / "ball.toml"), "-o", str(folder / "capture")]) == 0
    return folder / "capture"


def anew(ball, folder, time="+jwt", **data):
    """The same folder with an echoes.h5 of version 2 by h5py alone."""
    shutil.copytree(ball, folder)
    with h5py.File(ball / "echoes.h5") as file:
        content = {name: file[name][:] for name in file} | data
    with h5py.File(folder / "echoes.h5", "w") as file:
        file.attrs.update(TOLD | {"time": time})
        for name, values in content.items():
            file[name] = values
    return folder


def depths(folder, out, method, *options) -> dict:
    assert (
        main(["reconstruct", str(folder), "--method", method, "-o", str(out), *LATERAL, *options])
        == 0
    )
    with np.load(out) as content:
        return {name: content[name] for name in ("z_m", "amplitude_db")}


@pytest.mark.parametrize(
    ("method", "options"), [("3fsk", []), ("narrowband", DEPTHS), ("3fsk", ["--exact"])]
)
def test_every_version_of_the_same_echoes_gives_the_same_image(ball, tmp_path, method, options):
    samples = load_capture(ball / "echoes.h5").samples
    pairs = np.random.default_rng(1).permutation(np.argwhere(np.ones(samples.shape[2:], bool)))
    folders = {
        "one": ball,
        "list": anew(ball, tmp_path / "list", samples=samples[:, :, *pairs.T], pairs=pairs),
        "full": anew(ball, tmp_path / "full", "-jwt", samples=samples.conj()),
    }
    one, *others = (
        depths(folder, tmp_path / f"{name}.npz", method, *options)
        for name, folder in folders.items()
    )
    assert np.isfinite(one["z_m"]).sum() > 50
    for other in others:
        np.testing.assert_allclose(other["z_m"], one["z_m"], rtol=0, atol=1e-6)  # metres; NaN alike
        np.testing.assert_allclose(other["amplitude_db"], one["amplitude_db"], rtol=0, atol=1e-6)


@pytest.fixture(scope="module")
def lacking(ball, tmp_path_factory):
    """The ball without three tenths of its pairs, and the calibration of its array inside."""
    folder, whole = tmp_path_factory.mktemp("lacking"), load_capture(ball / "echoes.h5")
    there = np.random.default_rng(0).random(whole.aperture.channels) > 0.3
    save_array(folder / "array.json", array_calibration(whole.aperture.tx_m, whole.aperture.rx_m))
    content = np.frombuffer((folder / "array.json").read_bytes(), np.uint8)
    listed = {
        "samples": whole.samples[:, :, there],
        "pairs": np.argwhere(there),
        "array.json": content,
    }
    return anew(ball, folder / "ball", **listed), there


def test_a_capture_without_some_pairs_is_imaged_validated_and_calibrated(lacking, tmp_path, capsys):
    folder, there = lacking
    capture = NativeCapture(folder).echoes()
    assert "array.json inside its echoes: applied" in capsys.readouterr().err
    np.testing.assert_array_equal(capture.aperture.measured, there)
    assert main(["inspect", str(folder)]) == 0
    assert f"{(~there).sum()} of its 8836 pairs were not measured" in capsys.readouterr().out
    depths(folder, tmp_path / "depth.npz", "3fsk")
    assert main(["evaluate", str(tmp_path / "depth.npz"), "--mesh", str(folder / "truth.ply")]) == 0
    assert (
        json.loads(capsys.readouterr().out)["mae_mm"] < 1.0
    )  # as of all pairs: 0.28 mm was measured, by the filters


def test_a_run_takes_such_captures_thinned_and_whole(lacking, tmp_path):
    shutil.copytree(lacking[0], tmp_path / "ball")
    axis = "{ start_m = -0.02, stop_m = 0.02, step_m = 0.002 }"
    entry = f'id = "2fsk"\nconfig = {{ x = {axis}, y = {axis} }}\n'
    (tmp_path / "mine.toml").write_text(
        'version = 1\nname = "mine"\n[[capture]]\npath = "ball"\nmeasures = ["accuracy"]\n'
        f"[[method]]\n{entry}[[method]]\n{entry.replace('2fsk', '3fsk')}every_nth_antenna = 2\n"
    )
    assert main(["run", str(tmp_path / "mine.toml"), "-o", str(tmp_path / "out")]) == 0
    table = (tmp_path / "out" / "table.csv").read_text()
    assert "mae_mm,2fsk" in table and "mae_mm,3fsk" in table

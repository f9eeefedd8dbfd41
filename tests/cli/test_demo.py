"""`handbench demo`, on a coarser hand with fewer tones: what it writes, prints, goes on with and
refuses."""

from __future__ import annotations

import re
import tomllib

import numpy as np
import pytest
from PIL import Image

from handbench.bench.run import benchmark_file
from handbench.bench.scenes.scene_file import SceneFile
from handbench.cli import demo
from handbench.cli.main import main, parser
from handbench.radar.methods.advice import requested_tones_hz
from handbench.radar.methods.registry import methods

NEXT = ["reconstruct", "evaluate", "simulate", "list"]
SCENE = benchmark_file.EMBEDDED / "demo_hand.toml"


@pytest.fixture
def small(tmp_path, monkeypatch):
    """The demo's scene with an edge of 4 mm and without the sweep, two of its methods, and an empty
    current folder."""
    text = SCENE.read_text("utf-8").replace("edge_m = 1.5e-3", "edge_m = 4e-3")
    text = re.sub(
        "sweep = .*\ntones_hz = .*", "sweep = []\ntones_hz = [82e9, 81.8e9, 79.5e9]", text
    )
    (tmp_path / "embedded").mkdir()
    (tmp_path / "embedded" / SCENE.name).write_text(text, "utf-8")
    (tmp_path / "here").mkdir()
    monkeypatch.setattr(benchmark_file, "EMBEDDED", tmp_path / "embedded")
    monkeypatch.setattr(demo, "METHODS", ("2fsk", "3fsk"))
    monkeypatch.chdir(tmp_path / "here")
    return tmp_path / "here" / "handbench-demo"


def test_the_demo_tells_draws_and_goes_on(small, capsys):
    assert main(["demo"]) == 0
    printed = capsys.readouterr().out
    mae_mm = [
        float(re.search(rf"^ ?{title} +([\d.]+)", printed, re.MULTILINE)[1])
        for title in ("2-FSK", "3-FSK")
    ]
    assert mae_mm[1] < mae_mm[0] < 20  # in the paper 1.7 and 6.6 mm
    assert f"picture: {small.name}/demo.png" in printed
    picture = np.asarray(Image.open(small / "demo.png").convert("RGB"))
    assert picture.shape[1] > 1000 and len(np.unique(picture.reshape(-1, 3), axis=0)) > 100
    commands = [line.split() for line in printed.splitlines() if line.startswith("  handbench ")]
    assert [parser().parse_args(command[1:]).command for command in commands] == NEXT
    echoes = small / "capture" / "echoes.h5"
    before = echoes.stat().st_mtime_ns
    assert main(["demo"]) == 0
    assert echoes.stat().st_mtime_ns == before and "exists already" in capsys.readouterr().err


def test_every_method_finds_its_tones_in_the_demo():
    there_hz = SceneFile.model_validate(
        tomllib.loads(SCENE.read_text("utf-8"))
    ).sensor.frequencies_hz
    for method in methods():
        asked = requested_tones_hz(method.configure({}, "test"))
        if asked is not None:
            assert np.abs(there_hz[:, None] - asked).min(axis=0).max() < 1e6, method.id


def test_measured_captures_are_imaged_by_the_methods_that_they_set_up(tmp_path, capsys):
    """A point before a raster scan, in a folder with one that sets up no method."""
    x_m, tones_hz, at_m = np.arange(-0.04, 0.041, 0.01), np.linspace(10e9, 14e9, 9), (0.01, 0, 0.1)
    x, y = np.meshgrid(x_m, x_m, indexing="ij")
    away_m = np.linalg.norm(np.stack([x, y, 0 * x], -1) - at_m, axis=-1)
    samples = np.exp(-4j * np.pi * away_m[..., None] * tones_hz / 299_792_458.0)
    for name in ("point", "other"):
        (tmp_path / name).mkdir()
        np.save(tmp_path / name / "s.npy", samples)
        (tmp_path / name / "mapping.toml").write_text(SCAN.replace("NAME", name))
    with (tmp_path / "point" / "mapping.toml").open("a") as file:
        file.write(METHOD)
    assert main(["demo", "--measured", str(tmp_path), "-o", str(tmp_path / "out")]) == 0
    shown = capsys.readouterr().out
    assert re.search(r"point.*3-FSK.*100 .*10\.0, 0\.0, (99|100)\.", shown), shown
    assert "other" not in shown
    with Image.open(tmp_path / "out" / "measured.png") as picture:
        assert picture.width > 200
    assert main(["demo", "--measured", str(tmp_path / "other")]) == 2
    assert "sets up a method" in capsys.readouterr().err


SCAN = """version = 1
[capture]
name = "NAME"
distance_m = 0.1
[samples]
dataset = "s.npy"
axes = ["x", "y", "frequency"]
reversed = false
sign = "-"
[frequencies]
steps = { start = 10, stop = 14, count = 9 }
unit = "GHz"
[position]
columns = [{ start = -40, step = 10, count = 9 }, { start = -40, step = 10, count = 9 }]
unit = "mm"
x = "left"
"""
METHOD = """[capture.methods.3fsk]
x = { start_m = -0.02, stop_m = 0.02, step_m = 0.01 }
y = { start_m = -0.02, stop_m = 0.02, step_m = 0.01 }
f1_hz = 14e9
f2_hz = 13e9
f3_hz = 10e9
first_depth_m = 0.1
"""

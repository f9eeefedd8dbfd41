"""`handbench demo`, on a sphere at three tones: what it writes, tells and refuses."""

from __future__ import annotations

import re
import tomllib

import numpy as np
import pytest
from PIL import Image

from handbench.bench.scenes.scene_file import SceneFile
from handbench.cli import demo
from handbench.cli.main import main, parser
from handbench.radar.methods.registry import METHODS

NEXT = ["reconstruct", "evaluate", "simulate", "list"]
SCENE = demo.HAND


@pytest.fixture
def small(tmp_path, monkeypatch):
    """The demo's scene with a sphere for the hand and without the sweep, two of its methods, and an
    empty current folder."""
    text = SCENE.read_text("utf-8").replace('"hand"\npose = "F"', '"sphere"')
    text = re.sub(
        "sweep = .*\ntones_hz = .*", "sweep = []\ntones_hz = [82e9, 81.8e9, 79.5e9]", text
    )
    (tmp_path / SCENE.name).write_text(text, "utf-8")
    (tmp_path / "here").mkdir()
    monkeypatch.setattr(demo, "HAND", tmp_path / SCENE.name)
    monkeypatch.setattr(demo, "METHODS", ("2fsk", "3fsk"))
    monkeypatch.chdir(tmp_path / "here")
    return tmp_path / "here" / "handbench-demo"


def test_the_demo_tells_draws_and_goes_on(small, monkeypatch, capsys):
    assert main(["demo"]) == 0
    printed = capsys.readouterr().out
    mae_mm = [
        float(re.search(rf"^ ?{title} +([\d.]+)", printed, re.MULTILINE)[1])
        for title in ("2-FSK", "3-FSK")
    ]
    assert mae_mm[1] < mae_mm[0] < 20  # in the paper 1.7 and 6.6 mm
    assert f"picture: {small.name}/demo.png" in printed
    picture = np.asarray(Image.open(small / "demo.png").convert("RGB"))
    assert picture.shape[1] > 1000
    assert len(np.unique(picture[::8, ::8].reshape(-1, 3), axis=0)) > 100
    commands = [line.split() for line in printed.splitlines() if line.startswith("  handbench ")]
    assert [parser().parse_args(command[1:]).command for command in commands] == NEXT
    echoes = small / "capture" / "echoes.h5"
    before = echoes.stat().st_mtime_ns
    monkeypatch.setattr(demo, "METHODS", ("2fsk",))
    assert main(["demo"]) == 0
    assert echoes.stat().st_mtime_ns == before and "exists already" in capsys.readouterr().err


def test_every_method_finds_its_tones_in_the_demo():
    there_hz = SceneFile.model_validate(
        tomllib.loads(SCENE.read_text("utf-8"))
    ).sensor.frequencies_hz
    for method in METHODS.values():
        asked_hz = method.defaults.frequencies_hz
        assert np.abs(there_hz[:, None] - asked_hz).min(axis=0).max() < 1e6, method.id

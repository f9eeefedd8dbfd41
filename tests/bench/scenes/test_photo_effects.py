"""The rows of the effects of photographs: on where the scene names the cause."""

from __future__ import annotations

import tomllib
from argparse import Namespace
from collections.abc import Callable
from pathlib import Path

import pytest

from handbench.bench.datasets.native import NativeCapture
from handbench.bench.datasets.simulated import write_photos
from handbench.bench.scenes.photographs import IDEAL, Studio, photo_effects
from handbench.bench.scenes.scene_file import Photos
from handbench.cli import simulate
from handbench.radar.simulation.known_effects import Choice

SCENE = """
version = 1
name = "ball"
target = {kind = "sphere", edge_m = 2e-3}
sensor = {sweep = [], tones_hz = [82e9, 81.8e9, 79.5e9]}
photos = {cameras = 3, width = 600, height = 400}
"""


@pytest.mark.parametrize("effects", ["all", "auto"])
def test_what_is_named_is_on(effects: str) -> None:
    rows = {row.effect: row for row in photo_effects(Photos(effects=effects, motion_px=1.0))}
    assert [name for name, row in rows.items() if row.on] == [
        "photos.blur",
        "photos.motion",
        "photos.noise",
    ]
    assert rows["photos.defocus"].why == "needs photos.f_number"
    ideal = {key: value for keys in IDEAL.values() for key, value in keys.items()}
    assert not any(row.on for row in photo_effects(Photos(**ideal)))


def test_auto_takes_the_same_photographs(ball: Callable[..., Studio]) -> None:
    camera = ball().scene.cameras[0]
    first, second = (
        ball(effects=effects, motion_px=0.01).photograph(camera, 0) for effects in ("all", "auto")
    )
    assert (first == second).all()


def test_the_capture_has_the_rows(ball: Callable[..., Studio], tmp_path: Path) -> None:
    scene = ball.scene(cameras=3, width=300, height=200, motion_px=0.01)
    rows = write_photos(scene, tmp_path, (Choice(effect="obliquity", on=True, why="called for"),))
    assert [row.effect for row in rows[:2]] == ["obliquity", "photos.highlights"]
    assert (
        tomllib.loads((tmp_path / "capture.toml").read_text())["effects"][0]["effect"]
        == "obliquity"
    )
    assert NativeCapture(tmp_path).about.effects == rows


def test_one_table_explains_echoes_and_photographs(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "ball.toml"
    file.write_text(SCENE)
    simulate.run(Namespace(scene=file, explain=True))
    lines = [line for line in capsys.readouterr().out.splitlines() if line.strip()]
    headings = ["depth", "mm", "worst", "mm", "pixels", "%", "level", "dB", "on", "seconds", "why"]
    assert lines[0].split() == ["effect", *headings]
    table = {line.split()[0]: line.split() for line in lines[2:]}
    assert {"obliquity", *(f"photos.{name}" for name in IDEAL)} < set(table)

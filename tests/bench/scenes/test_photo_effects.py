"""Estimates of how far the photographs' effects move the mesh, and the choice that is made by them."""

from __future__ import annotations

import tomllib
from argparse import Namespace
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from handbench.bench.datasets.native import NativeCapture
from handbench.bench.datasets.simulated import write_photos
from handbench.bench.scenes.photo_pilot import WITHOUT, Change, Pilot, choose, without
from handbench.bench.scenes.photographs import Studio
from handbench.cli import simulate
from handbench.radar.simulation.known_effects import Choice

SIZE = {"cameras": 4, "width": 900, "height": 600}
SCENE = """
version = 1
name = "ball"
target = {kind = "sphere", edge_m = 2e-3}
sensor = {sweep = [], tones_hz = [82e9, 81.8e9, 79.5e9]}
photos = {cameras = 3, width = 600, height = 400}
"""
BallStudio = Callable[..., Studio]


@pytest.fixture(scope="module")
def pilot(ball: BallStudio) -> Pilot:
    """With room for the widest blur of these tests."""
    return Pilot(ball(**SIZE, blur_px=3.0))


def moved(pilot: Pilot, **effect: float) -> Change:
    """The change by an effect, alone on ideal photographs."""
    ideal = without(pilot.studio.photos, *WITHOUT)
    return pilot.change(ideal, ideal.model_copy(update=effect))


def test_the_windows_find_the_true_surface(pilot: Pilot) -> None:
    """A plane fitted to a window of the ball lies below it by the window's mean square over two radii; along an axis
    that is seen at an angle, the window is longer by 1 / cosine."""
    height_mm = pilot.mesh_mm(without(pilot.studio.photos, *WITHOUT))
    assert np.isfinite(height_mm).mean() > 0.8
    axis = np.arange(-3, 4) ** 2
    square_m2 = np.average(axis, weights=np.exp(-axis / 18)) * pilot.pixel_m**2 * (1 + pilot.incidence**-2.0)
    assert np.nanmedian(height_mm) == pytest.approx(-1e3 * np.median(square_m2) / (2 * 0.03), rel=0.4)
    assert pilot.incidence.min() > 0.35 and np.bincount(pilot.point).min() >= 3


@pytest.mark.parametrize(
    ("key", "small", "large"),
    [("blur_px", 0.5, 2.0), ("motion_px", 1.0, 5.0), ("read_noise_e", 50.0, 400.0), ("highlights", 0.2, 3.0)],
)
def test_more_of_an_effect_moves_the_mesh_further(pilot: Pilot, key: str, small: float, large: float) -> None:
    amount = {"full_well_e": 1e4} if key == "read_noise_e" else {}
    changes = [moved(pilot, **{key: value}, **amount) for value in (small, large)]
    assert 0 < changes[0].depth_mm < changes[1].depth_mm


def test_nothing_moves_nothing(pilot: Pilot) -> None:
    for values in WITHOUT.values():
        assert moved(pilot, **values) == (0, 0, 0)
    assert moved(pilot, roughness=0.15, focus_m=0.3, speckle_dot_m=1e-3) == (0, 0, 0)


def test_all_that_are_named_are_on_by_default(ball: BallStudio) -> None:
    studio = ball(**SIZE, motion_px=1.0)
    photos, rows = choose(studio)
    assert photos == studio.photos
    assert [row.effect for row in rows if row.on] == ["photos.blur", "photos.motion", "photos.noise"]
    assert all(row.depth_mm is None for row in rows)
    by_name = {row.effect: row for row in rows}
    assert by_name["photos.defocus"].why == "needs photos.f_number"


def test_auto_leaves_out_the_smallest_while_their_sum_stays_below_the_tolerance(ball: BallStudio) -> None:
    given = {"effects": "auto", "motion_px": 0.1, "highlights": 5.0}
    _, explained = choose(ball(**SIZE, **given, tolerance_mm=1e-9))
    assert explained[0].effect == "photos" and explained[0].seconds > 0
    found = {row.effect.removeprefix("photos."): row for row in explained[1:] if row.depth_mm is not None}
    assert set(found) == {"highlights", "blur", "motion", "noise"}
    assert all(row.on for row in found.values())
    sizes = sorted((row.depth_mm, name) for name, row in found.items() if row.pixels_percent <= 3)
    sums = np.cumsum([size for size, _ in sizes])
    studio = ball(**SIZE, **given, tolerance_mm=(sums[0] + sums[1]) / 2)
    photos, rows = choose(studio)
    assert photos == without(studio.photos, sizes[0][1])
    off = [row for row in rows if not row.on and row.depth_mm is not None]
    assert [row.effect for row in off] == [f"photos.{sizes[0][1]}"] and "of" in off[0].why


def test_two_cameras_see_too_little_for_estimates(ball: BallStudio) -> None:
    studio = ball(cameras=2, effects="auto")
    photos, rows = choose(studio)
    assert photos == studio.photos and "no estimates; photos.cameras" in rows[0].why


def test_what_decides_whether_points_match_is_not_left_out(ball: BallStudio, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(Pilot, "change", lambda *_: Change(1e-6, 0.1, 0.0))
    studio = ball(**SIZE, effects="auto")
    photos, rows = choose(studio)
    assert photos == studio.photos and {row.pixels_percent for row in rows if row.depth_mm} == {10.0}


def test_the_capture_tells_the_choice(ball: BallStudio, tmp_path: Path) -> None:
    scene = ball.scene(effects="auto", tolerance_mm=5.0, cameras=3, width=300, height=200, motion_px=0.01)
    echo = Choice(effect="obliquity", on=True, why="called for")
    rows = write_photos(scene, tmp_path, (echo,))
    assert [row.effect for row in rows[:2]] == ["obliquity", "photos"]
    told = tomllib.loads((tmp_path / "capture.toml").read_text())["effects"]
    assert [row["effect"] for row in told] == [row.effect for row in rows]
    assert NativeCapture(tmp_path).about.effects == rows
    motion = next(row for row in told if row["effect"] == "photos.motion")
    assert motion["depth_mm"] >= 0 and motion["pixels_percent"] >= 0 and "matched" in motion["why"]


def test_one_table_explains_echoes_and_photographs(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file = tmp_path / "ball.toml"
    file.write_text(SCENE)
    simulate.run(Namespace(scene=file, explain=True))
    lines = [line for line in capsys.readouterr().out.splitlines() if line.strip()]
    headings = ["depth", "mm", "worst", "mm", "pixels", "%", "level", "dB", "on", "seconds", "why"]
    assert lines[0].split() == ["effect", *headings]
    table = {line.split()[0]: line.split() for line in lines[2:]}
    assert {"obliquity", "photos", *(f"photos.{name}" for name in WITHOUT)} < set(table)
    assert float(table["photos"][2]) > 0 and "processor" in table["photos"] and float(table["photos.blur"][1]) > 0

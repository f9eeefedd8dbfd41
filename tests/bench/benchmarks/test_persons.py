"""Captures of several persons: one scene, as many captures; what is asked wrongly is refused in one
line."""

from __future__ import annotations

from pathlib import Path

import pytest

from handbench.bench.benchmarks.benchmark_file import (
    BenchFile,
    embedded_benchmarks,
    load_benchmark,
    scene_of,
)
from handbench.bench.validation.inspection import inspect
from handbench.support.errors import HandbenchError

SCENE = 'version = 1\nname = "B"\nseed = 7\n[target]\nkind = "hand"\npose = "B"\n'
BALL = 'version = 1\nname = "ball"\n[target]\nkind = "sphere"\n'
HAND = 'scene = "hand.toml"'
BENCH = 'version = 1\nname = "b"\n{}[[method]]\nid = "2fsk"\n'


def bench_file(folder: Path, *captures: str) -> Path:
    (folder / "hand.toml").write_text(SCENE)
    (folder / "ball.toml").write_text(BALL)
    (folder / "b.toml").write_text(
        BENCH.format("".join(f"[[capture]]\n{capture}\n" for capture in captures))
    )
    return folder / "b.toml"


def test_every_person_is_a_capture(tmp_path: Path) -> None:
    path = bench_file(tmp_path, 'scene = "hand.toml"\npersons = [1, 12]', 'scene = "hand.toml"')
    bench, base = load_benchmark(str(path))
    assert [source.persons for source in bench.capture] == [(1,), (12,), None]
    scenes = [scene_of(bench, base, source)[0] for source in bench.capture]
    assert [scene.name for scene in scenes] == ["B-person-01", "B-person-12", "B"]
    targets = [scene.target for scene in scenes]
    assert len({scene.seed for scene in scenes}) == 3
    assert len({target.distance_m for target in targets}) == 3
    assert [target.person for target in targets] == [1, 12, 0]
    assert targets[2].distance_m == 0.31
    kept = bench.model_dump(mode="json", exclude_none=True)  # as config.toml keeps it
    again = BenchFile.model_validate(kept)
    assert [one for source in again.capture for one in source.each()] == list(bench.capture)
    assert not inspect(str(path)).lines


def test_values_of_a_scene_are_replaced(tmp_path: Path) -> None:
    changes = "set = { target.motion.velocity_m_s = 0.1, sensor.step_time_s = 2e-3 }"
    path = bench_file(tmp_path, f'{HAND}\nsuffix = "fast"\n{changes}', HAND)
    bench, base = load_benchmark(str(path))
    scenes = [scene_of(bench, base, source)[0] for source in bench.capture]
    assert [scene.name for scene in scenes] == ["B-fast", "B"]
    fast, before = (scene.model_dump() for scene in scenes)
    assert fast["target"]["motion"].pop("velocity_m_s") == 0.1
    assert before["target"]["motion"].pop("velocity_m_s") == 0
    assert fast["sensor"].pop("step_time_s") == 2e-3 and before["sensor"].pop("step_time_s")
    assert fast | {"name": "B"} == before  # all else is as it was, and so is the seed
    assert not inspect(str(path)).lines
    wrong = bench_file(tmp_path, f'{HAND}\nsuffix = "fast"\nset = {{ target.person = "me" }}')
    [problem] = inspect(str(wrong)).lines
    assert "scene 'B-fast': 'target.person' is 'me'" in problem


@pytest.mark.parametrize(
    ("capture", "words"),
    [
        (f"{HAND}\nset = {{ seed = 1 }}", "set is given without suffix"),
        ('path = "capture"\nsuffix = "fast"', "suffix or persons is given without a scene"),
        (f"{HAND}\npersons = [0]", "persons"),
        ('path = "capture"\npersons = [1]', "persons is given without a scene"),
        (f'{HAND}\nmeasures = ["speed"]', "measures"),
        (f'{HAND}\nmeasures = ["precision"]', "no capture measures the accuracy"),
        (f'{HAND}\n[[capture]]\n{HAND}\nmeasures = ["precision"]', "no method has precision"),
    ],
)
def test_what_cannot_be_meant_is_refused(tmp_path: Path, capture: str, words: str) -> None:
    path = bench_file(tmp_path, capture)
    with pytest.raises(HandbenchError, match=words) as refused:
        load_benchmark(str(path))
    assert "\n" not in str(refused.value)
    assert any(words in problem for problem in inspect(str(path)).lines)


def test_only_hands_have_persons_and_each_once(tmp_path: Path) -> None:
    path = bench_file(tmp_path, 'scene = "ball.toml"\npersons = [1]')
    [problem] = inspect(str(path)).lines
    words = "scene 'ball': its target is of kind 'sphere', but persons"
    assert words in problem
    twice = bench_file(tmp_path, *['scene = "hand.toml"\npersons = [4]'] * 2)
    assert any("two captures are named 'B-person-04'" in text for text in inspect(str(twice)).lines)


def test_the_embedded_hands_are_twelve_people() -> None:
    bench, base = load_benchmark("hands")
    assert sorted(embedded_benchmarks()) == ["hands", "moving_hands", "paper_table", "tradeoff"]
    persons = sorted(number for source in bench.capture for number in source.persons or ())
    assert persons == list(range(1, 13)) and bench.reproduces is None
    assert bench.phase_noise_rad == load_benchmark("paper_table")[0].phase_noise_rad
    for source in bench.capture:
        scene, _ = scene_of(bench, base, source)
        assert scene.photos is None and 0.295 < scene.target.distance_m < 0.325

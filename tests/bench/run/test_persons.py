"""Captures of several persons: one scene, as many captures; what is asked wrongly is refused in one
line."""

from __future__ import annotations

from pathlib import Path

import pytest

from handbench.bench.run import jobs
from handbench.bench.run.benchmark_file import BenchFile, embedded_benchmarks, load_benchmark
from handbench.bench.scenes.hand_pose import POSES
from handbench.bench.scenes.scene_file import HandTarget, SceneFile
from handbench.bench.validation.inspection import problems_of
from handbench.support.config import load
from handbench.support.errors import HandbenchError

SCENE = 'version = 1\nname = "B"\nseed = 7\n[target]\nkind = "hand"\npose = "B"\n'
BALL = 'version = 1\nname = "ball"\n[target]\nkind = "sphere"\n'
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
    stages = [jobs.opening(bench, base, source, 1) for source in bench.capture]
    assert [stage.capture for stage in stages] == ["B-person-01", "B-person-12", "B"]
    scenes = [stage.arguments["scene"] for stage in stages]
    assert (
        len({scene["seed"] for scene in scenes})
        == 3
        == len({scene["target"]["distance_m"] for scene in scenes})
    )
    assert [scene["target"]["person"] for scene in scenes] == [1, 12, 0] and scenes[2]["target"][
        "distance_m"
    ] == 0.31
    again = BenchFile.model_validate(
        bench.model_dump(mode="json", exclude_none=True)
    )  # as config.toml keeps it
    assert [one for source in again.capture for one in source.each()] == list(bench.capture)
    assert list(problems_of(str(path))) == []


@pytest.mark.parametrize(
    ("capture", "words"),
    [
        ('scene = "hand.toml"\npersons = []', "persons"),
        ('scene = "hand.toml"\npersons = [0]', "persons"),
        ('scene = "hand.toml"\npersons = [3, 3]', "names one twice"),
        ('scene = "hand.toml"\npersons = ["Ann"]', "persons"),
        ('scene = "hand.toml"\nperson = [1]', "unknown key"),
        ('path = "capture"\npersons = [1]', "persons need a scene"),
    ],
)
def test_what_cannot_be_meant_is_refused(tmp_path: Path, capture: str, words: str) -> None:
    path = bench_file(tmp_path, capture)
    with pytest.raises(HandbenchError, match=words) as refused:
        load_benchmark(str(path))
    assert "\n" not in str(refused.value)
    assert any(words in problem.text for problem in problems_of(str(path)))


def test_only_hands_have_persons(tmp_path: Path) -> None:
    path = bench_file(tmp_path, 'scene = "ball.toml"\npersons = [1]')
    bench, base = load_benchmark(str(path))
    with pytest.raises(
        HandbenchError, match=r"scene 'ball': has the target 'sphere', but persons are asked for"
    ):
        jobs.opening(bench, base, bench.capture[0], 1)
    assert [
        "has the target 'sphere'" in problem.text and problem.line
        for problem in problems_of(str(path))
    ] == [5]
    twice = bench_file(tmp_path, *['scene = "hand.toml"\npersons = [4]'] * 2)
    assert any(
        "'B-person-04' in hand.toml is named as" in problem.text
        for problem in problems_of(str(twice))
    )


def test_a_scene_names_its_person(tmp_path: Path) -> None:
    (tmp_path / "s.toml").write_text(SCENE + "person = 2\n")
    target = load(SceneFile, tmp_path / "s.toml", "a scene description").target
    assert isinstance(target, HandTarget) and target.person == 2
    assert target.build.palm != (1.0, 1.0, 1.0) and target.angles != POSES["B"]
    (tmp_path / "s.toml").write_text(SCENE + "person = -1\n")
    with pytest.raises(HandbenchError, match="person"):
        load(SceneFile, tmp_path / "s.toml", "a scene description")


def test_the_embedded_hands_are_twelve_people(tmp_path: Path) -> None:
    bench, base = load_benchmark("hands")
    assert sorted(embedded_benchmarks()) == ["hands", "paper_table"]
    assert sorted(number for source in bench.capture for number in source.persons or ()) == list(
        range(1, 13)
    )
    assert (
        bench.reproduces is None
        and bench.phase_noise_rad == load_benchmark("paper_table")[0].phase_noise_rad
    )
    for source in bench.capture:
        scene = jobs.opening(bench, base, source, 1).arguments["scene"]
        assert scene["photos"] is None and 0.295 < scene["target"]["distance_m"] < 0.325

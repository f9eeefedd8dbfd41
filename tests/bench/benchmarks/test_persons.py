"""Captures of several persons: one scene, as many captures; and changed values of a scene."""

from __future__ import annotations

from pathlib import Path

from handbench.bench.benchmarks.benchmark_file import (
    BenchFile,
    embedded_benchmarks,
    load_benchmark,
    scene_of,
)
from handbench.bench.scenes.scene_file import SceneFile

SCENE = 'version = 1\nname = "B"\nseed = 7\n[target]\nkind = "hand"\npose = "B"\n'
HAND = 'scene = "hand.toml"'


def bench_of(folder: Path, *captures: str) -> tuple[BenchFile, list[SceneFile]]:
    """A benchmark of captures of one scene, and their scenes."""
    (folder / "hand.toml").write_text(SCENE)
    text = "".join(f"[[capture]]\n{HAND}\n{capture}\n" for capture in captures)
    (folder / "b.toml").write_text(f'version = 1\nname = "b"\n{text}[[method]]\nid = "2fsk"\n')
    bench, base = load_benchmark(str(folder / "b.toml"))
    return bench, [scene_of(bench, base, source)[0] for source in bench.capture]


def test_every_person_is_a_capture(tmp_path: Path) -> None:
    bench, scenes = bench_of(tmp_path, "persons = [1, 12]", "")
    assert [source.persons for source in bench.capture] == [(1,), (12,), None]
    assert [scene.name for scene in scenes] == ["B-person-01", "B-person-12", "B"]
    targets = [scene.target for scene in scenes]
    assert len({scene.seed for scene in scenes}) == 3
    assert len({target.distance_m for target in targets}) == 3
    assert [target.person for target in targets] == [1, 12, 0]
    assert targets[2].distance_m == 0.31
    kept = bench.model_dump(mode="json", exclude_none=True)  # as config.toml keeps it
    again = BenchFile.model_validate(kept)
    assert [one for source in again.capture for one in source.each()] == list(bench.capture)


def test_values_of_a_scene_are_replaced(tmp_path: Path) -> None:
    changes = "set = { target.motion.velocity_m_s = 0.1, sensor.step_time_s = 2e-3 }"
    _, scenes = bench_of(tmp_path, f'suffix = "fast"\n{changes}', "")
    fast, plain = (scene.model_dump() for scene in scenes)
    assert fast["target"]["motion"].pop("velocity_m_s") == 0.1
    assert plain["target"]["motion"].pop("velocity_m_s") == 0
    assert fast["sensor"].pop("step_time_s") == 2e-3 and plain["sensor"].pop("step_time_s")
    assert (fast.pop("name"), plain.pop("name")) == ("B-fast", "B")
    assert fast == plain  # all else is as it was, and so is the seed


def test_the_embedded_hands_are_twelve_people() -> None:
    bench, base = load_benchmark("hands")
    assert sorted(embedded_benchmarks()) == ["hands", "moving_hands", "paper_table", "tradeoff"]
    persons = sorted(number for source in bench.capture for number in source.persons or ())
    assert persons == list(range(1, 13)) and bench.reproduces is None
    assert bench.phase_noise_rad == load_benchmark("paper_table")[0].phase_noise_rad
    for source in bench.capture:
        scene, _ = scene_of(bench, base, source)
        assert scene.photos is None and 0.295 < scene.target.distance_m < 0.325

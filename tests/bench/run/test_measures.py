"""Captures that measure the accuracy, the precision or both: balls to score, printed ones to
repeat."""

from __future__ import annotations

from pathlib import Path

import pytest

from handbench.bench.benchmarks.benchmark_file import load_benchmark, scene_of
from handbench.bench.evaluation.intervals import precision_mm
from handbench.bench.results.result_folder import load
from handbench.radar.data.echoes_file import load_capture
from tests.bench.run.faults import execute

PRINT = 'scene = "print{}.toml"\nmeasures = ["precision"]'
MEASURED = "\n[[capture]]\n".join(
    ['scene = "ball.toml"\nmeasures = ["accuracy"]', PRINT.format(0), PRINT.format(1)]
)


@pytest.fixture
def printed(small_bench, undoubted) -> Path:
    """The small benchmark: the ball measures the accuracy alone, and two balls the precision, which
    have two tones, of which narrowband makes no image, and cameras."""
    scene = (small_bench.parent / "ball.toml").read_text().replace(", 79.5e9", "")
    for k in range(2):
        changed = scene.replace('"ball"', f'"print{k}"').replace("0.30", f"0.29{k}")
        file = small_bench.parent / f"print{k}.toml"
        file.write_text(f"{changed.replace('seed = 3', f'seed = {k}')}[photos]\ncameras = 2\n")
    small_bench.write_text(small_bench.read_text().replace('scene = "ball.toml"', MEASURED))
    return small_bench


def test_the_precision_is_that_of_captures_that_are_not_scored(printed, small_result, tmp_path):
    result = execute(printed, tmp_path / "out")
    measured = {c.name: (c.measures, c.references) for c in result.about.captures}
    prints = dict.fromkeys(("print0", "print1"), (("precision",), ()))
    assert measured == {"ball": (("accuracy",), ("truth",))} | prints
    assert result.about.failures == () and [capture.name for capture in result.scored()] == ["ball"]
    stages = result.tasks.groupby("capture").stage.agg(lambda names: " ".join(sorted(names)))
    assert stages["ball"] == "inspect reconstruct reconstruct score simulate"
    assert stages["print0"] == "inspect repeat simulate"
    for name, frames in {"ball": 1, "print0": 3}.items():
        [capture] = (tmp_path / "out" / "work").glob(f"simulate-{name}-*/capture")
        assert len(load_capture(capture / "echoes.h5").samples) == frames
        assert not (capture / "photos").exists()
    assert set(result.repeats.capture) == set(prints) and set(result.repeats.method) == {"2fsk"}
    hands = [lines.z_m.to_numpy() for _, lines in result.repeats.groupby("capture")]
    value = result.row("precision_mm", "2fsk", "truth").value
    assert value == pytest.approx(precision_mm(hands), rel=1e-12) and value > 0
    mae = (of.row("mae_mm", "2fsk", "truth").value for of in (result, load(small_result)))
    assert len(set(mae)) == 1  # the accuracy is the ball's, whatever else is measured


def test_the_papers_table_repeats_printed_hands_and_scores_hands_of_skin():
    """Static ones of plastic, each with a placement and a seed of its own, and the same noise as
    skin."""
    bench, base = load_benchmark("paper_table")
    scenes = [(source.measures, scene_of(bench, base, source)[0]) for source in bench.capture]
    assert [(measures, s.target.pose, s.target.material.kind) for measures, s in scenes] == [
        *[(("accuracy",), pose, "skin") for pose in "BFU"],
        *[(("precision",), pose, "plastic") for pose in "BFU"],
    ]
    assert {scene.noise.phase_noise_rad for _, scene in scenes} == {bench.phase_noise_rad}
    assert len({scene.seed for _, scene in scenes}) == 6
    printed = [scene.target for _, scene in scenes[3:]]
    assert len({target.distance_m for target in printed}) == 3
    assert not any(target.motion.amplitude_m or target.motion.velocity_m_s for target in printed)

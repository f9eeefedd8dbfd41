"""Captures that measure the accuracy, the precision or both: balls to score, printed ones to
repeat."""

from __future__ import annotations

import re
import shutil
from pathlib import Path

import pandas as pd
import pytest

from handbench.bench import results
from handbench.bench.datasets.dataset import open_capture
from handbench.bench.evaluation.metrics import precision
from handbench.bench.run import jobs
from handbench.bench.run.benchmark_file import BenchFile, DataSet, load_benchmark
from handbench.bench.run.runner import run
from handbench.bench.run.sweep import Sweep
from handbench.bench.scenes.scene_file import HandTarget, SceneFile
from handbench.bench.tradeoff.run import opened
from handbench.bench.validation.inspection import problems_of
from handbench.radar.data.echoes_file import load_capture
from handbench.support.errors import HandbenchError
from handbench.bench.studies import measure_noise_fit

BOTH = ("accuracy", "precision")
PLASTIC = 'material = { kind = "plastic" }\n[sensor]'


def execute(bench_file: Path, folder: Path) -> results.Result:
    bench, base = load_benchmark(str(bench_file))
    return run(bench, base, folder)


def add(bench_file: Path, *captures: str) -> None:
    """Have the ball measure the accuracy alone, and other captures, each a line, the precision."""
    lines = [f'{capture}\nmeasures = ["precision"]' for capture in captures]
    several = "\n[[capture]]\n".join(['scene = "ball.toml"\nmeasures = ["accuracy"]', *lines])
    bench_file.write_text(bench_file.read_text().replace('scene = "ball.toml"', several))


@pytest.fixture
def printed(small_bench, monkeypatch) -> Path:
    """The small benchmark with two printed balls: of two tones, which narrowband cannot image, and
    with cameras. Nothing is doubted: two tones fit no surface well, and are looked at for long
    (test_inspect)."""
    monkeypatch.setattr("handbench.bench.validation.doubts.of_capture", lambda recorded: iter(()))
    scene = (
        (small_bench.parent / "ball.toml")
        .read_text()
        .replace("[sensor]", PLASTIC)
        .replace(", 79.5e9", "")
    )
    for k in range(2):
        changed = (
            scene.replace('"ball"', f'"print{k}"')
            .replace("0.30", f"0.29{k}")
            .replace("seed = 3", f"seed = {k}")
        )
        (small_bench.parent / f"print{k}.toml").write_text(f"{changed}[photos]\ncameras = 2\n")
    return small_bench


def with_prints(printed: Path) -> Path:
    add(printed, 'scene = "print0.toml"', 'scene = "print1.toml"')
    return printed


def frames_and_files(folder: Path) -> dict[str, tuple[int, bool]]:
    """The number of frames of each simulated capture, and whether it was photographed."""
    found = {}
    for capture in (folder / "work").glob("simulate-*/capture"):
        name = open_capture(capture).about.name
        found[name] = (
            len(load_capture(capture / "echoes.h5").samples),
            (capture / "photos").exists(),
        )
    return found


def test_the_precision_is_that_of_captures_that_are_not_scored(printed, small_result, tmp_path):
    result = execute(with_prints(printed), tmp_path / "out")
    measured = {
        capture.name: (capture.measures, capture.references) for capture in result.about.captures
    }
    assert measured == {
        "ball": (("accuracy",), ("truth",)),
        "print0": (("precision",), ()),
        "print1": (("precision",), ()),
    }
    assert result.about.failures == () and [capture.name for capture in result.scored()] == ["ball"]
    stages = (
        result.tasks.groupby("capture").stage.agg(lambda found: ",".join(sorted(found))).to_dict()
    )
    assert stages == {"ball": "inspect,reconstruct,reconstruct,score,simulate"} | dict.fromkeys(
        ("print0", "print1"), "inspect,repeat,simulate"
    )
    assert frames_and_files(tmp_path / "out") == {
        "ball": (1, False),
        "print0": (3, False),
        "print1": (3, False),
    }
    hands = [lines.z_m.to_numpy() for _, lines in result.repeats.groupby("capture")]
    assert set(result.repeats.capture) == {"print0", "print1"} and set(result.repeats.method) == {
        "2fsk"
    }
    found = result.row("precision_mm", "2fsk", "truth").value
    assert found == pytest.approx(precision(hands)["precision_mm"], rel=1e-12) and found > 0
    assert result.row("pixel_precision_mm", "2fsk", "truth").value > 0
    for method in ("2fsk", "narrowband"):  # the accuracy is the ball's, whatever else is measured
        before = results.load(small_result).row("mae_mm", method, "truth")
        assert result.row("mae_mm", method, "truth").value == before.value
    for folder in ("depth", "errors", "photos"):
        assert list((tmp_path / "out" / folder).glob("print*")) == []
    text = "those that every method of the table finished"
    assert (
        result.about.protocol["basis"]
        == f"1 of 1 captures: {text}; the precision alone: 2 of 2 captures: {text}"
    )
    assert {m.name: set(m.config) for m in result.about.methods} == {
        "2fsk": {"ball", "print0", "print1"},
        "narrowband": {"ball"},
    }


def test_a_capture_of_the_accuracy_alone_enters_no_precision(small_bench, tmp_path):
    add(small_bench)
    result = execute(small_bench, tmp_path / "out")
    assert (
        result.row("mae_mm", "2fsk", "truth").value > 0
        and result.row("precision_mm", "2fsk", "truth") is None
    )
    assert result.repeats.empty and "repeat" not in set(result.tasks.stage)
    assert (
        result.about.protocol["basis"]
        == "1 of 1 captures: those that every method of the table finished"
    )


def test_the_precision_needs_no_reference_and_its_failures_are_its_own(printed, tmp_path):
    execute(with_prints(printed), tmp_path / "out")
    for capture in (tmp_path / "out" / "work").glob("simulate-*/capture"):
        folder, text = (
            printed.parent / open_capture(capture).about.name,
            (capture / "capture.toml").read_text(),
        )
        shutil.copytree(capture, folder)
        (folder / "truth.ply").unlink()
        (folder / "capture.toml").write_text(re.sub(r'"truth.ply"(, )?', "", text))
    printed.write_text(re.sub(r'scene = "(print\d).toml"', r'path = "\1"', printed.read_text()))
    assert [str(problem) for problem in problems_of(str(printed))] == []
    recorded = execute(printed, tmp_path / "recorded")
    simulated = results.load(tmp_path / "out")
    assert recorded.about.failures == () and recorded.repeats.equals(simulated.repeats)
    assert (recorded.table.metric == "precision_mm").any()
    pd.testing.assert_frame_equal(
        *(found.table[found.table.metric == "precision_mm"] for found in (recorded, simulated))
    )
    echoes = printed.parent / "print1" / "echoes.h5"
    echoes.write_bytes(echoes.read_bytes()[:5000])
    spoilt = execute(printed, tmp_path / "recorded")
    assert {failure.capture for failure in spoilt.about.failures} == {"print1"}
    assert "; the precision alone: 1 of 2 captures" in spoilt.about.protocol["basis"]
    assert (
        spoilt.row("mae_mm", "2fsk", "truth").value
        == simulated.row("mae_mm", "2fsk", "truth").value
    )
    assert (
        set(spoilt.repeats.capture) == {"print0"}
        and spoilt.row("precision_mm", "2fsk", "truth").value > 0
    )


TARGET = '[calibration]\nscene = "ball.toml"\nmeasures = ["accuracy"]\n[[method]]\nid = "2fsk"'


@pytest.mark.parametrize(
    ("before", "after", "message"),
    [
        ('measures = ["accuracy"]', 'measures = ["precision"]', "no capture measures the accuracy"),
        ('measures = ["accuracy"]', "measures = []", "measures"),
        ('measures = ["accuracy"]', 'measures = ["accuracy", "accuracy"]', "names one twice"),
        ('measures = ["accuracy"]', 'measures = ["speed"]', "measures.*'accuracy' or 'precision'"),
        (
            "precision = true",
            "precision = false",
            "the precision alone, but no method has precision = true",
        ),
        ('[[method]]\nid = "2fsk"', TARGET, "unknown key 'calibration.*measures'"),
    ],
)
def test_what_nothing_can_be_measured_with_is_refused(printed, before, after, message):
    with_prints(printed).write_text(printed.read_text().replace(before, after))
    with pytest.raises(HandbenchError, match=message):
        load_benchmark(str(printed))


def test_a_benchmark_that_does_not_say_measures_both_and_a_data_set_hands_down(
    small_bench, tmp_path
):
    assert [source.measures for source in load_benchmark(str(small_bench))[0].capture] == [BOTH]
    execute(small_bench, tmp_path / "out")
    folder = next((tmp_path / "out" / "work").glob("simulate-*")) / "capture"
    shutil.copytree(folder, small_bench.parent / "set" / "one")
    for measures in (BOTH, ("precision",)):
        assert [
            s.measures for s in DataSet(path="set", measures=measures).sources(small_bench.parent)
        ] == [measures]


def test_validate_asks_of_a_capture_what_it_measures(printed):
    """Two tones are too few for narrowband, which does not image a capture of the precision."""
    assert [str(problem) for problem in problems_of(str(with_prints(printed)))] == []
    printed.write_text(printed.read_text().replace('["precision"]', '["accuracy"]'))
    found = [str(problem) for problem in problems_of(str(printed))]
    assert len(found) == 2 and all("with method 'narrowband'" in problem for problem in found)


def test_a_trade_off_sweeps_the_captures_of_the_accuracy(printed, tmp_path):
    bench, base = load_benchmark(str(with_prints(printed)))
    bench = bench.model_copy(update={"tradeoff": Sweep(sections=("imaging",))})
    (tmp_path / "work").mkdir()
    assert [c.name for c in opened(bench, base, tmp_path / "work").captures] == ["ball"]


def test_the_noise_is_fitted_to_the_captures_of_the_precision(printed, monkeypatch):
    """To a precision that is 0.1 mm a milliradian."""
    seen = []

    def measured(scenes, config, phase_noise_rad, repeats):
        seen.append(([scene.file.name for scene in scenes], repeats))
        return 100 * phase_noise_rad

    monkeypatch.setattr(measure_noise_fit, "precision_mm", measured)
    fitted = measure_noise_fit.fit(str(with_prints(printed)), wanted_mm=3.6, repeats=None)[-1]
    assert fitted["phase_noise_rad"] == pytest.approx(0.036) and set(map(str, seen)) == {
        "(['print0', 'print1'], 3)"
    }
    printed.write_text(printed.read_text().replace('["precision"]', '["accuracy"]'))
    with pytest.raises(HandbenchError, match="no scene measures the precision"):
        measure_noise_fit.fit(str(printed), wanted_mm=3.6, repeats=None)


def embedded() -> tuple[BenchFile, dict[str, tuple[tuple[str, ...], SceneFile]]]:
    """The paper's table, and its captures: what they measure, and their scenes."""
    bench, base = load_benchmark("paper_table")
    scenes = {}
    for source in bench.capture:
        stage = jobs.opening(bench, base, source, frames=1)
        scenes[str(source.scene)] = (
            source.measures,
            SceneFile.model_validate(stage.arguments["scene"]),
        )
    return bench, scenes


def test_the_papers_table_repeats_printed_hands_and_scores_hands_of_skin():
    """Static ones of plastic, each with a placement and a seed of its own, and the same noise as
    skin."""
    bench, scenes = embedded()
    hands = [scene for measures, scene in scenes.values() if measures == ("accuracy",)]
    printed = [scene for measures, scene in scenes.values() if measures == ("precision",)]
    kinds = [
        [(scene.target.pose, scene.target.material.kind) for scene in some]
        for some in (hands, printed)
    ]
    assert kinds == [[(pose, kind) for pose in "BFU"] for kind in ("skin", "plastic")]
    assert {scene.noise.phase_noise_rad for scene in (*hands, *printed)} == {bench.phase_noise_rad}
    for scene in printed:
        assert isinstance(scene.target, HandTarget)
        assert scene.target.motion.amplitude_m == 0 and scene.target.motion.velocity_m_s == 0
        assert scene.photos is None and len(scene.sensor.frequencies_hz) == 5
    placed = [
        (s.seed, s.target.distance_m, s.target.offset_m, s.target.rotation_deg)
        for s in (*hands, *printed)
    ]
    assert len({seed for seed, *_ in placed}) == 6
    assert all(len(set(values)) == 3 for values in zip(*placed[3:], strict=True))

"""The predicted cost of a run, against runs; what is refused, before anything is made of it."""

import time
from dataclasses import replace
from pathlib import Path

import pytest

from bench.cli.main import main
from bench.datasets.dataset import open_capture
from bench.datasets.native import ECHOES, TRUTH, save_capture_file
from bench.run import planned_cost
from bench.run.benchmark_file import load_benchmark
from bench.run.reconstruct_stage import require_near
from bench.run.runner import run
from bench.studies.study import carried_out
from bench.validation import doubts
from groundtruth.options import predicted as predicted_of_photographs
from radar.data.arrays import AntennaArray
from radar.data.echoes_file import load_capture, save_capture
from radar.methods.registry import method
from radar.support.cost import TERMS_PER_S
from radar.support.errors import HandbenchError


def predicted(bench_file: Path) -> planned_cost.Work:
    return planned_cost.of_run(*load_benchmark(str(bench_file)))


def test_a_small_run_takes_what_was_predicted(small_bench, tmp_path, capsys):
    """Against the peak that the run itself measured, within a factor of three, and its processor time within twenty:
    machines differ, and a wrong unit, or pixels that count as voxels, is further off than they are. A run before loads
    the kernels."""
    run(*load_benchmark(str(small_bench)), tmp_path / "before")
    told = predicted(small_bench)
    capsys.readouterr()
    tasks = run(*load_benchmark(str(small_bench)), tmp_path / "out").tasks
    assert "GB (1 captures × 2 methods)" in capsys.readouterr().err
    assert 1 / 20 < told.core_s / tasks.cpu_seconds.sum() < 20
    assert 1 / 3 < 1e-6 * told.bytes_ / tasks.peak_memory_mb.max() < 3


def test_an_embedded_benchmark_grows_with_its_captures_and_photographs():
    """Processor time that was measured of whole runs on two shared cores: 6 min 8 s of paper_table with draft meshes
    (docs/measurements/groundtruth.md)."""
    bench, base = load_benchmark("paper_table")
    draft = bench.model_copy(update={"groundtruth": bench.groundtruth.model_copy(update={"quality": "draft"})})
    assert 368 / 3 < planned_cost.of_run(draft, base).core_s < 368 * 3
    bench, base = load_benchmark("hands")
    half = bench.model_copy(update={"capture": bench.capture[:6]})
    whole_s, half_s = (planned_cost.of_run(asked, base).core_s for asked in (bench, half))
    assert whole_s == pytest.approx(2 * half_s)


def test_a_sweep_counts_every_setting_on_every_capture():
    bench, base = load_benchmark("hands")
    chosen = planned_cost.ImagingSetting("a", "a", "2fsk", {}, 1, {})
    none, one, both = (planned_cost.of_sweep(bench, base, [chosen] * count, 3).core_s for count in (0, 1, 2))
    assert both - one == pytest.approx(one - none)
    config = method("2fsk").configure({}, "test")
    assert one - none == pytest.approx(12 * planned_cost.imaging(config, frames=3).core_s)


def test_an_exact_sum_has_all_its_terms():
    """Pixels × tones × channels, twice, at the rate of the exact sum."""
    exact, fast = (method("2fsk").configure({"tolerance": each}, "test") for each in (None, 1e-5))
    more_s = planned_cost.imaging(exact, channels=1e6).core_s - planned_cost.imaging(fast, channels=1e6).core_s
    assert more_s == pytest.approx(2 * 301**2 * 2 * 1e6 / TERMS_PER_S)


def test_more_than_the_limit_is_refused_before_the_folder_is_made(small_bench, tmp_path, monkeypatch, capsys):
    monkeypatch.setenv("HANDBENCH_HOURS", "1e-6")
    assert main(["run", str(small_bench), "-o", str(tmp_path / "out")]) == 2
    assert "1 captures × 2 methods: would take about" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("surface", [True, False])
def test_a_capture_is_inspected_in_about_the_time_that_was_predicted(small_bench, tmp_path, surface):
    """Against the processor time of the stage itself, the better of two, so that kernels are loaded: within a factor of
    three, and as much again as machines differ. Without a surface it takes several times as long."""
    capture = tmp_path / "capture"
    assert main(["simulate", str(small_bench.parent / "ball.toml"), "-o", str(capture)]) == 0
    if not surface:
        save_capture_file(capture, open_capture(capture).about.model_copy(update={"contains": (ECHOES,)}))
        (capture / TRUTH).unlink()
    taken_s = []
    for _ in range(2):
        start_s = time.process_time()
        doubts.make(tmp_path, str(capture))
        taken_s.append(time.process_time() - start_s)
    assert 1 / 6 < planned_cost.inspecting(capture) / min(taken_s) < 6
    assert planned_cost.inspecting(None) == planned_cost.FITTED_S


def test_what_cannot_be_opened_counts_nothing_and_is_told_by_the_run(small_bench, tmp_path):
    lost = small_bench.with_name("lost.toml")
    lost.write_text(small_bench.read_text().replace('scene = "ball.toml"', 'path = "nowhere"'))
    assert predicted(lost).core_s == 0


@pytest.mark.parametrize("command", ["run", "reconstruct"])
def test_antennas_in_millimetres_are_refused_before_they_are_imaged(
    small_bench, tmp_path, monkeypatch, capsys, command
):
    folder = small_bench.parent
    assert main(["simulate", str(folder / "ball.toml"), "-o", str(folder / "mm")]) == 0
    kept = load_capture(folder / "mm" / "echoes.h5")
    array = AntennaArray(*(1e3 * leg.position_m for leg in kept.aperture.legs))
    save_capture(folder / "mm" / "echoes.h5", replace(kept, aperture=array))
    bench = folder / "mm.toml"
    bench.write_text(small_bench.read_text().replace('scene = "ball.toml"', 'path = "mm"'))
    asked = [str(bench)] if command == "run" else [str(folder / "mm"), "--method", "2fsk"]
    out = tmp_path / ("out" if command == "run" else "out.npz")
    assert main([command, *asked, "-o", str(out)]) == 2
    assert "are its positions millimetres? multiply them by 1e-3" in capsys.readouterr().err
    assert not list(tmp_path.rglob("*.npz"))
    with pytest.raises(HandbenchError, match="expected 10 m at most"):
        require_near(load_capture(folder / "mm" / "echoes.h5"))
    assert require_near(kept) is kept
    monkeypatch.setenv("HANDBENCH_FARTHEST_M", "100")
    require_near(load_capture(folder / "mm" / "echoes.h5"))


@pytest.mark.parametrize(("count", "megapixels", "quality", "seconds"), [
    (5, 7.5, "draft", 11.3), (5, 7.5, "high", 68.9), (5, 30, "normal", 41.7), (8, 12, "normal", 26.4),
    (8, 48, "draft", 26.8), (8, 48, "high", 241.7), (12, 18, "draft", 30.5), (12, 72, "normal", 101.4),
])  # fmt: skip
def test_photographs_take_what_was_measured_within_a_factor_of_three(count, megapixels, quality, seconds):
    """Against docs/measurements/groundtruth.md, seconds on two cores, of which between one and both worked."""
    assert 2 / 3 < predicted_of_photographs(count, megapixels, quality)[0] / seconds < 3


def test_a_study_tells_after_its_first_case_what_the_others_take_and_refuses_too_much(monkeypatch):
    done: list[int] = []

    def measure(case: int) -> None:
        done.append(case)
        time.sleep(0.02)

    carried_out(range(3), measure, str, "few", alike=True)
    assert done == [0, 1, 2]
    monkeypatch.setenv("HANDBENCH_HOURS", "0.01")
    with pytest.raises(HandbenchError, match=r"many: the other 9999 cases, if .* would take about"):
        carried_out(range(10_000), measure, str, "many", alike=True)
    assert len(done) == 4
    carried_out(range(10_000, 10_002), measure, str, "unlike")
    assert len(done) == 6

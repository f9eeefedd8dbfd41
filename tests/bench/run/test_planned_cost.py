"""The predicted cost of a run by what it counts; what is refused, before anything is made of it."""

from dataclasses import replace

import pytest

from handbench.bench.pipeline.image import require_near
from handbench.bench.run import planned_cost
from handbench.bench.run.benchmark_file import load_benchmark
from handbench.cli.main import main
from handbench.radar.data.arrays import AntennaArray
from handbench.radar.data.echoes_file import load_capture
from handbench.radar.methods.registry import method
from handbench.support.errors import HandbenchError


def test_a_benchmark_grows_with_its_captures_and_its_settings():
    bench, base = load_benchmark("hands")
    half = bench.model_copy(update={"capture": bench.capture[:6]})
    whole_s, half_s = (
        planned_cost.one_after_another(planned_cost.of_run(asked, base).values()).core_s
        for asked in (bench, half)
    )
    assert whole_s == pytest.approx(2 * half_s)
    config = method("2fsk").configure({}, "test")
    one_s, three_s = (planned_cost.imaging(config, frames=n).core_s for n in (1, 3))
    assert three_s > one_s
    exact = method("2fsk").configure({"tolerance": None}, "test")
    assert planned_cost.imaging(exact).core_s > planned_cost.imaging(exact, exact=False).core_s


def test_more_than_the_limit_is_refused_before_the_folder_is_made(
    small_bench, tmp_path, monkeypatch, capsys
):
    """What cannot be opened counts nothing: the run says it."""
    monkeypatch.setenv("HANDBENCH_HOURS", "1e-6")
    assert main(["run", str(small_bench), "-o", str(tmp_path / "out")]) == 2
    assert "1 captures × 2 methods: would take about" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()
    text = small_bench.read_text().replace('scene = "ball.toml"', 'path = "nowhere"')
    small_bench.write_text(text)
    assert planned_cost.of_run(*load_benchmark(str(small_bench))) == {}


def test_only_antennas_within_ten_metres_are_imaged(small_result, monkeypatch):
    kept = load_capture(next(small_result.glob("work/simulate-*/capture/echoes.h5")))
    assert require_near(kept) is kept
    array = AntennaArray(*(1e3 * leg.position_m for leg in kept.aperture.legs))
    far = replace(kept, aperture=array)
    with pytest.raises(HandbenchError, match="expected at most 10 m"):
        require_near(far)
    monkeypatch.setenv("HANDBENCH_FARTHEST_M", "100")
    assert require_near(far) is far

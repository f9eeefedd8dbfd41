"""Rounds of a benchmark: every image is timed in each, and nothing else changes."""

import shutil
from pathlib import Path

from handbench.bench.benchmarks.benchmark_file import load_benchmark
from handbench.bench.datasets.native import CaptureFile
from handbench.bench.run.captures import RunCapture
from handbench.bench.run.runner import image
from tests.bench.run.faults import execute, figures
from tests.bench.run.stages_of_tests import engine_of


def test_each_round_times_every_image_in_an_order_of_its_own(small_bench, tmp_path):
    """Which is the same on every machine; the precision is measured once."""
    bench, base = load_benchmark(str(small_bench))
    bench = bench.model_copy(update={"rounds": 2})
    captures = [RunCapture(Path(name), name, CaptureFile(name=name)) for name in "abcd"]

    def order() -> list[list[tuple[str, str, str]]]:
        rounds = []

        def perform(stages):
            rounds.append([(one.name, one.capture, one.method) for one in stages])
            return dict.fromkeys(stages, Path())

        engine = engine_of(tmp_path / "work", None)
        engine.perform = perform
        image(engine, bench, base, captures)
        return rounds

    first, second = order()
    assert order() == [first, second]
    timed = [one[1:] for one in first if one[0] == "reconstruct"], [one[1:] for one in second]
    assert sorted(timed[0]) == sorted(timed[1]) and len(set(timed[0])) == 8
    assert timed[0] != timed[1] and {one[0] for one in second} == {"time"}
    assert {one[1:] for one in first if one[0] == "repeat"} == {(c, "2fsk") for c in "abcd"}


def test_only_seconds_differ_from_those_of_one_round(small_bench, small_result, tmp_path):
    out = shutil.copytree(small_result, tmp_path / "out")
    small_bench.write_text(small_bench.read_text().replace("seed = 1", "seed = 1\nrounds = 2"))
    result = execute(small_bench, out, overwrite=True)
    made = result.tasks.query("not cached").task
    assert sorted(made) == ["time-ball-2fsk", "time-ball-narrowband"]
    assert figures(out) == figures(small_result)
    seconds = result.scores.query("metric == 'seconds'")
    assert (seconds.groupby("method").size() >= 2).all()

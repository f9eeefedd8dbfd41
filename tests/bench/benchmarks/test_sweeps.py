"""Methods with lists of values: one method for each combination, which can be run again by its
name."""

from pathlib import Path

import pytest

from handbench.bench.benchmarks.benchmark_file import BenchFile, load_benchmark, load_tradeoff
from handbench.bench.validation.inspection import inspect
from handbench.support.errors import HandbenchError

BENCH = 'version = 1\nname = "swept"\n[[capture]]\nscene = "ball.toml"\n[[method]]\n'


def swept(folder: Path, *methods: str, only: tuple[str, ...] = ()) -> BenchFile:
    """The benchmark of a file with these methods."""
    file = folder / "swept.toml"
    file.write_text(BENCH + "\n[[method]]\n".join(methods))
    return load_benchmark(str(file), only)[0]


def test_values_multiply_and_go_into_tables(tmp_path):
    keys = '"x.step_m,y.step_m" = [1e-3, 2e-3], "tones_hz.count" = [32, 64]'
    keys += ", every_nth_antenna = [1, 2]"
    method = f'id = "broadband"\nconfig = {{ tolerance = 1e-3 }}\nsweep = {{ {keys} }}'
    settings = swept(tmp_path, method, 'id = "2fsk"').method
    labels = [entry.label for entry in settings]
    assert len(set(labels)) == 2 * 2 * 2 + 1 and labels[-1] == settings[-1].id == "2fsk"
    last, axis = settings[-2], {"start_m": -0.15, "stop_m": 0.15, "step_m": 2e-3}
    tones = {"start_hz": 72e9, "stop_hz": 82e9, "count": 64}
    assert last.label == "broadband-xy.step-2mm-tones_hz.count-64-1-of-2-antennas"
    assert last.title == "broadband, xy.step 2mm, tones hz.count 64, 1 of 2 antennas"
    assert last.config == {"tolerance": 1e-3, "x": axis, "y": axis, "tones_hz": tones}
    assert last.every_nth_antenna == 2
    [again] = swept(tmp_path, method, only=(last.label,)).method
    assert again == last


def test_a_method_is_listed_several_times_with_different_names(tmp_path):
    fine = 'id = "3fsk"\nname = "fine"\nconfig = { tolerance = 1e-5 }'
    labels = [entry.label for entry in swept(tmp_path, fine, 'id = "3fsk"').method]
    assert labels == ["fine", "3fsk"]


@pytest.mark.parametrize(
    ("method", "words"),
    [
        ('id = "2fsk"\nsweep = { tolerence = [1e-3] }', "did you mean 'tolerance'"),
        ('id = "2fsk"\nsweep = { "tolerance.a" = [1] }', "not in a table of the method"),
        ('id = "2fsk"\nsweep = { tolerance = [] }', "tolerance"),
        ('id = "2fsk"\nsweep = { tolerance = [1e-3, 1e-3] }', "is listed twice"),
        ('id = "2fsk"\nsweep = { every_nth_antenna = [0] }', "greater than or equal to 1"),
        (f'id = "2fsk"\nsweep = {{ seed = {[1] * 40}, tolerance = {[1] * 40} }}', "1600 methods"),
        ('id = "2fsk"\nname = "3fsk"', "same meaning as '3fsk'"),
        ('id = "mine"\nmaps = "m"\nsweep = { tolerance = [1] }', "sweep"),
    ],
)
def test_sweeps_that_cannot_work_are_refused_in_one_line(tmp_path, method, words):
    with pytest.raises(HandbenchError) as refused:
        swept(tmp_path, method)
    assert words in str(refused.value) and "\n" not in str(refused.value)
    file = tmp_path / "swept.toml"
    assert str(file) in str(refused.value)
    assert any(words in problem for problem in inspect(str(file)).lines)


def test_an_unknown_setting_is_refused(tmp_path):
    with pytest.raises(HandbenchError, match="did you mean '2fsk'"):
        swept(tmp_path, 'id = "2fsk"', only=("2fks",))


def test_a_benchmark_without_a_sweep_takes_the_installed_one():
    """Scenes need neither photographs nor a target: their true surface is known."""
    default, _ = load_benchmark("tradeoff")
    bench, _ = load_tradeoff("paper_table")
    assert [entry.label for entry in bench.method] == [entry.label for entry in default.method]
    assert bench.rounds == default.rounds == 3 and bench.calibration == ()
    scenes = [(source.scene, source.photos) for source in bench.capture]
    assert scenes == [(f"hand_{pose}.toml", False) for pose in "bfu"]
    photos = [source.photos for source in load_tradeoff("tradeoff")[0].capture]
    assert photos == [True, False, False]
    [one] = load_tradeoff("paper_table", ["3fsk-tolerance-1e-3"])[0].method
    assert one.config == {"tolerance": 1e-3}

"""Methods with lists of values: one method for each combination, which can be run again by its
name."""

from pathlib import Path

from handbench.bench.benchmarks.benchmark_file import BenchFile, load_benchmark, load_tradeoff

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

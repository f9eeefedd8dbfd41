"""The captures of a benchmark as a folder: what it holds, that it is scored as the benchmark is,
and that a run names a capture that was changed."""

import hashlib
import shutil

import pytest

from handbench.bench.results import load
from handbench.bench.run import capture_set, jobs
from handbench.bench.run.benchmark_file import load_benchmark
from handbench.bench.run.executors import HASH
from handbench.cli.main import main
from tests.small_benchmark import write_bench


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """The set of the small benchmark, beside it."""
    folder = tmp_path_factory.mktemp("sets")
    assert main(["simulate", str(write_bench(folder / "bench")), "-o", str(folder / "set")]) == 0
    return folder


@pytest.fixture
def changed(folder, tmp_path):
    """A copy of the set."""
    shutil.copytree(folder / "set", tmp_path / "set")
    return tmp_path / "set"


@pytest.fixture
def no_settling(monkeypatch):
    monkeypatch.setattr("handbench.bench.run.reconstruct_stage.SETTLE_S", 0.0)


def figures(result):
    """The lines of a result's table that are not times."""
    table = load(result).table
    return table[table.metric != "seconds"].reset_index(drop=True)


@pytest.mark.usefixtures("no_settling")
def test_it_is_scored_as_the_benchmark_is(folder, small_result, tmp_path, capsys):
    """Of all its frames: the small benchmark has the precision of one method, by three frames."""
    assert main(["inspect", str(folder / "set" / "bench.toml")]) == 0
    assert main(["run", str(folder / "set" / "bench.toml"), "-o", str(tmp_path / "r")]) == 0
    assert figures(tmp_path / "r").equals(figures(small_result))
    capsys.readouterr()


def test_its_checksums_are_those_of_sha256sum(folder):
    made = folder / "set"
    lines = dict(
        line.split("  ")[::-1] for line in (made / "checksums.txt").read_text().splitlines()
    )
    files = [file for file in (made / "captures").rglob("*") if file.is_file()]
    assert lines == {
        file.relative_to(made).as_posix(): hashlib.sha256(file.read_bytes()).hexdigest()
        for file in files
    }
    assert "captures/ball/echoes.h5" in lines and "captures/ball/truth.ply" in lines


def append(file):
    file.write_bytes(file.read_bytes() + b"0")


CHANGES = {
    "other content": (
        lambda at: append(at / "echoes.h5"),
        "captures/ball/echoes.h5 has other content",
    ),
    "a file less": (
        lambda at: (at / "truth.ply").rename(at.parent / "truth.ply"),
        "captures/ball/truth.ply is missing",
    ),
    "a file more": (
        lambda at: (at / "mesh.ply").write_text(""),
        "captures/ball/mesh.ply is not in it",
    ),
    "broken checksums": (
        lambda at: (at.parents[1] / "checksums.txt").write_text("0"),
        "line 1 is no SHA-256",
    ),
}


@pytest.mark.parametrize(("change", "words"), CHANGES.values(), ids=CHANGES)
def test_a_run_names_the_capture_that_was_changed(changed, tmp_path, capsys, change, words):
    change(changed / "captures" / "ball")
    about = changed / "captures" / "ball" / "capture.toml"
    if "missing" in words:  # else its own description complains first
        sums = (changed / "checksums.txt").read_text()
        text = about.read_text()
        about.write_text(text.replace(', "truth.ply"', ""))
        old, new = (hashlib.sha256(t.encode()).hexdigest() for t in (text, about.read_text()))
        (changed / "checksums.txt").write_text(sums.replace(old, new))
    assert main(["run", str(changed / "bench.toml"), "-o", str(tmp_path / "r")]) == 2
    written = capsys.readouterr().err
    assert "ball: hash failed: " in written and words in written


def test_captures_that_no_set_lists_are_not_compared(changed, tmp_path, capsys):
    lines = (changed / "checksums.txt").read_text().replace("captures/ball/", "captures/other/")
    (changed / "checksums.txt").write_text(lines)
    append(changed / "captures" / "ball" / "echoes.h5")
    assert main(["inspect", str(changed / "bench.toml")]) == 0
    capsys.readouterr()
    bench, base = load_benchmark(str(changed / "bench.toml"))
    stage = jobs.opening(bench, base, bench.capture[0], frames=1)
    assert stage.name == HASH and jobs.content_key(tmp_path, stage)


def test_an_interrupted_set_goes_on_and_a_whole_one_is_kept(changed, folder, capsys):
    bench, echoes = (
        str(folder / "bench" / "small.toml"),
        changed / "captures" / "ball" / "echoes.h5",
    )
    before = echoes.stat().st_mtime_ns
    assert main(["simulate", bench, "-o", str(changed)]) == 2
    assert "holds a set of captures" in capsys.readouterr().err
    sums = (changed / "checksums.txt").read_text()
    (changed / "checksums.txt").unlink()
    assert main(["simulate", bench, "-o", str(changed)]) == 0
    assert echoes.stat().st_mtime_ns == before and (changed / "checksums.txt").read_text() == sums
    assert main(["simulate", bench, "-o", str(changed), "--overwrite"]) == 0
    again = (changed / "checksums.txt").read_text()
    assert echoes.stat().st_mtime_ns > before and again.splitlines()[1:] == sums.splitlines()[1:]
    assert sums.splitlines()[0].endswith(
        "  captures/ball/capture.toml"
    )  # which has the seconds of effects
    capsys.readouterr()


def test_the_embedded_hands_become_twelve_captures(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(capture_set, "build", lambda scene, place: scene)
    monkeypatch.setattr(
        capture_set, "simulate_capture", lambda scene, at, frames: at.mkdir(parents=True)
    )
    monkeypatch.chdir(tmp_path)
    assert main(["simulate", "hands", "-o", "hands"]) == 0
    bench, _ = load_benchmark("hands/bench.toml")
    known, _ = load_benchmark("hands")
    assert len(bench.capture) == len({source.path for source in bench.capture}) == 12
    assert (
        bench.method == known.method and bench.phase_noise_rad is None and bench.seed == known.seed
    )
    capsys.readouterr()


def test_the_table_with_its_calibration_becomes_captures(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(capture_set, "build", lambda scene, place: scene)
    monkeypatch.setattr(
        capture_set, "simulate_capture", lambda scene, at, frames: at.mkdir(parents=True)
    )
    assert main(["simulate", "paper_table", "-o", str(tmp_path / "table")]) == 0
    bench, _ = load_benchmark(str(tmp_path / "table" / "bench.toml"))
    known, _ = load_benchmark("paper_table")
    assert [source.measures for source in bench.capture] == [
        source.measures for source in known.capture
    ]
    assert [source.path for source in bench.calibration] == ["captures/target"]
    assert bench.model_copy(update={"capture": (), "calibration": ()}) == known.model_copy(
        update={"capture": (), "calibration": (), "phase_noise_rad": None}
    )
    capsys.readouterr()


REFUSED = {
    "a capture": (
        'scene = "ball.toml"',
        'path = "ball"',
        [],
        "expected scenes, which can be simulated",
    ),
    "two of a name": (
        "[[method]]",
        '[[capture]]\nscene = "ball.toml"\n[[method]]',
        [],
        "two captures are named 'ball'",
    ),
    "a command": (
        "[[method]]",
        '[[method]]\nid = "m"\ncommand = "m {capture} {depth}"\n[[method]]',
        [],
        "has a method",
    ),
    "frames": ("[[method]]", "[[method]]", ["--frames", "2"], "without --explain and --frames"),
}


@pytest.mark.parametrize(("old", "new", "options", "words"), REFUSED.values(), ids=REFUSED)
def test_what_cannot_be_simulated_is_refused(tmp_path, capsys, old, new, options, words):
    file = write_bench(tmp_path / "bench")
    shutil.copytree(tmp_path / "bench", tmp_path / "bench" / "ball")
    file.write_text(file.read_text().replace(old, new, 1))
    assert main(["simulate", str(file), "-o", str(tmp_path / "set"), *options]) == 2
    assert words in capsys.readouterr().err and not (tmp_path / "set").exists()


def test_a_folder_of_other_things_is_left_alone(tmp_path, capsys):
    (tmp_path / "set").mkdir()
    (tmp_path / "set" / "mine.txt").write_text("1")
    bench = str(write_bench(tmp_path / "bench"))
    assert main(["simulate", bench, "-o", str(tmp_path / "set"), "--overwrite"]) == 2
    assert "holds files but no bench.toml" in capsys.readouterr().err
    assert [file.name for file in (tmp_path / "set").iterdir()] == ["mine.txt"]

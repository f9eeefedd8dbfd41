"""The captures of a benchmark as a folder: what it holds, that it is scored as the benchmark is,
and that a run names a capture that was changed."""

import hashlib
import shutil

import pytest

from handbench.bench.results import load
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


@pytest.mark.usefixtures("small_bench")  # whose times need not settle
def test_it_is_scored_as_the_benchmark_is(folder, small_result, tmp_path, capsys):
    """Of all its frames: the small benchmark has the precision of one method, by three frames."""
    bench, out = str(folder / "set" / "bench.toml"), tmp_path / "r"
    assert main(["inspect", bench]) == 0 and main(["run", bench, "-o", str(out)]) == 0
    capsys.readouterr()
    tables = [load(result).table.query("metric != 'seconds'") for result in (out, small_result)]
    assert tables[0].equals(tables[1])


def test_its_checksums_are_those_of_sha256sum(folder):
    made = folder / "set"
    files = sorted(file for file in (made / "captures").rglob("*") if file.is_file())
    assert {"capture.toml", "echoes.h5", "truth.ply"} <= {file.name for file in files}
    lines = [
        f"{hashlib.sha256(file.read_bytes()).hexdigest()}  {file.relative_to(made).as_posix()}"
        for file in files
    ]
    assert sorted((made / "checksums.txt").read_text().splitlines()) == sorted(lines)


CHANGES = {
    "other content": ("captures/ball/echoes.h5", "0", "captures/ball/echoes.h5 has changed"),
    "a file less": (
        "checksums.txt",
        f"{64 * '0'}  captures/ball/lost.ply\n",
        "lost.ply is missing",
    ),
    "a file more": ("captures/ball/mesh.ply", "", "captures/ball/mesh.ply is not listed there"),
    "broken checksums": ("checksums.txt", "0\n", "is not a SHA-256"),
}


@pytest.mark.parametrize(("name", "more", "words"), CHANGES.values(), ids=CHANGES)
def test_a_run_names_the_capture_that_was_changed(changed, tmp_path, capsys, name, more, words):
    with (changed / name).open("a") as stream:
        stream.write(more)
    assert main(["run", str(changed / "bench.toml"), "-o", str(tmp_path / "r")]) == 2
    written = capsys.readouterr().err
    assert "ball: hash failed: " in written and words in written


def test_an_interrupted_set_goes_on_and_a_whole_one_is_kept(changed, folder, tmp_path, capsys):
    bench, echoes = str(folder / "bench" / "small.toml"), changed / "captures/ball/echoes.h5"
    before = echoes.stat().st_mtime_ns
    assert main(["simulate", bench, "-o", str(changed)]) == 2
    assert "has a set of captures" in capsys.readouterr().err
    sums = (changed / "checksums.txt").read_text()
    (changed / "checksums.txt").unlink()
    assert main(["simulate", bench, "-o", str(changed)]) == 0
    assert echoes.stat().st_mtime_ns == before and (changed / "checksums.txt").read_text() == sums
    assert main(["simulate", bench, "-o", str(changed), "--overwrite"]) == 0
    again = (changed / "checksums.txt").read_text()
    assert echoes.stat().st_mtime_ns > before and again.splitlines()[1:] == sums.splitlines()[1:]
    # the first has the seconds of effects
    assert sums.splitlines()[0].endswith("  captures/ball/capture.toml")
    strange = tmp_path / "strange"
    strange.mkdir()
    (strange / "mine.txt").write_text("1")
    assert main(["simulate", bench, "-o", str(strange), "--overwrite"]) == 2
    assert "has files but no bench.toml" in capsys.readouterr().err
    assert [file.name for file in strange.iterdir()] == ["mine.txt"]


REFUSED = {
    "a capture": ('scene = "ball.toml"', 'path = "ball"', "only scenes can be simulated"),
    "two of a name": (
        "[[method]]",
        '[[capture]]\nscene = "ball.toml"\n[[method]]',
        "two captures are named 'ball'",
    ),
    "a command": (
        "[[method]]",
        '[[method]]\nid = "m"\ncommand = "m {capture} {depth}"\n[[method]]',
        "has a method",
    ),
}


@pytest.mark.parametrize(("old", "new", "words"), REFUSED.values(), ids=REFUSED)
def test_what_cannot_be_simulated_is_refused(tmp_path, capsys, old, new, words):
    file = write_bench(tmp_path / "bench")
    shutil.copytree(tmp_path / "bench", tmp_path / "bench" / "ball")
    file.write_text(file.read_text().replace(old, new, 1))
    assert main(["simulate", str(file), "-o", str(tmp_path / "set")]) == 2
    assert words in capsys.readouterr().err and not (tmp_path / "set").exists()

"""The captures of a benchmark as a folder, which is scored as the benchmark is."""

import shutil

import pytest

from handbench.bench.results.result_folder import load
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


def test_an_interrupted_set_goes_on_and_a_whole_one_is_kept(changed, folder, tmp_path, capsys):
    bench, ball = str(folder / "bench" / "small.toml"), changed / "captures" / "ball"
    shutil.rmtree(ball)
    assert main(["simulate", bench, "-o", str(changed)]) == 0
    before = (ball / "echoes.h5").stat().st_mtime_ns
    assert main(["simulate", bench, "-o", str(changed)]) == 0
    assert (ball / "echoes.h5").stat().st_mtime_ns == before
    (ball / "notes.txt").write_text("mine")
    assert main(["simulate", bench, "-o", str(changed), "--overwrite"]) == 2
    assert (ball / "notes.txt").read_text() == "mine"
    (ball / "notes.txt").unlink()
    assert main(["simulate", bench, "-o", str(changed), "--overwrite"]) == 0
    assert (ball / "echoes.h5").stat().st_mtime_ns > before
    strange = tmp_path / "strange"
    strange.mkdir()
    (strange / "mine.txt").write_text("1")
    assert main(["simulate", bench, "-o", str(strange), "--overwrite"]) == 2
    assert "has files of something else" in capsys.readouterr().err
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

"""The captures of a benchmark as a folder, which is scored as the benchmark is."""

import shutil

import pytest

from handbench.bench.results.result_folder import load
from handbench.cli.main import main
from tests.bench.run.faults import execute, files_of_at_most
from tests.refusals import refuse_command
from tests.small_benchmark import write_bench


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """The set of the small benchmark, beside it."""
    folder = tmp_path_factory.mktemp("sets")
    assert main(["simulate", str(write_bench(folder / "bench")), "-o", str(folder / "set")]) == 0
    return folder


@pytest.mark.usefixtures("small_bench", "undoubted")  # times need not settle
def test_it_is_scored_as_the_benchmark_is(folder, small_result, tmp_path):
    """Of all its frames: the small benchmark has the precision of one method, by three frames."""
    result = execute(folder / "set" / "bench.toml", tmp_path / "out")
    tables = [of.table.query("metric != 'seconds'") for of in (result, load(small_result))]
    assert tables[0].equals(tables[1])


def test_an_interrupted_set_goes_on_and_no_other_file_is_replaced(folder, tmp_path):
    out = shutil.copytree(folder / "set", tmp_path / "set")
    command = ["simulate", str(folder / "bench" / "small.toml"), "-o", str(out)]
    ball = out / "captures" / "ball"
    shutil.rmtree(ball)
    assert main(command) == 0
    made = (ball / "echoes.h5").stat().st_mtime_ns
    assert main(command) == 0
    assert (ball / "echoes.h5").stat().st_mtime_ns == made
    assert main([*command, "--overwrite"]) == 0
    again = (ball / "echoes.h5").stat().st_mtime_ns
    assert again > made
    with files_of_at_most(100):
        refuse_command([*command, "--overwrite"], str(ball))
    assert (ball / "echoes.h5").stat().st_mtime_ns == again
    for place in (ball, out):
        shutil.rmtree(place)
        place.mkdir()
        (place / "notes.txt").write_text("mine")
        refuse_command([*command, "--overwrite"], str(place))
        assert [file.name for file in place.iterdir()] == ["notes.txt"]


@pytest.mark.parametrize(
    ("old", "new", "place"),
    [
        ('scene = "ball.toml"', 'path = "ball"', "ball"),
        ("[[method]]", '[[capture]]\nscene = "ball.toml"\n[[method]]', "'ball'"),
        ("[[method]]", '[[method]]\nid = "m"\ncommand = "m {capture} {depth}"\n[[method]]', ""),
    ],
)
def test_what_cannot_be_simulated_is_refused(tmp_path, old, new, place):
    """Such as a capture, two captures of a name, and a command."""
    file = write_bench(tmp_path / "bench")
    file.write_text(file.read_text().replace(old, new, 1))
    refuse_command(["simulate", str(file), "-o", str(tmp_path / "set")], str(file), place)
    assert not (tmp_path / "set").exists()

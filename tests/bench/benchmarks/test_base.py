"""A benchmark file that begins with an installed one."""

from pathlib import Path

from handbench.bench.benchmarks.benchmark_file import (
    BenchFile,
    load_benchmark,
    load_tradeoff,
    scene_of,
)
from tests.refusals import refuse

HEAD = 'version = 1\nname = "mine"\n'
MINE = '[[method]]\nid = "mine"\nmaps = "maps"\n'


def test_captures_and_methods_of_the_base_follow_the_files_own(tmp_path: Path) -> None:
    (tmp_path / "maps").mkdir()
    (file := tmp_path / "mine.toml").write_text(f'{HEAD}base = "paper_table"\nrepeats = 3\n{MINE}')
    bench, base = load_benchmark(str(file))
    paper, installed = load_benchmark("paper_table")
    assert [entry.label for entry in bench.method] == ["mine", *(m.label for m in paper.method)]
    assert (bench.name, bench.repeats, bench.frames) == ("mine", 3, paper.frames)
    assert bench.groundtruth == paper.groundtruth and bench.reproduces == "paper"
    for ours, theirs in zip(
        (*bench.capture, *bench.calibration), (*paper.capture, *paper.calibration), strict=True
    ):
        assert scene_of(bench, base, ours) == scene_of(paper, installed, theirs)
    assert [m.label for m in load_tradeoff(str(file))[0].method if m.foreign] == ["mine"]
    kept = bench.model_dump(mode="json", exclude_none=True)  # as config.toml keeps it
    assert BenchFile.model_validate(kept) == bench


def test_a_wrong_base_and_a_wrong_entry_are_named_as_the_file_counts_them(tmp_path: Path) -> None:
    file = tmp_path / "mine.toml"
    for text, place in (
        (f'base = "paper_tabel"\n{MINE}', "'paper_table'"),
        (f'base = ["hands"]\n{MINE}', "'base'"),
        ('base = "hands"\n[[method]]\nmaps = "maps"\n', "'method.0.id'"),
        ('base = "hands"\nmethod = 3\n', "'method'"),
    ):
        file.write_text(HEAD + text)
        refuse(lambda: load_benchmark(str(file)), str(file), place)

"""The store of stages: made once, found again, made anew when anything that they depend on is
another."""

from pathlib import Path

import pytest

import handbench.bench.run.runner  # noqa: F401  it declares the stages
from handbench.support import store
from handbench.support.store import DECLARED, STAMP, Input, Stage, cached
from tests.test_imports import FILES, ROOT, imported, module_of

made: list[int] = []


def make(folder: Path, value: object = None, end: BaseException | None = None) -> None:
    """Counts how often it was called."""
    made.append(len(made))
    (folder / "result.txt").write_text(f"made {len(made)}")
    if end is not None:
        raise end


def forget() -> None:
    """What a new process does not know."""
    for function in (store.source_hash, store.code_key, store.versions):
        function.cache_clear()


@pytest.fixture(autouse=True)
def source(tmp_path, monkeypatch):
    """A file that `make` runs, in a package that stands for handbench."""
    made.clear()
    file = tmp_path / "code" / "handbench" / "support" / "one.py"
    file.parent.mkdir(parents=True)
    file.write_text("a = 1")
    monkeypatch.setattr(store, "PACKAGE", file.parents[1])
    monkeypatch.setitem(DECLARED, make, ("dense", ("support",)))
    forget()
    yield file
    forget()


def dense(**arguments: object) -> Stage:
    return Stage(make, arguments, "hand")


def test_what_was_made_is_found_again(tmp_path):
    first, root = dense(value=1), tmp_path / "work"
    stamp, there = cached(root, first)
    assert not there and stamp.seconds >= 0 and stamp.machine["cores"] >= 1
    assert cached(root, dense(value=1)) == (stamp, True)  # what it cost when it was made
    files = {path.name for path in first.folder(root).iterdir()}
    assert len(made) == 1 and files == {"result.txt", STAMP}


def test_whatever_it_depends_on_gives_another_folder(source, monkeypatch):
    """But not what an input is called, nor what Python compiles."""
    keys = [dense(value=value).key for value in (1, 2, Input("a", 1), Input("a", 2))]
    assert dense(value=Input("elsewhere", 2)).key == keys[-1]
    assert dense(value=1).key == keys[0] == keys[2]
    (source.parent / "__pycache__").mkdir()
    (source.parent / "__pycache__" / "one.pyc").write_text("1")
    forget()
    assert dense(value=1).key == keys[0]
    source.write_text("a = 2")
    forget()
    keys.append(dense(value=1).key)
    monkeypatch.setattr(store.metadata, "version", lambda name: "of tomorrow")
    forget()
    assert len({*keys, dense(value=1).key}) == 4


def test_a_stage_that_was_killed_leaves_nothing_and_is_made_again(tmp_path):
    root = tmp_path / "work"
    with pytest.raises(KeyboardInterrupt):
        cached(root, dense(end=Input(KeyboardInterrupt(), None)))
    assert not list(root.iterdir())
    assert not cached(root, dense(end=Input(None, None)))[1] and len(made) == 2


@pytest.mark.parametrize(
    "content", ["{}", "[]", '{"content": "0"}', '{"seconds": [1]}', "", "[" * 9999], ids=len
)
def test_an_empty_or_foreign_stamp_is_a_broken_one(tmp_path, capsys, content):
    stage, root = dense(), tmp_path / "work"
    cached(root, stage)
    (stage.folder(root) / STAMP).write_text(content)
    assert not cached(root, stage)[1] and len(made) == 2
    assert "computed again" in capsys.readouterr().err


def test_a_damaged_file_is_made_again(tmp_path):
    stage, root = dense(), tmp_path / "work"
    cached(root, stage)
    for damage in (
        lambda file: file.write_text("made 2"),
        Path.unlink,
        lambda file: file.rename(file.with_suffix("")),
    ):
        damage(stage.folder(root) / "result.txt")
        assert not cached(root, stage)[1] and cached(root, stage)[1]


PRODUCT = [one for one in DECLARED if one.__module__.startswith("handbench.")]
NOT_RUN = {
    "radar.methods.ability": "asked by importers of data sets, which no stage runs",
    "radar.simulation.ablation": "simulates by methods, but for `--explain` only",
}
# what a change of the rooms on the right must not make again
FREE = {
    "simulate sparse dense mesh": ("radar/methods/", "bench/evaluation/"),
    "reconstruct repeat time": ("bench/evaluation/metrics.py",),
}


def runs(module: str) -> dict[Path, str]:
    """Every file that a module may run, and the module that imports it."""
    files = {module_of(file): file for file in FILES}
    found, waiting = {files[module]: ""}, [module]
    while waiting:
        module = waiting.pop()
        for full_name, _ in imported(files[module]):
            name = full_name.removeprefix("handbench.")
            name = name if name in files else name.rpartition(".")[0]
            if name in files and name not in NOT_RUN and files[name] not in found:
                found[files[name]] = module
                waiting.append(name)
    return found


@pytest.mark.parametrize("function", PRODUCT, ids=lambda one: f"{one.__module__}.{one.__name__}")
def test_a_stage_names_all_that_it_runs_and_no_room_that_must_not_matter(function):
    name, sources = DECLARED[function]
    places = [p for s in sources for p in (Path(s), Path("handbench", s)) if (ROOT / p).exists()]
    named = {file for file in FILES if {file, *file.parents} & set(places)}
    run = runs(function.__module__.removeprefix("handbench."))
    missing = {f: by for f, by in run.items() if f not in named and f.name != "__init__.py"}
    assert len(places) == len(sources) and missing == {}
    for names, rooms in FREE.items():
        if name in names.split():
            assert not [file for file in named if file.as_posix().startswith(rooms)]

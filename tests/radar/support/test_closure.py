"""The keys of the stages: what an edit of any module changes, held against another library's graph of the imports."""

import ast
import shutil

import grimp
import numpy as np
import pytest

from radar.support.closure import PACKAGES, ROOT, Sources, installed

STAGES = {
    "simulate": "bench.run.simulate_stage",
    "inspect": "bench.validation.doubts",
    "sparse": "groundtruth.sparse_stage",
    "dense": "groundtruth.dense_stage",
    "mesh": "groundtruth.mesh_stage",
    "calibrate": "bench.run.calibrate_stage",
    "reconstruct": "bench.run.reconstruct_stage",
    "repeat": "bench.run.repeat_stage",
    "score": "bench.run.scoring",
    "method": "radar.methods.presets",
}


@pytest.fixture(scope="module")
def graph() -> grimp.ImportGraph:
    """Who imports whom, by grimp: its own parser, types' imports left out as here."""
    return grimp.build_graph(*PACKAGES, exclude_type_checking_imports=True, cache_dir=None)


def reached(graph: grimp.ImportGraph, start: str) -> set[str]:
    """All that runs when `start` does: what it imports, with the packages on the way, and what these import."""
    found: set[str] = set()
    waiting = {start}
    while waiting:
        module = waiting.pop()
        found.add(module)
        parents = {module.rpartition(".")[0]} - {""}
        waiting |= (graph.find_modules_directly_imported_by(module) | parents) - found
    return found


def test_an_edit_of_any_module_changes_the_keys_of_exactly_the_stages_that_run_it(graph, tmp_path):
    for package in PACKAGES:
        ignore = shutil.ignore_patterns("__pycache__")
        shutil.copytree(ROOT / package, tmp_path / package, ignore=ignore)
    expected = {name: reached(graph, module) for name, module in STAGES.items()}
    whole_tree = Sources(tmp_path)
    before = keys(whole_tree)
    files = sorted(file for package in PACKAGES for file in (tmp_path / package).rglob("*.py"))
    assert len(files) > 300
    for file in files:
        module = ".".join(file.relative_to(tmp_path).with_suffix("").parts).removesuffix(".__init__")
        whole = file.read_bytes()
        file.write_bytes(whole + b"# edited\n")
        edited = Sources(tmp_path)
        edited._modules = {name: read for name, read in whole_tree._modules.items() if name != module}  # saves time
        after = keys(edited)
        file.write_bytes(whole)
        changed = {name for name in STAGES if after[name] != before[name]}
        assert changed == {name for name in STAGES if module in expected[name]}, module
    assert keys(Sources(tmp_path)) == before


def keys(sources: Sources) -> dict[str, str]:
    return {name: sources.key(module) for name, module in STAGES.items()}


def test_keys_are_sharp():
    """What only shows results, or runs them, makes no stage anew."""
    showing = ("reports", "bench.cli", "bench.studies", "bench.validation")
    for name, module in STAGES.items():
        ours = Sources().closure(module)[0]
        aside = "bench.validation" if name == "inspect" else "nothing"  # the room that it is in
        assert not [m for m in ours if m.startswith(showing) and not m.startswith(aside)], name
        assert not {"bench.run.runner", "bench.run.outcome", "bench.run.jobs", "radar.support.store"} & set(ours), name
    for name in ("reconstruct", "inspect"):
        assert not [m for m in Sources().closure(STAGES[name])[0] if m.startswith("bench.results")], name


CASES = {
    "a statement": ("import bench.two", {"bench.two"}),
    "a module of a package": ("from bench import two", {"bench.two"}),
    "a name of a module": ("from bench.two import f", {"bench.two"}),
    "in a function": ("def f():\n    try:\n        pass\n    finally:\n        from bench import two", {"bench.two"}),
    "in a case": ("match 1:\n    case 1:\n        import bench.two", {"bench.two"}),
    "in a class": ("class A:\n    async def f(self):\n        import bench.two", {"bench.two"}),
    "relative": ("from . import two", {"bench.two"}),
    "relative, a name": ("from .two import f", {"bench.two"}),
    "by name": ("from importlib import import_module\nx = import_module('bench.two')", {"bench.two"}),
    "by name, in words": ("import importlib\nf(importlib.import_module('bench.two').g)", {"bench.two"}),
    "through another": ("import radar.three", {"radar", "radar.three", "bench.two"}),
    "for types": ("from typing import TYPE_CHECKING\nif TYPE_CHECKING:\n    import bench.two", set()),
    "or else": ("import typing\nif typing.TYPE_CHECKING:\n    pass\nelse:\n    import bench.two", {"bench.two"}),
    "nothing": ("'import bench.two'", set()),
}


@pytest.mark.parametrize("case", CASES)
def test_every_way_to_import(tmp_path, case):
    code, expected = CASES[case]
    for name, text in (("bench/one", code), ("bench/two", ""), ("radar/three", "import bench.two")):
        file = tmp_path / f"{name}.py"
        file.parent.mkdir(exist_ok=True)
        file.write_text(text)
        (file.parent / "__init__.py").touch()
    assert set(Sources(tmp_path).closure("bench.one")[0]) - {"bench", "bench.one"} == expected


def test_other_libraries_count_with_their_versions(tmp_path, monkeypatch):
    (tmp_path / "bench").mkdir()
    (tmp_path / "bench" / "one.py").write_text("import cv2.aruco, json\nfrom numpy.linalg import norm\nimport nowhere")
    assert Sources(tmp_path).closure("bench.one") == (["bench.one"], ["cv2", "nowhere", "numpy"])
    assert installed("nowhere") == ("nowhere none",) and installed("numpy") == (f"numpy {np.__version__}",)
    assert installed("cv2")[0].startswith("opencv-contrib-python-headless ")
    before = Sources(tmp_path).key("bench.one")
    monkeypatch.setattr("radar.support.closure.installed", lambda name: (f"{name} of tomorrow",))
    assert Sources(tmp_path).key("bench.one") != before
    with pytest.raises(ModuleNotFoundError, match=r"bench\.no: is no module"):
        Sources(tmp_path).key("bench.no")


def test_data_beside_a_module_count_with_it(tmp_path):
    (tmp_path / "bench" / "data").mkdir(parents=True)
    (tmp_path / "bench" / "one.py").write_text("import bench.two")
    (tmp_path / "bench" / "two.py").write_text("from pathlib import Path\nx = Path(__file__).parent / 'data'")
    (tmp_path / "bench" / "plain.py").write_text("")

    def found() -> tuple[str, str]:
        return Sources(tmp_path).key("bench.one"), Sources(tmp_path).key("bench.plain")

    seen = [found()]
    for name in ("a.toml", "data/b.html"):
        for text in ("x = 1", "x = 2"):
            (tmp_path / "bench" / name).write_text(text)
            seen.append(found())
    assert len({one for one, _ in seen}) == 5 and len({plain for _, plain in seen}) == 1
    (tmp_path / "bench" / "__pycache__").mkdir()
    for compiled in ("two.cpython-311.pyc", "two.kernel-12.py311.nbi"):  # by Python and by numba, as it runs
        (tmp_path / "bench" / "__pycache__" / compiled).write_text("1")
    assert found() == seen[-1]


def test_nothing_that_a_stage_runs_is_imported_under_a_name_that_nobody_can_read():
    """`import_module(name)` would hide what it imports: no stage's code has it. The registry's plug-ins have their own
    key."""
    for module in {module for start in STAGES.values() for module in Sources().closure(start)[0]}:
        file = ROOT.joinpath(*module.split("."))
        file = file / "__init__.py" if file.is_dir() else file.with_suffix(".py")
        calls = [ast.unparse(n) for n in ast.walk(ast.parse(file.read_bytes())) if isinstance(n, ast.Call)]
        assert not [call for call in calls if call.split("(")[0].endswith(("import_module", "__import__"))], module

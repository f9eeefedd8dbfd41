"""The keys of the stages: what an edit of any module changes, held against another library's graph
of the imports."""

import ast
import sys
from importlib.util import find_spec
from pathlib import Path

import grimp
import pytest

from handbench.support.code_hash import Sources, installed
from tests.installed_copy import copy_package

STAGES = {
    "simulate": "handbench.bench.stages.simulate",
    "inspect": "handbench.bench.validation.capture_warnings",
    "sparse": "handbench.groundtruth.sparse_stage",
    "dense": "handbench.groundtruth.dense_stage",
    "mesh": "handbench.groundtruth.mesh_stage",
    "calibrate": "handbench.bench.stages.calibrate",
    "reconstruct": "handbench.bench.stages.reconstruct",
    "repeat": "handbench.bench.run.repeat_stage",
    "score": "handbench.bench.run.scoring",
    "method": "handbench.radar.methods.presets",
}


@pytest.fixture(scope="module")
def graph(tmp_path_factory) -> grimp.ImportGraph:
    """Who imports whom, by grimp: its own parser, types' imports left out as here."""
    site = tmp_path_factory.mktemp("site")
    copy_package(site, compiled=False)
    with pytest.MonkeyPatch.context() as patch:  # grimp looks for the package as an import would
        patch.delitem(sys.modules, "handbench")
        patch.syspath_prepend(site)
        return grimp.build_graph("handbench", exclude_type_checking_imports=True, cache_dir=None)


def reached(graph: grimp.ImportGraph, start: str) -> set[str]:
    """All that runs when `start` does: what it imports, with the packages on the way, and what
    these import."""
    found: set[str] = set()
    waiting = {start}
    while waiting:
        module = waiting.pop()
        found.add(module)
        parents = {module.rpartition(".")[0]} - {""}
        waiting |= (graph.find_modules_directly_imported_by(module) | parents) - found
    return found


@pytest.mark.slow
def test_an_edit_of_any_module_changes_the_keys_of_exactly_the_stages_that_run_it(graph, tmp_path):
    root = copy_package(tmp_path, compiled=False)
    expected = {name: reached(graph, module) for name, module in STAGES.items()}
    whole_tree = Sources(root)
    before = keys(whole_tree)
    files = sorted(root.rglob("*.py"))
    assert len(files) > 250
    for file in files:
        module = ".".join(file.relative_to(tmp_path).with_suffix("").parts).removesuffix(
            ".__init__"
        )
        whole = file.read_bytes()
        file.write_bytes(whole + b"# edited\n")
        edited = Sources(root)
        edited._modules = {
            name: read for name, read in whole_tree._modules.items() if name != module
        }  # saves time
        after = keys(edited)
        file.write_bytes(whole)
        changed = {name for name in STAGES if after[name] != before[name]}
        assert changed == {name for name in STAGES if module in expected[name]}, module
    assert keys(Sources(root)) == before


def keys(sources: Sources) -> dict[str, str]:
    return {name: sources.key(module) for name, module in STAGES.items()}


CASES = {
    "in a function": (
        "def f():\n    try:\n        pass\n    finally:\n        from handbench.bench import two",
        {"handbench.bench.two"},
    ),
    "relative, through another": (
        "from ..radar import three",
        {"handbench.radar", "handbench.radar.three", "handbench.bench.two"},
    ),
    "for types": (
        "from typing import TYPE_CHECKING\nif TYPE_CHECKING:\n    import handbench.bench.two",
        set(),
    ),
}


@pytest.mark.parametrize("case", CASES)
def test_imports_are_followed(tmp_path, case):
    code, expected = CASES[case]
    for name, text in (
        ("bench/one", code),
        ("bench/two", ""),
        ("radar/three", "import handbench.bench.two"),
    ):
        file = tmp_path / f"{name}.py"
        file.parent.mkdir(exist_ok=True)
        file.write_text(text)
        (file.parent / "__init__.py").touch()
    assert (
        set(Sources(tmp_path).imports_of("handbench.bench.one")[0])
        - {"handbench.bench", "handbench.bench.one"}
        == expected
    )


def test_other_libraries_count_with_their_versions(tmp_path, monkeypatch):
    (tmp_path / "bench").mkdir()
    (tmp_path / "bench" / "one.py").write_text(
        "import cv2.aruco, json\nfrom numpy.linalg import norm\nimport nowhere"
    )
    assert Sources(tmp_path).imports_of("handbench.bench.one") == (
        ["handbench.bench.one"],
        ["cv2", "nowhere", "numpy"],
    )
    assert installed("nowhere") == ("nowhere none",)
    assert installed("cv2")[0].startswith("opencv-contrib-python-headless ")
    before = Sources(tmp_path).key("handbench.bench.one")
    monkeypatch.setattr(
        "handbench.support.code_hash.installed", lambda name: (f"{name} of tomorrow",)
    )
    assert Sources(tmp_path).key("handbench.bench.one") != before
    with pytest.raises(ModuleNotFoundError, match=r"handbench\.bench\.no: there is no such module"):
        Sources(tmp_path).key("handbench.bench.no")


def test_data_beside_a_module_count_with_it(tmp_path):
    (tmp_path / "bench" / "data").mkdir(parents=True)
    (tmp_path / "bench" / "one.py").write_text("import handbench.bench.two")
    (tmp_path / "bench" / "two.py").write_text(
        "from pathlib import Path\nx = Path(__file__).parent / 'data'"
    )
    (tmp_path / "bench" / "plain.py").write_text("")

    def found(module: str = "one") -> str:
        return Sources(tmp_path).key(f"handbench.bench.{module}")

    seen, plain = [found()], found("plain")
    for name in ("a.toml", "data/b.html"):
        for text in ("x = 1", "x = 2"):
            (tmp_path / "bench" / name).write_text(text)
            seen.append(found())
    assert len(set(seen)) == 5 and found("plain") == plain
    (tmp_path / "bench" / "__pycache__").mkdir()  # of Python and numba, as it runs
    for compiled in ("two.cpython-311.pyc", "two.kernel-12.py311.nbi"):
        (tmp_path / "bench" / "__pycache__" / compiled).write_text("1")
    assert found() == seen[-1]


def test_nothing_that_a_stage_runs_is_imported_under_a_name_that_nobody_can_read():
    """`import_module(name)` would hide what it imports: no stage's code has it. The registry's
    plug-ins have their own key, and the package's own file looks up what its users name."""
    modules = {module for start in STAGES.values() for module in Sources().imports_of(start)[0]}
    for module in modules - {"handbench"}:
        source = Path(str(find_spec(module).origin)).read_bytes()
        if b"import_module" in source or b"__import__" in source:
            calls = (n.func for n in ast.walk(ast.parse(source)) if isinstance(n, ast.Call))
            called = {ast.unparse(call) for call in calls}
            assert not [c for c in called if c.endswith(("import_module", "__import__"))], module

"""Data flows one way: no package imports another against the table of the design."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from functools import cache
from graphlib import TopologicalSorter
from pathlib import Path

import pytest

from tests.rooms import ROOMS

ROOT = Path(__file__).parents[1]
BELOW_CLI = ("support", "radar", "calibration", "groundtruth", "bench")
MAY_IMPORT = {
    "support": (),
    "radar": ("support",),
    "calibration": ("support", "radar"),
    "groundtruth": ("support", "radar.data", "calibration.transforms"),
    "bench": BELOW_CLI[:-1],
    "reports": ("support", "bench.evaluation", "bench.results"),
    "cli": (*BELOW_CLI, "reports", "interface"),
    "interface": BELOW_CLI,  # and reports and cli, inside functions
}
ONE_DOOR = {  # imports that need preparation, or a licence of their own, happen in one place
    "numba": "handbench/support/compiled.py",
    "open3d": "handbench/support/rays.py",
    "pycolmap": "groundtruth/cameras.py",
    "pymeshlab": "bench/scenes/implicit.py",  # under the GPL, see the README
}
FACE = ("handbench/__init__.py", "handbench/__main__.py")  # they import what they are asked for
STUDIES = "bench.studies"  # scripts, which nothing else may need
FILES = [
    file.relative_to(ROOT)
    for top in (*ROOMS, "handbench")
    for file in sorted((ROOT / top).rglob("*.py"))
    if file.relative_to(ROOT).as_posix() not in FACE
]


def module_of(file: Path) -> str:
    """A file's module, without handbench."""
    return ".".join(file.with_suffix("").parts).removesuffix(".__init__").removeprefix("handbench.")


@cache
def imported(file: Path) -> list[tuple[str, bool]]:
    """Every imported module's full name, and whether it is imported inside a function; those for
    types alone are left out."""

    def walk(node: ast.AST, lazy: bool) -> Iterator[tuple[str, bool]]:
        if isinstance(node, ast.If) and ast.unparse(node.test).endswith("TYPE_CHECKING"):
            return
        if isinstance(node, ast.Import):
            yield from ((alias.name, lazy) for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            assert not node.level, f"{file}: imports are absolute"
            yield from ((f"{node.module}.{alias.name}", lazy) for alias in node.names)
        elif isinstance(node, ast.Call) and ast.unparse(node.func).endswith("import_module"):
            yield from ((a.value, lazy) for a in node.args[:1] if isinstance(a, ast.Constant))
        for child in ast.iter_child_nodes(node):
            yield from walk(child, lazy or isinstance(node, ast.FunctionDef))

    return list(walk(ast.parse((ROOT / file).read_text("utf-8")), False))


@pytest.mark.parametrize("package", MAY_IMPORT)
def test_imports_follow_the_table(package):
    wrong = []
    files = [file for file in FILES if module_of(file).partition(".")[0] == package]
    for file in files:
        for full_name, lazy in imported(file):
            name = full_name.removeprefix("handbench.")
            top, _, _ = name.partition(".")
            allowed = (package, *MAY_IMPORT[package])
            if package == "interface" and lazy:
                allowed = (*allowed, "reports", "cli")
            if top in MAY_IMPORT and not f"{name}.".startswith(tuple(f"{a}." for a in allowed)):
                wrong.append(f"{file} imports {name} against the table")
            if full_name.partition(".")[0] in ROOMS:
                wrong.append(f"{file} imports {full_name}, a second copy of handbench.{full_name}")
            if top in ONE_DOOR and file.as_posix() != ONE_DOOR[top]:
                wrong.append(f"{file} imports {top}; only {ONE_DOOR[top]} may")
            if name.startswith("scipy.stats") and not lazy:
                wrong.append(f"{file} imports scipy.stats, which takes a second, at its top")
            if name.startswith(STUDIES) and not module_of(file).startswith(STUDIES):
                wrong.append(f"{file} imports a study")
    assert files and wrong == []


def test_no_rooms_import_each_other():
    """A room is the folder below its package, or the module itself where it stands beside the
    rooms. A circle raises CycleError, which names it."""
    modules = {module_of(file): file for file in FILES}
    graph: dict[str, set[str]] = {}
    for module, file in modules.items():
        here = ".".join(module.split(".")[:2])
        for name in (full_name.removeprefix("handbench.") for full_name, _ in imported(file)):
            known = name if name in modules else name.rpartition(".")[0]
            there = ".".join(known.split(".")[:2])
            if known in modules and there != here and known.split(".")[0] == file.parts[0]:
                graph.setdefault(here, set()).add(there)
    assert len(graph) > 20 and list(TopologicalSorter(graph).static_order())

"""Data flows one way: no package imports another against the table of the design."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from graphlib import TopologicalSorter
from pathlib import Path

import pytest

from tests.installed_copy import ROOMS

ROOT = Path(__file__).parents[1]
MAY_IMPORT = {
    "support": (),
    "radar": ("support",),
    "calibration": ("support", "radar"),
    "groundtruth": ("support", "radar.data", "calibration.transforms"),
    "bench": ("support", "radar", "calibration", "groundtruth"),
    "reports": ("support", "bench.results"),
    "cli": (
        "support",
        "radar",
        "calibration",
        "groundtruth",
        "bench",
    ),  # and reports, inside functions
    "interface": ("support", "radar", "calibration", "groundtruth", "bench"),
}
ONE_DOOR = {  # imports that need preparation, or a licence of their own, happen in one place
    "open3d": "handbench/support/rays.py",
    "pycolmap": "groundtruth/cameras/cameras.py",
    "pymeshlab": "bench/scenes/implicit.py",  # under the GPL, see the README
}
FACE = ("handbench/__init__.py", "handbench/__main__.py")  # they import what they are asked for
FILES = sorted(
    path.relative_to(ROOT) for top in (*ROOMS, "handbench") for path in (ROOT / top).rglob("*.py")
)


def package_of(file: Path) -> str:
    """The package of the table that a file belongs to."""
    return file.parts[1].removesuffix(".py") if file.parts[0] == "handbench" else file.parts[0]


def parents(file: Path) -> tuple[str, ...]:
    """The names of the package that a file is in, from handbench on."""
    return ("handbench", *(part for part in file.parent.parts if part != "handbench"))


def imported(tree: ast.AST, module: tuple[str, ...]) -> Iterator[tuple[str, bool, bool]]:
    """Every imported module's full name; whether it is imported lazily, inside a function; whether
    for types alone. `module` names the importing package, to resolve relative imports."""

    def walk(node: ast.AST, lazy: bool, types: bool) -> Iterator[tuple[str, bool, bool]]:
        if isinstance(node, ast.Import):
            yield from ((alias.name, lazy, types) for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            parents = module[: len(module) - node.level + 1] if node.level else ()
            base = ".".join([*parents, *filter(None, [node.module])])
            yield from ((f"{base}.{alias.name}", lazy, types) for alias in node.names)
        elif isinstance(node, ast.Call) and ast.unparse(node.func).endswith(
            ("import_module", "__import__")
        ):
            yield from (
                (name.value, lazy, types)
                for name in node.args[:1]
                if isinstance(name, ast.Constant)
            )
        lazy = lazy or isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef)
        guarded = isinstance(node, ast.If) and ast.unparse(node.test).endswith("TYPE_CHECKING")
        for child in ast.iter_child_nodes(node):
            yield from walk(child, lazy, types or guarded)

    yield from walk(tree, False, False)


def violations(source: str, file: Path) -> list[str]:
    """What the file (a path below the root) imports and may not."""
    package = package_of(file)
    wrong = []
    for full_name, lazy, types in imported(ast.parse(source), parents(file)):
        name = full_name.removeprefix("handbench.")
        top = name.split(".")[0]
        if full_name.split(".")[0] in ROOMS:
            wrong.append(f"{file} imports {full_name}, a second copy of handbench.{full_name}")
            continue
        if top in ONE_DOOR and not types and file.as_posix() != ONE_DOOR[top]:
            wrong.append(f"{file} imports {top}; only {ONE_DOOR[top]} may")
        if top not in MAY_IMPORT or top == package or types:
            continue
        allowed = any(f"{name}.".startswith(f"{prefix}.") for prefix in MAY_IMPORT[package])
        if package in ("cli", "interface") and top in ("reports", "cli", "interface"):
            allowed = lazy
        if not allowed:
            wrong.append(f"{file} imports {name} against the table")
    return wrong


@pytest.mark.parametrize("file", [file for file in FILES if file.as_posix() not in FACE], ids=str)
def test_imports_follow_the_table(file):
    assert violations((ROOT / file).read_text(encoding="utf-8"), file) == []


def test_every_package_is_walked():
    assert {package_of(file) for file in FILES if file.as_posix() not in FACE} == set(MAY_IMPORT)


@pytest.mark.parametrize(
    ("file", "source"),
    [
        ("radar/a.py", "import handbench.calibration"),
        ("radar/a.py", "def f():\n    from handbench.bench.run import runner"),
        ("radar/simulation/effects/a.py", "from ....bench.run import runner"),
        ("radar/a.py", "import importlib\nimportlib.import_module('handbench.reports.page.html')"),
        ("calibration/a.py", "from handbench.groundtruth import mesh"),
        ("groundtruth/a.py", "from handbench.radar.imaging.api import image_points"),
        ("groundtruth/a.py", "from handbench.calibration.spheres.description import Target"),
        ("groundtruth/a.py", "import numpy, handbench.bench"),
        ("bench/run/runner.py", "def f():\n    import handbench.reports"),
        ("handbench/cli/main.py", "import handbench.reports"),
        ("reports/a.py", "from handbench.bench.run import runner"),
        ("reports/a.py", "from handbench.bench import results, run"),
        ("reports/a.py", "import handbench.bench"),
        ("reports/a.py", "import handbench.radar"),
        ("calibration/a.py", "import radar"),
        ("bench/a.py", "from radar.support.errors import HandbenchError"),
        ("reports/a.py", "from handbench.bench.results_extra import x"),
        ("bench/a.py", "import open3d as o3d"),
        ("calibration/a.py", "def f():\n    import open3d"),
        ("groundtruth/a.py", "import pycolmap"),
        ("bench/tradeoff/a.py", "def f():\n    import pymeshlab"),
    ],
)
def test_a_forbidden_import_is_noticed(file, source):
    assert len(violations(source, Path(file))) == 1


@pytest.mark.parametrize(
    ("file", "source"),
    [
        (
            "radar/a.py",
            "import numpy\nfrom handbench.support.errors import HandbenchError\nfrom .files "
            "import inside",
        ),
        ("calibration/a.py", "from handbench.radar.data.arrays import qar50"),
        (
            "groundtruth/a.py",
            "from handbench.calibration.transforms import umeyama\nfrom handbench.support import "
            "errors",
        ),
        (
            "bench/scenes/a.py",
            "import handbench.radar\nfrom handbench.groundtruth import board\nfrom . import hand",
        ),
        ("handbench/cli/main.py", "def report():\n    from handbench.reports import html"),
        (
            "reports/a.py",
            "from handbench.bench.results import load\nfrom handbench.bench import results",
        ),
        (
            "groundtruth/a.py",
            "from typing import TYPE_CHECKING\nif TYPE_CHECKING:\n    import pycolmap",
        ),
        ("handbench/support/rays.py", "import open3d"),
    ],
)
def test_an_allowed_import_passes(file, source):
    assert violations(source, Path(file)) == []


def room(module: str) -> str:
    """The room of a module: the folder below its package, or the module itself where it stands
    beside the rooms."""
    package, first, *_ = module.split(".") + [""]
    return f"{package}.{first}"


def room_imports() -> dict[str, set[str]]:
    """Room → the rooms of the same package that its files import."""
    modules = {
        ".".join(file.with_suffix("").parts).removesuffix(".__init__"): file for file in FILES
    }
    modules = {name.removeprefix("handbench."): file for name, file in modules.items()}
    found: dict[str, set[str]] = {}
    for module, file in modules.items():
        found_in = imported(ast.parse((ROOT / file).read_text("utf-8")), parents(file))
        for name, types in (
            (full_name.removeprefix("handbench."), types) for full_name, _, types in found_in
        ):
            known = name if name in modules else name.rpartition(".")[0]
            if (
                known in modules
                and not types
                and known.partition(".")[0] == file.parts[0]
                and "." in known
            ):
                found.setdefault(room(module), set()).add(room(known))
    return {here: there - {here} for here, there in found.items()}


def test_no_rooms_import_each_other():
    graph = room_imports()
    assert len(graph) > 20
    assert list(
        TopologicalSorter(graph).static_order()
    )  # raises CycleError, which names the circle


@pytest.mark.parametrize(
    ("package", "most"),
    [
        ("handbench", 2),
        ("radar", 6),
        ("calibration", 8),
        ("groundtruth", 8),
        ("bench", 9),
        ("reports", 8),
    ],
)
def test_a_package_has_few_rooms(package, most):
    rooms = {file.parts[1] for file in FILES if file.parts[0] == package and len(file.parts) > 2}
    assert len(rooms) <= most, sorted(rooms)

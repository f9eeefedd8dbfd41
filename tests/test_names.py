"""One name, one meaning: files and docstrings."""

from __future__ import annotations

import ast
import re
from collections import defaultdict
from collections.abc import Iterable
from pathlib import Path

import pytest

from tests.installed_copy import ROOMS

ROOT = Path(__file__).parents[1]
PACKAGES = (*ROOMS, "handbench")
FILES = sorted(
    path.relative_to(ROOT) for package in PACKAGES for path in (ROOT / package).rglob("*.py")
)
QUESTION = re.compile(r"(What|How|Whether|Where|Who)\b")


def meaning(file: Path) -> str:
    """The idea that a file's name stands for: files of one name may share it, and no other."""
    match file.parts:
        case [*_, "__init__.py" | "__main__.py"]:
            return file.as_posix()
        case ["handbench", "cli", _]:
            return f"the command's own file {file}"
        case [*above, "cpu" | "gpu", _]:
            return f"on either device, in {'/'.join(above)}"
    return file.as_posix()


def clashes(files: Iterable[Path]) -> list[list[str]]:
    """The files whose name stands for two ideas. A file named after its command stands beside what
    the command does."""
    named = defaultdict(list)
    for file in files:
        if file.name not in ("__init__.py", "__main__.py") and file.parts[:2] != (
            "handbench",
            "cli",
        ):
            named[file.name].append(file)
    return [
        [f.as_posix() for f in same]
        for same in named.values()
        if len({meaning(f) for f in same}) > 1
    ]


def test_no_file_name_stands_twice_with_two_meanings():
    assert clashes(FILES) == []


@pytest.mark.parametrize(
    ("files", "clash"),
    [
        (
            [
                "radar/__init__.py",
                "bench/__init__.py",
                "bench/a/__main__.py",
                "bench/b/__main__.py",
            ],
            False,
        ),
        (["handbench/cli/compare.py", "bench/evaluation/compare.py"], False),
        (["radar/imaging/cpu/leaf.py", "radar/imaging/gpu/leaf.py"], False),
        (["handbench/support/errors.py", "bench/evaluation/errors.py"], True),
        (["bench/a/page.py", "reports/page/page.py"], True),
        (["bench/a/other.py", "bench/b/other.py"], True),
        (["radar/imaging/cpu/leaf.py", "groundtruth/dense/gpu/leaf.py"], True),
    ],
)
def test_clashes_are_noticed(files, clash):
    assert bool(clashes(map(Path, files))) == clash


def questions(source: str) -> list[int]:
    """The lines of docstrings that begin with a question word instead of what the thing is or
    does."""
    kinds = ast.Module | ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef
    told = [
        node
        for node in ast.walk(ast.parse(source))
        if isinstance(node, kinds) and ast.get_docstring(node)
    ]
    return sorted(node.body[0].lineno for node in told if QUESTION.match(ast.get_docstring(node)))


@pytest.mark.parametrize(
    "room", sorted({"/".join(file.parts[:2]).removesuffix(".py") for file in FILES})
)
def test_docstrings_say_what_a_thing_is_or_does(room):
    files = [file for file in FILES if "/".join(file.parts[:2]).removesuffix(".py") == room]
    found = [
        f"{file}:{line}" for file in files for line in questions((ROOT / file).read_text("utf-8"))
    ]
    assert found == []


def test_questions_are_noticed():
    source = (
        '"""What."""\n\n\ndef f():\n    r"""How it\n    runs."""\n\n\nclass A:\n    '
        '"""Whatever."""\n'
    )
    assert questions(source) == [1, 5]

"""The distribution installs what the repository holds, and its files agree on what it is."""

import re
import tomllib
from importlib.util import find_spec
from pathlib import Path

ROOT = Path(__file__).parents[1]
TOPS = ("radar", "calibration", "groundtruth", "bench", "reports")
PYPROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))


def test_every_folder_with_code_is_installed():
    include = PYPROJECT["tool"]["setuptools"]["packages"]["find"]
    assert include["include"] == [f"{top}*" for top in TOPS]
    for top in TOPS:
        for folder in {file.parent for file in (ROOT / top).rglob("*.py")}:
            assert (folder / "__init__.py").is_file(), f"{folder} has code but no __init__.py"


def test_every_package_says_that_it_is_typed():
    assert all((ROOT / top / "py.typed").is_file() for top in TOPS)
    assert PYPROJECT["tool"]["setuptools"]["package-data"]["*"] == ["py.typed"]


def test_every_package_is_typed_and_covered():
    assert PYPROJECT["tool"]["mypy"]["packages"] == list(TOPS)
    assert PYPROJECT["tool"]["coverage"]["run"]["source"] == list(TOPS)


def test_citation_and_changelog_are_of_this_version():
    version = PYPROJECT["project"]["version"]
    cited = re.search(r"^version: (\S+)$", (ROOT / "CITATION.cff").read_text("utf-8"), re.MULTILINE)
    assert cited is not None and cited[1] == version
    newest = re.search(r"^## (\S+)$", (ROOT / "CHANGELOG.md").read_text("utf-8"), re.MULTILINE)
    assert newest is not None and newest[1] == version


def test_the_moved_modules_of_the_changelog_are_there():
    rows = re.findall(r"^\| `.*` \| (`.*`) \|$", (ROOT / "CHANGELOG.md").read_text("utf-8"), re.MULTILINE)
    modules = [name for row in rows for name in re.findall(r"`([\w.]+)`", row)]
    assert len(modules) > 20
    assert [name for name in modules if find_spec(name) is None] == []

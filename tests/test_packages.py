"""The distribution installs what the repository holds, and its files agree on what it is."""

import re
import shutil
import subprocess
import sys
import tomllib
import zipfile
from pathlib import Path

from tests.installed_copy import ROOMS

ROOT = Path(__file__).parents[1]
PYPROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))


def test_every_folder_with_code_is_installed_inside_handbench():
    folders = {
        file.parent.relative_to(ROOT)
        for top in (*ROOMS, "handbench")
        for file in (ROOT / top).rglob("*.py")
    }
    assert [
        str(folder) for folder in folders if not (ROOT / folder / "__init__.py").is_file()
    ] == []
    packages = {
        ".".join(("handbench", *folder.parts))
        for folder in folders
        if folder.parts[0] != "handbench"
    }
    packages |= {".".join(folder.parts) for folder in folders if folder.parts[0] == "handbench"}
    assert sorted(PYPROJECT["tool"]["setuptools"]["packages"]) == sorted(packages)
    places = PYPROJECT["tool"]["setuptools"]["package-dir"]
    assert places == {"handbench": "handbench"} | {f"handbench.{room}": room for room in ROOMS}


def test_every_data_file_is_installed(tmp_path):
    """The files of the repository that are no code, and those of a wheel, whose only top-level name
    is handbench."""
    tree = tmp_path / "tree"
    names = subprocess.run(
        ["git", "ls-files", "-z"], cwd=ROOT, capture_output=True, text=True, check=True
    ).stdout
    for name in names.split("\0"):
        if name and (ROOT / name).is_file() and not name.startswith("tests/"):
            (tree / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copyfile(ROOT / name, tree / name)
    build = [
        sys.executable,
        "-m",
        "pip",
        "wheel",
        "--quiet",
        "--no-deps",
        "--no-build-isolation",
        "--wheel-dir",
    ]
    subprocess.run(
        [*build, str(tmp_path), str(tree)], check=True, capture_output=True, cwd=tmp_path
    )
    [wheel] = tmp_path.glob("*.whl")
    with zipfile.ZipFile(wheel) as content:
        installed = {name for name in content.namelist() if ".dist-info/" not in name}
        [top] = [
            content.read(name) for name in content.namelist() if name.endswith("top_level.txt")
        ]
    assert top == b"handbench\n" and {name.split("/")[0] for name in installed} == {"handbench"}
    rooms = {
        f"handbench/{name}"
        for name in names.split("\0")
        if name.startswith(tuple(f"{room}/" for room in ROOMS))
    }
    assert installed == {
        name for name in rooms | {n for n in names.split("\0") if n.startswith("handbench/")}
    }


def test_all_code_is_typed_and_covered():
    assert (ROOT / "handbench" / "py.typed").is_file()
    assert PYPROJECT["tool"]["mypy"]["packages"] == ["handbench"]
    assert set(PYPROJECT["tool"]["coverage"]["run"]["source"]) == {*ROOMS, "handbench"}


def test_a_bare_import_of_a_room_is_banned():
    """In a clone it would load a second copy of the module."""
    assert set(PYPROJECT["tool"]["ruff"]["lint"]["flake8-tidy-imports"]["banned-api"]) == set(ROOMS)


def test_citation_and_changelog_are_of_this_version():
    version = PYPROJECT["project"]["version"]
    cited = re.search(r"^version: (\S+)$", (ROOT / "CITATION.cff").read_text("utf-8"), re.MULTILINE)
    assert cited is not None and cited[1] == version
    newest = re.search(r"^## (\S+)$", (ROOT / "CHANGELOG.md").read_text("utf-8"), re.MULTILINE)
    assert newest is not None and newest[1] == version

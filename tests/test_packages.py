"""The distribution installs what the repository holds, and its files agree on what it is."""

import re
import shutil
import subprocess
import sys
import tomllib
import zipfile
from pathlib import Path

from tests.rooms import ROOMS

ROOT = Path(__file__).parents[1]
PYPROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))


def test_every_file_is_installed(tmp_path):
    """The files of the repository and those of a wheel, whose only top-level name is handbench."""
    tree, listing = tmp_path / "tree", ["git", "ls-files", "-z"]
    listed = subprocess.run(listing, cwd=ROOT, capture_output=True, text=True, check=True).stdout
    names = [name for name in listed.split("\0") if name and not name.startswith("tests/")]
    for name in names:
        (tree / name).parent.mkdir(parents=True, exist_ok=True)
        shutil.copyfile(ROOT / name, tree / name)
    build = f"from setuptools.build_meta import build_wheel; build_wheel({str(tmp_path)!r})"
    subprocess.run([sys.executable, "-c", build], check=True, capture_output=True, cwd=tree)
    [wheel] = tmp_path.glob("*.whl")
    with zipfile.ZipFile(wheel) as content:
        installed = {name for name in content.namelist() if ".dist-info/" not in name}
    rooms = {f"handbench/{name}" for name in names if name.partition("/")[0] in ROOMS}
    assert installed == rooms | {name for name in names if name.startswith("handbench/")}


def test_citation_and_changelog_are_of_this_version():
    version = PYPROJECT["project"]["version"]
    for file, line in (("CITATION.cff", r"^version: (\S+)$"), ("CHANGELOG.md", r"^## (\S+)$")):
        found = re.search(line, (ROOT / file).read_text("utf-8"), re.MULTILINE)
        assert found is not None and found[1] == version

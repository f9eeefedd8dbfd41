"""What the distribution installs is what the repository holds."""

import tomllib
from pathlib import Path

ROOT = Path(__file__).parents[1]


def test_every_folder_with_code_is_installed():
    include = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["tool"]["setuptools"]["packages"]["find"]
    tops = ("radar", "calibration", "groundtruth", "bench", "reports")
    assert include["include"] == [f"{top}*" for top in tops]
    for top in tops:
        for folder in {file.parent for file in (ROOT / top).rglob("*.py")}:
            assert (folder / "__init__.py").is_file(), f"{folder} has code but no __init__.py"

"""The documentation's commands are known, its links lead somewhere, its files are valid; and a
convention that no other test holds."""

from __future__ import annotations

import importlib.util
import re
import shlex
import tomllib
from pathlib import Path

import numpy as np
import pytest

from handbench.bench.benchmarks.benchmark_file import BenchFile
from handbench.bench.datasets.mapping import Mapping
from handbench.bench.datasets.native import CaptureFile
from handbench.bench.scenes.scene_file import HandTarget, Mount, SceneFile
from handbench.calibration.transforms import load_transform
from handbench.cli import main

ROOT = Path(__file__).parents[1]
DOCS = ROOT / "docs"
PAGES = [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *sorted(DOCS.rglob("*.md"))]
FENCE = re.compile(r"^```(\w*)\n(.*?)^```", re.DOTALL | re.MULTILINE)
MODELS = {
    "target": SceneFile,
    "method": BenchFile,
    "base": BenchFile,
    "samples": Mapping,
}  # table → file that has it

every_page = pytest.mark.parametrize(
    "page", PAGES, ids=lambda page: page.relative_to(ROOT).as_posix()
)


def blocks(page: Path, language: str) -> list[str]:
    """The page's fenced blocks in a language ("" for none)."""
    return [code for found, code in FENCE.findall(page.read_text("utf-8")) if found == language]


@every_page
def test_commands_are_known(page):
    """Lines to type, scripts, modules and targets of the Makefile."""
    text, typed = page.read_text("utf-8"), "".join(blocks(page, ""))
    for line in [*typed.splitlines(), *re.findall("`(handbench [^`]* -o [^`]*)`", text)]:
        if line.startswith("handbench "):
            main.parser().parse_args(shlex.split(line, comments=True)[1:])
    for module in re.findall(r"python -m ((?:handbench|tests|docs)[\w.]*)", text):
        assert importlib.util.find_spec(module.rstrip(".")), module
    makefile = (ROOT / "Makefile").read_text("utf-8")
    for target in re.findall(r"^(?:.*`)?make ([a-z-]+)", typed, re.MULTILINE):
        assert f"\n{target}:" in makefile, target


@every_page
def test_links_lead_to_files_and_headings(page):
    for target in re.findall(r"\]\(([^)\s]+)\)", FENCE.sub("", page.read_text("utf-8"))):
        file, _, heading = target.partition("#")
        there = page.parent / file if file else page
        assert "://" in target or there.exists(), target
        assert "://" in target or not heading or heading in headings(there), target


def headings(page: Path) -> set[str]:
    """The anchors of a page's headings, as GitHub makes them."""
    lines = re.findall(r"^#+ (.+)$", FENCE.sub("", page.read_text("utf-8")), re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", line.lower()).replace(" ", "-") for line in lines}


@every_page
def test_files_are_valid(page, tmp_path):
    """Every TOML block that is a whole file, and every transform."""
    for code in blocks(page, "toml"):
        content = tomllib.loads(code)
        if "version" in content:
            next((MODELS[key] for key in MODELS if key in content), CaptureFile).model_validate(
                content
            )
    for code in blocks(page, "json"):
        if '"matrix"' in code:
            (tmp_path / "t.json").write_text(code, "utf-8")
            load_transform(tmp_path / "t.json").require("photo", "radar", "page")


# A convention


def test_targets_and_boards_are_placed():
    """An unturned target has the radar's axes; an unturned board faces the radar: its x points to
    the right of who looks at it from there, y up, z towards the radar."""
    target = HandTarget(kind="hand", pose="F", distance_m=0.3, offset_m=(0.01, -0.02))
    moved_m = target.radar_from_target().points(np.eye(3))
    np.testing.assert_allclose(moved_m, np.eye(3) + (0.01, -0.02, 0.3), atol=1e-15)
    board = Mount(rotation_deg=(0, 0, 0)).radar_from_photo()
    np.testing.assert_allclose(board.rotation, np.diag([-1, 1, -1]), atol=1e-15)

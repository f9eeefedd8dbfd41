"""The recipes of docs/recipes.md: every program runs, every command of the page is typed, and finds
the point that the program has put there (its own `point_m`)."""

import re
import shlex

import numpy as np
import pytest

from handbench.cli.main import main
from tests.test_docs import DOCS, blocks

PAGE = DOCS / "recipes.md"
FEWER = [
    "--set",
    "x.start_m=-0.03",
    "--set",
    "x.stop_m=0.03",
    "--set",
    "y.start_m=-0.03",
    "--set",
    "y.stop_m=0.03",
]
# Folder of the recipe's capture → its map's file; fewer pixels, to be quick; how near the point is
# found in x, y, z (half a pixel or voxel; of phases, which take the path's slope as 2, a
# millimetre); and where x points the other way.
RECIPES = {
    "cascade": ("cascade.npz", [], (1e-6, 1e-6, 5.1e-3), (-1, 1, 1)),
    "ring": ("ring.npz", [], (1.3e-3, 1.3e-3, 1e-6), (1, 1, 1)),
    "raster": ("2fsk.npz", FEWER, (1e-6, 1e-6, 1.5e-3), (1, 1, 1)),
    "array": ("array.npz", FEWER, (1e-6, 1e-6, 1e-3), (1, 1, 1)),
}


@pytest.mark.parametrize("name", RECIPES)
def test_a_recipe_leads_to_its_point(name, tmp_path, monkeypatch, capsys):
    file, fewer, near_m, turned = RECIPES[name]
    monkeypatch.chdir(tmp_path)
    [code] = [code for code in blocks(PAGE, "python") if f'Path("{name}").mkdir()' in code]
    made: dict = {}
    exec(compile(code, PAGE.name, "exec"), made)
    commands = [
        line
        for block in blocks(PAGE, "")
        for line in block.splitlines()
        if f" {name} " in f"{line} "
    ]
    assert commands
    for command in commands:
        words = shlex.split(command)[1:]
        assert main([*words, *(fewer if words[0] == "reconstruct" else [])]) == 0
    with np.load(tmp_path / file) as depth:
        row, column = np.unravel_index(depth["amplitude_db"].argmax(), depth["z_m"].shape)
        found_m = np.array([depth["x_m"][column], depth["y_m"][row], depth["z_m"][row, column]])
    assert (np.abs(found_m - made["point_m"] * turned) <= near_m).all(), found_m
    said = capsys.readouterr()
    lines = (
        [line for told in blocks(PAGE, "text") for line in told.splitlines()]
        if name == "raster"
        else []
    )
    assert len(lines) == 2 * (name == "raster")
    for line in lines:  # but for the numbers of pixels
        assert re.sub(r"\d+ of \d+", "", line) in re.sub(r"\d+ of \d+", "", said.err)
    assert ("136 of its 256 pairs were not measured" in said.out) == (name == "ring")

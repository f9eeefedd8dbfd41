"""The recipes of docs/recipes.md: every program runs, every command of the page is typed, and finds
the point that the program has put there (its own `point_m`)."""

import re
import shlex

import numpy as np
import pytest

from handbench.cli.main import main
from tests.test_docs import DOCS, blocks

PAGE = DOCS / "recipes.md"
FEWER = [f"--set={end}" for a in "xy" for end in (f"{a}.start_m=-0.03", f"{a}.stop_m=0.03")]
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
    lines = "".join(blocks(PAGE, "")).splitlines()
    commands = [shlex.split(line)[1:] for line in lines if f" {name} " in f"{line} "]
    assert commands
    for words in commands:
        assert main([*words, *(fewer if words[0] == "reconstruct" else [])]) == 0
    with np.load(tmp_path / file) as depth:
        row, column = np.unravel_index(depth["amplitude_db"].argmax(), depth["z_m"].shape)
        found_m = np.array([depth["x_m"][column], depth["y_m"][row], depth["z_m"][row, column]])
    assert (np.abs(found_m - made["point_m"] * turned) <= near_m).all(), found_m
    printed = capsys.readouterr()
    if name == "raster":  # the page's own lines, but for the numbers of pixels
        for line in "".join(blocks(PAGE, "text")).splitlines():
            assert re.sub(r"\d+ of \d+", "", line) in re.sub(r"\d+ of \d+", "", printed.err)
    assert ("136 of its 256 pairs of antennas were not measured" in printed.out) == (name == "ring")

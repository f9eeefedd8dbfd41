"""`handbench draw`: a target or a board, to print."""

import argparse
import hashlib
from pathlib import Path

from handbench.bench.scenes.stand import stand_board
from handbench.calibration.spheres.description import Target, default_target, save_target
from handbench.cli.options import free
from handbench.groundtruth.board.board import Board, save_board
from handbench.support.config import parse, read_toml
from handbench.support.errors import HandbenchError
from handbench.support.progress import say

EXPECTED = "a calibration target ([[element]]) or a board ([[marker]], [charuco])"
SHA_DIGITS, NAME_LETTERS = 12, 30  # of a file, in the title


def run(options: argparse.Namespace) -> None:
    """A target's or a board's description → a drawing at true scale, or the description itself as TOML."""
    from handbench.reports.drawings.board_drawing import board_sheets
    from handbench.reports.drawings.sheets import check_suffix, save
    from handbench.reports.drawings.target_drawing import target_sheets

    check_suffix(options.out, (".svg", ".pdf", ".toml"))
    free(options.out, options.overwrite)
    thing, title = _described(options.what)
    suffix = options.out.suffix.lower()
    if suffix == ".toml":
        if isinstance(thing, Target):
            save_target(options.out, thing)
        else:
            save_board(options.out, thing)
        say(f"{options.out}: {title}")
        return
    paper = options.paper or ("fit" if suffix == ".svg" else "A4")
    figures = target_sheets(thing, title, paper) if isinstance(thing, Target) else board_sheets(thing, title, paper)
    save(options.out, figures)
    width, height = figures[0].get_size_inches() * 25.4
    say(f"{options.out}: {title}, {len(figures)} sheet(s) of {width:.0f} × {height:.0f} mm; print at 100 %")


def _described(what: str) -> tuple[Target | Board, str]:
    """The subject of the drawing, and its title: a file's with the first digits of its SHA-256."""
    if what == "target":
        return default_target(), "Calibration target, built in"
    if what == "stand":
        return stand_board(), "Board of the simulated stand, built in"
    values = read_toml(what, f"'target', 'stand', {EXPECTED}")
    if not values.keys() & {"element", "marker", "charuco"}:
        raise HandbenchError(f"{what}: describes neither; expected {EXPECTED}")
    name = "".join(c if c.isprintable() else "?" for c in Path(what).name)  # it goes to the terminal too
    name = name if len(name) <= NAME_LETTERS else f"{name[: NAME_LETTERS - 3]}..."
    digest = hashlib.sha256(Path(what).read_bytes()).hexdigest()[:SHA_DIGITS]
    if "element" in values:
        return parse(Target, values, what), f"Calibration target, {name} (SHA-256 {digest})"
    return parse(Board, values, what), f"Board, {name} (SHA-256 {digest})"

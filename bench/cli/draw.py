"""`handbench draw`: a target or a board, to print."""

from __future__ import annotations

import argparse
import hashlib
from pathlib import Path
from typing import TYPE_CHECKING

from bench.cli.options import free
from radar.support.errors import HandbenchError

if TYPE_CHECKING:  # --help answers without them
    from calibration.target.description import Target
    from groundtruth.board.board import Board

EXPECTED = "a calibration target ([[element]]) or a board ([[marker]], [charuco])"
SHA_DIGITS, NAME_LETTERS = 12, 30  # of a file, in the title


def run(options: argparse.Namespace) -> None:
    """A target's or a board's description → a drawing at true scale, or the description itself as TOML."""
    from calibration.target.description import Target
    from radar.support.progress import say
    from reports.drawings.board_drawing import board_sheets
    from reports.drawings.sheets import check_suffix, save
    from reports.drawings.target_drawing import target_sheets

    check_suffix(options.out, (".svg", ".pdf", ".toml"))
    free(options.out, options.overwrite)
    thing, title = _described(options.what)
    suffix = options.out.suffix.lower()
    if suffix == ".toml":
        _save_description(options.out, thing)
        say(f"{options.out}: {title}")
        return
    paper = options.paper or ("fit" if suffix == ".svg" else "A4")
    figures = (target_sheets if isinstance(thing, Target) else board_sheets)(thing, title, paper)
    save(options.out, figures)
    width, height = figures[0].get_size_inches() * 25.4
    say(f"{options.out}: {title}, {len(figures)} sheet(s) of {width:.0f} × {height:.0f} mm; print at 100 %")


def _described(what: str) -> tuple[Target | Board, str]:
    """The subject of the drawing, and its title: a file's with the first digits of its SHA-256."""
    from bench.scenes.stand import stand_board
    from calibration.target.description import Target, default_target
    from groundtruth.board.board import Board
    from radar.support.config import parse, read_toml

    if what == "target":
        return default_target(), "Calibration target, built in"
    if what == "stand":
        return stand_board(), "Board of the simulated stand, built in"
    values = read_toml(what, f"'target', 'stand', {EXPECTED}")
    if not values.keys() & {"element", "marker", "charuco"}:
        raise HandbenchError(f"{what}: describes neither; expected {EXPECTED}")
    model, kind = (Target, "Calibration target") if "element" in values else (Board, "Board")
    name = "".join(c if c.isprintable() else "?" for c in Path(what).name)  # it goes to the terminal too
    name = name if len(name) <= NAME_LETTERS else f"{name[: NAME_LETTERS - 3]}..."
    digest = hashlib.sha256(Path(what).read_bytes()).hexdigest()[:SHA_DIGITS]
    return parse(model, values, what), f"{kind}, {name} (SHA-256 {digest})"


def _save_description(path: Path, thing: Target | Board) -> None:
    from calibration.target.description import Target, save_target
    from groundtruth.board.board import save_board

    (save_target if isinstance(thing, Target) else save_board)(path, thing)

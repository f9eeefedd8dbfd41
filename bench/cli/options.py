"""Options that several commands share, and refusals to overwrite."""

from __future__ import annotations

import argparse
from pathlib import Path

from radar.support.errors import HandbenchError


def add_out(command: argparse.ArgumentParser, metavar: str, text: str, required: bool = True) -> None:
    """-o and --overwrite."""
    command.add_argument("-o", "--out", required=required, type=Path, metavar=metavar, help=text)
    command.add_argument("--overwrite", action="store_true", help=f"replace {metavar} if it exists")


def add_device(command: argparse.ArgumentParser) -> None:
    """--device, on which the command then images."""
    command.add_argument("--device", choices=("cpu", "cuda"), help="image on (default: HANDBENCH_DEVICE, or cpu)")


def positive(text: str) -> int:
    """A whole number from 1 on, as an argument's type."""
    if not text.isdigit() or int(text) < 1:
        raise argparse.ArgumentTypeError(f"{text} is not a whole number ≥ 1")
    return int(text)


def numbers(text: str | None, count: int, option: str) -> tuple[float, ...] | None:
    """The numbers of an option's text; None without one."""
    if text is None:
        return None
    try:
        values = tuple(float(part) for part in text.split(","))
    except ValueError:
        values = ()
    if len(values) != count:
        raise HandbenchError(f"{option}: is '{text}'; expected {count} numbers separated by commas")
    return values


def free(path: Path, overwrite: bool) -> None:
    """Refuse to overwrite unless asked to."""
    if path.exists() and not overwrite:
        raise HandbenchError(f"{path}: exists already; choose another -o, or --overwrite to replace it")


def free_folder(path: Path, overwrite: bool, mark: str) -> None:
    """As `free`, and even then replace only a folder that holds `mark`, which handbench writes."""
    free(path, overwrite)
    if path.exists() and not (path / mark).is_file():
        raise HandbenchError(f"{path}: holds no {mark}, so handbench did not write it; choose another -o")

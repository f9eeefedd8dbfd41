"""`handbench show`: draw a capture, a depth map, a mesh, a board or a calibration target."""

from __future__ import annotations

import argparse
import os
from pathlib import Path
from typing import Any

import numpy as np
import tomlkit
from matplotlib.figure import Figure

from handbench.bench.datasets.dataset import open_capture
from handbench.bench.results.maps import SurfaceMap, view
from handbench.bench.scenes.stand import stand_board
from handbench.calibration.target import Target, default_target
from handbench.groundtruth.board import Board
from handbench.groundtruth.mesh.surface import Surface
from handbench.interface import Depth, load
from handbench.radar.data.capture import range_profile
from handbench.reports.figures.inputs import (
    PRINTED,
    SHARES,
    board_sheet,
    echoes_figure,
    target_sheet,
)
from handbench.reports.figures.layers import depth_layers, layers_figure
from handbench.reports.figures.style import save
from handbench.reports.page.scene3d import page
from handbench.support.config import parse, read_toml
from handbench.support.errors import HandbenchError
from handbench.support.files import free, write_text
from handbench.support.progress import print_lines

BUILT_IN = {"target": default_target, "stand": stand_board}
FEWEST_TONES = 8  # of fewer a range profile repeats too soon


def show(options: argparse.Namespace) -> None:
    """Draw the file or folder that the options name, and print the path of the result: a picture, a
    page on which a surface can be turned, or a drawing of a board or target to print."""
    path = options.path
    described = path.suffix == ".toml" or (str(path) in BUILT_IN and not path.exists())
    endings = (".pdf", ".toml") if described else (".png", ".pdf", ".svg", ".html")
    out = options.out or Path(Path(os.path.realpath(path)).stem + endings[0])
    if out.suffix.lower() not in endings:
        raise HandbenchError(f"-o: is {out}; expected a file that ends in {' or '.join(endings)}")
    free(options.overwrite, out)
    if described:
        _draw(path, out)
    elif path.is_dir():
        save(_recording(path), out)
    else:
        title, sensor, surface, maps = _surface(path)
        if out.suffix.lower() == ".html":
            write_text(out, page(path.name, title, surface, sensor))
        else:
            save(layers_figure(depth_layers(surface, maps), f"{path.name}: {title}"), out)
    print_lines(str(out))


def _surface(path: Path) -> tuple[str, str, SurfaceMap, dict[str, Any]]:
    """Return a depth map, or a mesh as its sensor sees it: title, sensor, depths, and other maps by
    name. Raises HandbenchError for anything else."""
    shown = load(path)
    if isinstance(shown, Depth):
        maps = {name: values for name, values in vars(shown.map).items() if values is not None}
        return shown.method, "array", SurfaceMap(shown.x_m, shown.y_m, shown.z_m), maps
    if not isinstance(shown, Surface):
        raise HandbenchError(f"{path}: has no surface to show; expected a depth map or a mesh")
    sensor, seen = view(shown)
    maps = {} if seen.sigma_m is None else {"sigma_m": seen.sigma_m}
    scale = "" if shown.scaled else ", no scale"
    return f"{len(shown.faces)} triangles, from the {sensor}{scale}", sensor, seen, maps


def _draw(path: Path, out: Path) -> None:
    """Write a board or a calibration target as a drawing at true scale (.pdf), or as its
    description (.toml). path: its description, or target or stand, which are built in."""
    if str(path) in BUILT_IN:
        values = BUILT_IN[str(path)]().model_dump(exclude_none=True)
    else:
        values = read_toml(path, "board.toml or target.toml")
    title = f"{path.name!a}, at true scale"
    if out.suffix.lower() == ".toml":
        write_text(out, tomlkit.dumps(values))
    elif "element" in values:
        save(target_sheet(parse(Target, values, str(path)), f"Target {title}"), out, PRINTED)
    else:
        save(board_sheet(parse(Board, values, str(path)), f"Board {title}"), out, PRINTED)


@np.errstate(divide="ignore", invalid="ignore")  # of channels without any echo
def _recording(path: Path) -> Figure:
    echoes = open_capture(path).echoes(1)
    f_hz, legs = echoes.frequencies_hz, echoes.aperture.legs
    samples = echoes.samples[0].reshape(len(f_hz), -1)
    samples = samples[:, samples.any(axis=0)]  # of the pairs that were measured
    if not samples.size:
        raise HandbenchError(f"{path}: has no echo to draw; record it again")
    magnitudes = np.percentile(np.abs(samples), SHARES, axis=1) / np.abs(samples).max()
    names = ("transmitters", "receivers") if legs[1].passes else ("positions",)
    places_m = {name: leg.position_m for name, leg in zip(names, legs, strict=False)}
    profile = range_profile(echoes) if len(np.unique(f_hz)) >= FEWEST_TONES else None
    return echoes_figure(
        f"{path.name}: {len(f_hz)} tones, {samples.shape[1]} channels",
        f_hz,
        20 * np.log10(magnitudes),
        places_m,
        profile,
    )

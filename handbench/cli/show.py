"""`handbench show`: draw a capture, a depth map, a mesh, a board or a calibration target."""

from __future__ import annotations

import argparse
import hashlib
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from handbench.bench.results.maps import SurfaceMap
from handbench.cli.options import free
from handbench.radar.data.capture import even_subset
from handbench.radar.data.depthmap import load_depthmap
from handbench.support.config import parse, read_toml
from handbench.support.errors import HandbenchError
from handbench.support.files import write_text
from handbench.support.progress import say

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from handbench.calibration.spheres.description import Target
    from handbench.groundtruth.board.board import Board
    from handbench.groundtruth.mesh.surface import Surface

KNOWN = "a capture folder, a depth map .npz, a mesh .ply, .obj or .stl, board.toml or target.toml"
MESHES = (".ply", ".obj", ".stl")
SHA_DIGITS, NAME_LETTERS = 12, 30  # of a file, in a drawing's title
VIEWED_PX = 320  # of a mesh, along its longest side
RANGES, MOST_CHANNELS, FEWEST_TONES, FARTHEST_M = 2000, 256, 8, 1.5  # of a range profile


def run(options: argparse.Namespace) -> None:
    """Draw the file or folder that the options name.
    The result is a picture, a printable drawing of a board or calibration target, or with --3d a
    page on which the surface can be turned. Prints the path of a picture or page."""
    path: Path = options.path
    if path.suffix == ".toml" or not path.exists():
        _drawing(options)
        return
    from handbench.reports.figures.style import save
    from handbench.reports.page.scene3d import page

    if options.out is not None and options.out.suffix.lower() == ".toml":
        raise HandbenchError(
            f"{path}: is neither a target nor a board; use -o FILE.toml only with these"
        )
    out = options.out or Path(path.resolve().name).with_suffix(
        ".html" if options.turned else ".png"
    )
    free(out, options.overwrite)
    if options.turned != (out.suffix == ".html"):
        raise HandbenchError(
            f"-o: is {out}; expected a picture file such as .png, or a page .html with --3d"
        )
    if options.turned:
        write_text(out, page(path.name, *_surface(path)))
    else:
        save(_figure(path), out)
    print(out)


def _drawing(options: argparse.Namespace) -> None:
    """Write a board or a calibration target as a drawing at true scale (.pdf) or, if -o ends in
    .toml, as its description."""
    from handbench.calibration.spheres.description import Target, save_target
    from handbench.groundtruth.board.board import save_board
    from handbench.reports.drawings.board_drawing import board_sheet
    from handbench.reports.drawings.sheets import INCH_MM, save
    from handbench.reports.drawings.target_drawing import target_sheet

    path: Path = options.path
    if options.turned:
        raise HandbenchError(f"{path}: a drawing cannot be turned in 3D; leave out --3d")
    out = options.out or Path(path.name).with_suffix(".pdf")
    if out.suffix.lower() not in (".pdf", ".toml"):
        raise HandbenchError(f"{out}: ends in '{out.suffix}'; expected .pdf, .toml")
    free(out, options.overwrite)
    thing, title = _described(path)
    if out.suffix.lower() == ".toml":
        if isinstance(thing, Target):
            save_target(out, thing)
        else:
            save_board(out, thing)
        say(f"{out}: {title}")
        return
    figure = target_sheet(thing, title) if isinstance(thing, Target) else board_sheet(thing, title)
    save(out, figure)
    width, height = figure.get_size_inches() * INCH_MM
    say(f"{out}: {title}, {width:.0f} × {height:.0f} mm; print at 100 %")


def _described(path: Path) -> tuple[Target | Board, str]:
    """Return the calibration target or board that a path names, and a title for its drawing.
    path: "target" or "stand" for those built in; otherwise a .toml file, whose title contains the
    first digits of its SHA-256."""
    from handbench.bench.scenes.stand import stand_board
    from handbench.calibration.spheres.description import Target, default_target
    from handbench.groundtruth.board.board import Board

    if str(path) == "target":
        return default_target(), "Calibration target, built in"
    if str(path) == "stand":
        return stand_board(), "Board of the simulated stand, built in"
    values = read_toml(path, "board.toml or target.toml") if path.is_file() else {}
    if not values.keys() & {"element", "marker", "charuco"}:
        raise HandbenchError(f"{path}: cannot be shown; expected {KNOWN}")
    name = "".join(c if c.isprintable() else "?" for c in path.name)  # it goes to the terminal too
    name = name if len(name) <= NAME_LETTERS else f"{name[: NAME_LETTERS - 3]}..."
    digest = hashlib.sha256(path.read_bytes()).hexdigest()[:SHA_DIGITS]
    if "element" in values:
        return parse(Target, values, str(path)), f"Calibration target, {name} (SHA-256 {digest})"
    return parse(Board, values, str(path)), f"Board, {name} (SHA-256 {digest})"


def _figure(path: Path) -> Figure:
    if path.suffix.lower() in MESHES:
        return _mesh(path)
    if path.suffix == ".npz":
        return _depth(path)
    if path.is_dir():
        return _recording(path)
    raise HandbenchError(f"{path}: cannot be shown; expected {KNOWN}")


def _depth(path: Path) -> Figure:
    from handbench.reports.figures.layers import depth_layers, layers_figure

    depth = load_depthmap(path)
    maps = {name: values for name, values in vars(depth).items() if isinstance(values, np.ndarray)}
    surface = SurfaceMap(depth.x_m, depth.y_m, depth.z_m)
    return layers_figure(depth_layers(surface, maps), f"{path.name}: {depth.method}")


def _mesh(path: Path) -> Figure:
    from handbench.groundtruth.mesh.depth import reference_on_grid
    from handbench.groundtruth.mesh.surface import read_surface
    from handbench.reports.figures.layers import SIGMAS, Layer, layers_figure, shaded_colours

    mesh = read_surface(path)
    frame, sensor, signs = _seen_from(mesh)
    turned = replace(mesh, vertices_m=mesh.vertices_m * signs)
    x_m, y_m = _pixels(turned.vertices_m)
    seen = reference_on_grid(turned, x_m, y_m)
    whole = reference_on_grid(replace(turned, observed=np.ones(len(mesh.observed), bool)), x_m, y_m)
    picture = shaded_colours(SurfaceMap(x_m, y_m, whole.z_m), np.isfinite(seen.z_m))
    layers = [Layer(f"from the {sensor}", 1e3 * signs[0] * x_m, 1e3 * signs[1] * y_m, picture)]
    if np.isfinite(sigma_m := seen.mesh_sigma_m).any():
        uncertainty = SIGMAS | {"title": "its own uncertainty", "label": "σ along z in mm"}
        layers.append(replace(layers[0], values=1e3 * sigma_m, **uncertainty))
    invented = (
        f", {100 * (1 - mesh.observed.mean()):.0f} % of its vertices filled in where no "
        "photograph saw the surface"
        if not mesh.observed.all()
        else ""
    )
    title = f"{path.name}, {frame} frame: {len(mesh.faces)} triangles{invented}"
    return layers_figure(layers, title)


def _seen_from(mesh: Surface) -> tuple[str, str, np.ndarray]:
    """Find from which side a mesh must be drawn: returns its coordinate frame, the sensor in this
    frame, and signs of x, y and z with which the axes point left, up and away from the sensor.
    A mesh with sigma_m was made from photographs. If its observed faces point towards +z, the frame
    is that of a board, with the cameras on the side of +z. Otherwise it is a camera's frame (x
    right, y down, z away from the camera)."""
    if not np.isfinite(mesh.sigma_m).any():
        return "radar", "array", np.ones(3)
    seen = mesh.faces[mesh.observed[mesh.faces].all(axis=1)]
    a, b, c = np.moveaxis(mesh.vertices_m[seen], 1, 0)
    facing = np.cross(b - a, c - a)[:, 2].sum() >= 0
    return "photo", "cameras", np.array([-1, 1, -1] if facing else [-1, -1, 1])


def _pixels(vertices_m: np.ndarray) -> list[np.ndarray]:
    """Return evenly spaced pixel centres in x and in y that cover a mesh with a small margin, about
    320 (VIEWED_PX) along its longer side.
    vertices_m [n, 3]: vertices of the mesh, metres."""
    low_m, high_m = vertices_m[:, :2].min(axis=0), vertices_m[:, :2].max(axis=0)
    step_m = max(float((high_m - low_m).max()) / VIEWED_PX, 1e-6)
    return [np.arange(low_m[i] - 4 * step_m, high_m[i] + 4 * step_m, step_m) for i in (0, 1)]


def _recording(path: Path) -> Figure:
    from handbench.bench.datasets.dataset import open_capture
    from handbench.reports.figures.recordings import SHARES, echoes_figure

    capture = open_capture(path).echoes(1)
    f_hz, legs = capture.frequencies_hz, capture.aperture.legs
    samples = capture.samples[0].reshape(len(f_hz), -1) / max(
        float(np.abs(capture.samples[0]).max()), 1e-38
    )
    levels_db = 20 * np.log10(np.maximum(np.percentile(np.abs(samples), SHARES, axis=1), 1e-10))
    names = ("transmitters", "receivers") if legs[1].passes else ("positions",)
    places_m = {name: leg.position_m for name, leg in zip(names, legs, strict=False)}
    profile = None
    if len(f_hz) >= FEWEST_TONES:  # of fewer it repeats too soon
        f_per_m = f_hz / capture.wave_speed_m_s
        range_m = np.linspace(
            0, min(0.5 / float(np.median(np.diff(np.sort(f_per_m)))), FARTHEST_M), RANGES
        )
        some = (
            samples[:, even_subset(samples.shape[1], MOST_CHANNELS)]
            * np.hanning(len(f_hz) + 2)[1:-1, None]
        )
        power = np.mean(np.abs(np.exp(4j * np.pi * np.outer(range_m, f_per_m)) @ some) ** 2, axis=1)
        profile = range_m, 10 * np.log10(np.maximum(power / max(power.max(), 1e-38), 1e-6))
    title = (
        f"{path.name}: {len(f_hz)} tones, {' × '.join(map(str, capture.aperture.channels))} "
        "channels"
    )
    return echoes_figure(title, f_hz, levels_db, places_m, profile)


def _surface(path: Path) -> tuple[str, SurfaceMap, str]:
    """Return what --3d shows for a path: the title, the surface as depths over x and y, and the
    sensor from which it is seen.
    path: a depth map, a mesh, or a capture with a surface. Raises HandbenchError for anything
    else."""
    from handbench.bench.datasets.dataset import open_capture
    from handbench.bench.validation.capture_warnings import surface_of
    from handbench.groundtruth.mesh.depth import reference_on_grid
    from handbench.groundtruth.mesh.surface import read_surface

    if path.suffix == ".npz":
        depth = load_depthmap(path)
        return depth.method, SurfaceMap(depth.x_m, depth.y_m, depth.z_m), "array"
    mesh = read_surface(path) if path.suffix.lower() in MESHES else None
    mesh = surface_of(open_capture(path)) if path.is_dir() else mesh
    if mesh is None:
        raise HandbenchError(
            f"{path}: has no surface to show in 3D; leave out --3d, or name a depth map, a mesh "
            "or a capture with a mesh"
        )
    frame, sensor, signs = _seen_from(mesh)
    mesh = replace(mesh, vertices_m=mesh.vertices_m * signs)
    x_m, y_m = _pixels(mesh.vertices_m)
    surface = SurfaceMap(x_m, y_m, reference_on_grid(mesh, x_m, y_m).z_m)
    return f"surface, {frame} frame", surface, sensor

"""`handbench groundtruth`: photographs, or a foreign mesh, as a metric mesh."""

from __future__ import annotations

import argparse
import json
from pathlib import Path
from typing import Any

from bench.cli.options import add_out, free, numbers
from radar.support.errors import HandbenchError

HELP = "photographs, or a mesh in another unit → metric mesh"
MESH_SUFFIXES = (".ply", ".obj", ".stl")
MILLIMETRE_M = 1e-3


def add_arguments(command: argparse.ArgumentParser) -> None:
    """Its options."""
    command.add_argument("photos", type=Path, metavar="PHOTOS", help="folder of photographs, or a mesh file")
    cameras = command.add_argument_group("cameras")
    cameras.add_argument(
        "--cameras",
        type=Path,
        metavar="FILE_OR_FOLDER",
        help="known cameras: cameras.json (default: the one in PHOTOS), COLMAP model, Metashape's XML",
    )
    cameras.add_argument("--intrinsics", metavar="fx,fy,cx,cy", help="one known camera for all photographs, pixels")
    cameras.add_argument("--model", type=Path, metavar="DIR", help="COLMAP model of PHOTOS: registered already")
    scale = command.add_argument_group("scale and frame")
    scale.add_argument("--board", type=Path, metavar="board.toml", help="ArUco or ChArUco board: scale and frame")
    scale.add_argument(
        "--distance",
        action="append",
        default=[],
        metavar="A.jpg,B.jpg,METRES",
        dest="distances",
        help="measured between two photographs' cameras (repeatable)",
    )
    scale.add_argument("--metric", action="store_true", help="the COLMAP model's poses are in metres")
    scale.add_argument("--unscaled", action="store_true", help="accept a mesh without metric scale")
    scale.add_argument("--unit", choices=("m", "mm"), help="of a mesh file given instead of PHOTOS")
    target = command.add_argument_group("target")
    target.add_argument(
        "--box",
        metavar="xmin,ymin,zmin,xmax,ymax,zmax",
        help="region of interest, metres, mesh frame; a first minus needs --box=-0.1,…",
    )
    target.add_argument("--masks", type=Path, metavar="DIR", help="NAME.jpg.png or NAME.png, nonzero on the target")
    target.add_argument(
        "--mask",
        choices=("none", "colour"),
        default="none",
        help="colour: cut the target out by its colours; give --box too (default none)",
    )
    command.add_argument("--quality", choices=("draft", "normal", "high"), default="normal")
    command.add_argument(
        "--dense",
        choices=("auto", "cpu", "cuda"),
        default="auto",
        help="depth maps on (default auto: a CUDA device, if pycolmap finds one)",
    )
    command.add_argument("--seed", type=int, default=0)
    command.add_argument("--workdir", type=Path, metavar="DIR", help="keep sparse/, dense.ply and summary.json there")
    add_out(command, "MESH.ply", "mesh, metres")


def run(options: argparse.Namespace) -> None:
    """Photographs → mesh; or a mesh in any unit → a mesh in metres."""
    free(options.out, options.overwrite)
    if options.photos.suffix.lower() in MESH_SUFFIXES and not options.photos.is_dir():
        _take_over(options)
        return
    if options.unit is not None:
        raise HandbenchError(f"--unit: is for a mesh file, {options.photos} is none; leave it out")
    from groundtruth.options import Options
    from groundtruth.pipeline import reconstruct
    from radar.support.config import parse

    for kept in ("sparse", "dense.ply", "summary.json") if options.workdir else ():
        free(options.workdir / kept, options.overwrite)
    result = reconstruct(options.photos, parse(Options, _values(options), "groundtruth"), options.workdir)
    result.surface.save(options.out)
    print(json.dumps(result.summary(), indent=2))


def _take_over(options: argparse.Namespace) -> None:
    from groundtruth.mesh.mesh_files import metric_mesh, write_mesh

    if options.unit is None:
        raise HandbenchError(f"--unit: is missing; {options.photos} does not tell its own: say m or mm")
    mesh = metric_mesh(options.photos, MILLIMETRE_M if options.unit == "mm" else 1.0)
    write_mesh(options.out, mesh)
    print(json.dumps({"vertices": len(mesh.vertices), "triangles": len(mesh.triangles)}, indent=2))


def _values(options: argparse.Namespace) -> dict[str, Any]:
    same = ("cameras", "model", "metric", "board", "unscaled", "quality", "dense", "masks", "mask", "seed")
    return {name: getattr(options, name) for name in same} | {
        "intrinsics": numbers(options.intrinsics, 4, "--intrinsics"),
        "box_m": numbers(options.box, 6, "--box"),
        "distances": tuple(_distance(text) for text in options.distances),
    }


def _distance(text: str) -> dict[str, Any]:
    parts = text.split(",")
    try:
        first, second, metres = (part.strip() for part in parts)
        return {"first": first, "second": second, "distance_m": float(metres)}
    except ValueError:
        raise HandbenchError(f"--distance: is '{text}'; expected A.jpg,B.jpg,0.350, names and metres") from None

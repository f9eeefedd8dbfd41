"""`handbench inspect`: what seems wrong with data that can be read, and what to do."""

import argparse
from pathlib import Path

from radar.support.errors import HandbenchError


def run(options: argparse.Namespace) -> None:
    """Facts, problems and doubts on stdout; exit code 2 if there is a problem that is more than a doubt."""
    from bench.validation.validate import show

    if options.path.suffix == ".npz":
        _depth_map(options)
        return
    if options.mesh or options.transform:
        raise HandbenchError("--mesh, --transform: are for a DEPTH.npz; a capture has its own surface in its folder")
    show([str(options.path)], scored=False)
    if options.path.is_dir():
        _captures(options.path)


def _captures(root: Path) -> None:
    from bench.datasets.dataset import captures, open_capture
    from bench.validation.doubts import of_capture

    for folder in captures(root):
        _tell(folder, list(of_capture(open_capture(folder))))


def _depth_map(options: argparse.Namespace) -> None:
    from bench.datasets.maroon_alignment import load_any_transform
    from bench.validation import surface_fit
    from bench.validation.doubts import of_map
    from groundtruth.mesh.surface import read_surface
    from radar.data.depthmap import load_depthmap

    depth = load_depthmap(options.path)
    seen = int((depth.z_m == depth.z_m).sum())
    print(f"{options.path}: {depth.method}, {seen} of {depth.z_m.size} pixels on target")
    doubts = list(of_map(depth))
    if options.mesh:
        surface = read_surface(options.mesh).moved(load_any_transform(options.transform))
        doubts += surface_fit.findings(depth, surface)
    _tell(options.path, doubts)


def _tell(path: Path, doubts: list[str]) -> None:
    for doubt in doubts:
        print(f"{path}: {doubt}")
    if not doubts:
        print(f"{path}: nothing looks wrong")

"""`handbench inspect`: what seems wrong with data that can be read, and what to do."""

import argparse
from collections.abc import Sequence
from pathlib import Path

from handbench.support.errors import HandbenchError

MESHES = (".ply", ".obj", ".stl")


def run(options: argparse.Namespace) -> None:
    """Facts, problems and doubts on stdout; exit code 2 if there is a problem that is more than a doubt."""
    if options.path.suffix == ".npz":
        _depth_map(options)
        return
    if options.mesh or options.transform:
        raise HandbenchError("--mesh, --transform: are for a DEPTH.npz; a capture has its own surface in its folder")
    if (options.path / "result.json").is_file():
        from handbench.bench.results import load
        from handbench.bench.validation.file_doubts import of_result

        _tell(options.path, list(of_result(load(options.path))))
        return
    from handbench.bench.datasets.dataset import captures
    from handbench.bench.validation.photo_problems import is_of_photographs
    from handbench.bench.validation.validate import show

    show([str(options.path)], scored=False)
    if options.path.suffix.lower() in MESHES:
        from handbench.bench.validation.file_doubts import of_mesh
        from handbench.groundtruth.mesh.surface import read_surface

        _tell(options.path, list(of_mesh(read_surface(options.path))))
    elif options.path.suffix == ".toml":
        _benchmark(options.path)
    elif options.path.is_dir() and not is_of_photographs(options.path):
        _captures(captures(options.path))


def _captures(folders: Sequence[Path]) -> None:
    from handbench.bench.datasets.dataset import open_capture
    from handbench.bench.validation.doubts import of_capture

    for folder in folders:
        _tell(folder, list(of_capture(open_capture(folder))))


def _benchmark(file: Path) -> None:
    from handbench.bench.run.benchmark_file import load_benchmark
    from handbench.support.config import read_toml
    from handbench.support.files import inside

    if "method" in read_toml(file, "a benchmark"):  # else a scene, a board or a target, of which all is said
        bench, base = load_benchmark(str(file))
        _captures([inside(base, source.path, "capture.path") for source in bench.capture if source.path])


def _depth_map(options: argparse.Namespace) -> None:
    from handbench.bench.datasets.maroon_alignment import load_any_transform
    from handbench.bench.validation import surface_fit
    from handbench.bench.validation.doubts import of_map
    from handbench.groundtruth.mesh.surface import read_surface
    from handbench.radar.data.depthmap import load_depthmap
    from handbench.radar.methods.trust import FLAGGED

    depth = load_depthmap(options.path)
    on_target = depth.z_m == depth.z_m
    seen = int(on_target.sum())
    flagged = "" if depth.p_gross is None else f", {int((depth.p_gross[on_target] > FLAGGED).sum())} of these flagged"
    print(f"{options.path}: {depth.method}, {seen} of {depth.z_m.size} pixels on target{flagged}")
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

"""Readers to fuzz: each with a small valid input, written by our own writers, and the files of it
to break."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from handbench.radar.data.grid import PixelGrid
from tests.fuzz import capture_seeds, geometry_seeds, result_seeds

OUT = "out"  # beside an input: where a reader that writes may write


@dataclass(frozen=True)
class Reader:
    """A reader. write: makes a valid input in an empty folder; read: reads it, and writes nowhere
    but in OUT; files: those to break, one at a time (a file that is named twice, twice as often);
    share: of the inputs."""

    name: str
    write: Callable[[Path], None]
    read: Callable[[Path], Any]
    files: tuple[str, ...]
    share: int = 2


def _capture(folder: Path) -> None:
    from handbench.bench.datasets.dataset import open_capture

    capture = open_capture(folder)
    _ = capture.about, capture.echoes(), capture.transform(), capture.mesh(), capture.truth
    capture.key()


def _planar_scan(folder: Path) -> None:
    from handbench.bench.datasets.foam_panel import import_planar_scan

    try:
        import_planar_scan(folder, folder / OUT)
    finally:
        shutil.rmtree(folder / OUT, ignore_errors=True)


def _maroon(folder: Path) -> None:
    from handbench.bench.datasets.dataset import open_capture
    from handbench.radar.data.depthmap import load_depthmap

    capture = open_capture(folder / "hand" / "30")
    _ = capture.about, capture.echoes(), capture.transform(), capture.mesh()
    capture.mask(load_depthmap(folder / "depth.npz"), erode=True)


def _maroon_sensors(folder: Path) -> None:
    from handbench.bench.datasets.maroon_alignment import OtherSensor

    for name in ("realsense", "kinect"):
        OtherSensor(folder, name, folder / "alignment.json", lambda: True)(
            PixelGrid(np.zeros(2), np.ones(3))
        )


def _scene(folder: Path) -> None:
    from handbench.bench.scenes.scene_file import SceneFile
    from handbench.support.config import load

    file = load(SceneFile, folder / "scene.toml", "a scene description")
    _ = file.causes, file.target.radar_from_target(), file.mount.radar_from_photo()


def _benchmark(folder: Path) -> None:
    from handbench.bench.run.benchmark_file import load_benchmark

    load_benchmark(str(folder / "bench.toml"))


def _validate(folder: Path) -> None:
    from handbench.bench.validation.inspection import problems_of

    for problem in problems_of(str(folder / "bench.toml")):
        str(problem)


def _target(folder: Path) -> None:
    from handbench.calibration.spheres.description import load_target

    target = load_target(folder / "target.toml")
    _ = target.centres_m, target.foam_delay_m


def _board(folder: Path) -> None:
    from handbench.groundtruth.board.board import load_board

    board = load_board(folder / "board.toml")
    board.corners_m(), board.cv_dictionary(), board.describe()
    if board.charuco is not None:
        board.charuco.cv_board()


def _transform(folder: Path) -> None:
    from handbench.bench.datasets.maroon_alignment import load_any_transform

    transform = load_any_transform(folder / "radar_from_photo.json")
    transform.inverse().points(transform.points(geometry_seeds.POINTS_M))
    if transform.covariance is not None:
        transform.point_covariance(geometry_seeds.POINTS_M)


def _alignment(folder: Path) -> None:
    from handbench.bench.datasets.maroon_alignment import load_alignment

    load_alignment(folder / "alignment.json").inverse()


def _cameras(name: str) -> Callable[[Path], None]:
    def read(folder: Path) -> None:
        from handbench.groundtruth.cameras.camera_files import cameras_of, load_model

        photos = geometry_seeds.photos(folder)
        for camera in cameras_of(photos, folder / name, metric=True):
            if camera.R is not None and camera.t is not None:
                camera.project(geometry_seeds.POINTS_M + [0, 0, 1])
        if (folder / name).is_dir():
            load_model(folder / name, photos)

    return read


def _mesh(name: str) -> Callable[[Path], None]:
    def read(folder: Path) -> None:
        from handbench.groundtruth.mesh.surface import read_surface

        _ = read_surface(folder / name).mesh

    return read


def _foreign_mesh(folder: Path) -> None:
    from handbench.groundtruth.mesh.mesh_files import metric_mesh

    metric_mesh(folder / "scan.stl", 1e-3)


def _depth(folder: Path) -> None:
    from handbench.radar.data.depthmap import load_depthmap

    load_depthmap(folder / "depth.npz")


def _photos(folder: Path) -> None:
    from handbench.groundtruth.photos.photos import find_photos

    for photo in find_photos(folder):
        photo.colours()


def _masks(folder: Path) -> None:
    from handbench.groundtruth.photos.masks import find_masks

    find_masks(folder / "masks", geometry_seeds.photos(folder))


def _small_photo(folder: Path) -> None:
    from handbench.bench.results import write_photo

    try:
        write_photo(folder / OUT, "hand", folder / "hand.jpg")
    finally:
        shutil.rmtree(folder / OUT, ignore_errors=True)


def _result(folder: Path) -> None:
    from handbench.bench import results

    result = results.load(folder)
    _ = result.scores, result.curves, result.repeats, result.equal, result.comparisons
    for capture in result.scored():
        for reference in capture.references:
            result.surface(capture.name, reference)
            for method in result.about.methods:
                result.errors(capture.name, method.name, reference)
        result.photo(capture.name)


def _tradeoff(folder: Path) -> None:
    from handbench.bench import results

    results.load_tradeoff(folder)


def _antennas(folder: Path) -> None:
    from handbench.radar.data.arrays import load_positions

    load_positions(folder / "array.csv")


def _array(folder: Path) -> None:
    from handbench.calibration.array.array_file import load_array

    calibration = load_array(folder / "array.json")
    calibration.summary()


def _map(folder: Path) -> None:
    from handbench.groundtruth.dense.cuda import read_map

    read_map(folder / "depth.bin", (3, 4, 1))


def _stage(folder: Path) -> None:
    """A stage whose files were changed is found out and made again."""
    from handbench.support.store import cached

    one = result_seeds.kept_stage()
    shutil.rmtree(one.folder(folder), ignore_errors=True)
    shutil.copytree(folder / "stage", one.folder(folder), symlinks=True)
    cached(folder, one)
    if (one.folder(folder) / "depth.npz").read_bytes() != (folder / "fresh.npz").read_bytes():
        raise AssertionError("a changed file of a kept stage was taken for what the stage had made")


READERS: tuple[Reader, ...] = (
    Reader(
        "capture",
        capture_seeds.capture,
        _capture,
        (*3 * ("echoes.h5",), "capture.toml", "array.json"),
        6,
    ),
    Reader("scan", capture_seeds.scan, _capture, ("echoes.h5",), 3),
    Reader("mapping", capture_seeds.mapping, _capture, ("mapping.toml", "hand.mat", "hand.mat"), 4),
    Reader("pairs", capture_seeds.pairs, _capture, ("echoes.h5",), 4),
    Reader(
        "matlab", capture_seeds.matlab, _capture, (*3 * (capture_seeds.MATLAB,), "mapping.toml"), 4
    ),
    Reader(
        "maroon",
        capture_seeds.maroon,
        _maroon,
        (
            *3 * ("hand/30/radar_72.0_82.0_2/calibrated_data/000000.npy",),
            "hand/30/metadata.json",
            "hand/30/alignment.json",
            "hand/30/radar_72.0_82.0_2/calibration.json",
        ),
        3,
    ),
    Reader(
        "maroon_sensors",
        capture_seeds.maroon_sensors,
        _maroon_sensors,
        (
            *2 * ("kinect/calibration.json",),
            "realsense/calibration.json",
            "realsense/depth/000000.png",
            "realsense/mask/000000.png",
            "alignment.json",
        ),
        1,
    ),
    Reader("planar_scan", capture_seeds.planar_scan, _planar_scan, ("scan.npy", "phase.txt"), 3),
    Reader("scene", capture_seeds.scene, _scene, ("scene.toml",), 3),
    Reader("benchmark", capture_seeds.benchmark, _benchmark, ("bench.toml",), 3),
    Reader("validate", capture_seeds.benchmark, _validate, ("bench.toml", "scene.toml"), 2),
    Reader("target", geometry_seeds.target, _target, ("target.toml",)),
    Reader("board", geometry_seeds.board, _board, ("board.toml",)),
    Reader("transform", geometry_seeds.transform, _transform, ("radar_from_photo.json",)),
    Reader("alignment", geometry_seeds.alignment, _alignment, ("alignment.json",)),
    Reader("cameras", geometry_seeds.cameras, _cameras("cameras.json"), ("cameras.json",)),
    Reader("metashape", geometry_seeds.metashape, _cameras("cams.xml"), ("cams.xml",)),
    Reader(
        "colmap",
        geometry_seeds.colmap,
        _cameras("sparse"),
        tuple(f"sparse/{name}.bin" for name in ("cameras", "images", "points3D", "frames", "rigs")),
        4,
    ),
    Reader(
        "colmap_text",
        geometry_seeds.colmap_text,
        _cameras("sparse"),
        tuple(f"sparse/{name}.txt" for name in ("cameras", "images", "points3D", "frames", "rigs")),
        3,
    ),
    Reader("ply", geometry_seeds.meshes, _mesh("mesh.ply"), ("mesh.ply",), 3),
    Reader("ply_text", geometry_seeds.meshes, _mesh("text.ply"), ("text.ply",)),
    Reader("obj", geometry_seeds.meshes, _mesh("mesh.obj"), ("mesh.obj",)),
    Reader("stl", geometry_seeds.meshes, _mesh("mesh.stl"), ("mesh.stl",)),
    Reader("foreign_mesh", geometry_seeds.meshes, _foreign_mesh, ("scan.stl",), 1),
    Reader("depth", geometry_seeds.depth, _depth, ("depth.npz",), 4),
    Reader(
        "photos", result_seeds.pictures, _photos, ("a.jpg", "a.jpg", "b.png", "c.tif", "d.png"), 5
    ),
    Reader("masks", result_seeds.masks, _masks, ("masks/a.jpg.png", "masks/b.png"), 2),
    Reader("small_photo", result_seeds.small_photo, _small_photo, ("hand.jpg",), 1),
    Reader(
        "result",
        result_seeds.result,
        _result,
        (
            "result.json",
            "table.csv",
            "tasks.csv",
            "scores.csv",
            "curves.csv",
            "config.toml",
            "depth/F__2fsk.npz",
            "depth/F__truth.npz",
            "errors/F__2fsk__truth.npz",
        ),
        5,
    ),
    Reader(
        "older_result",
        result_seeds.older_result,
        _result,
        (
            "repeats.csv",
            "comparisons.csv",
            "captures.csv",
            "equal.csv",
            "causes.csv",
            "reliability.csv",
        ),
    ),
    Reader("tradeoff", result_seeds.tradeoff, _tradeoff, ("tradeoff.json", "tradeoff.csv")),
    Reader("antennas", capture_seeds.antennas, _antennas, ("array.csv",)),
    Reader("array", capture_seeds.array, _array, ("array.json",)),
    Reader("colmap_map", geometry_seeds.colmap_map, _map, ("depth.bin",), 1),
    Reader("stage", result_seeds.kept, _stage, ("stage/depth.npz", "stage/stage.json"), 2),
)

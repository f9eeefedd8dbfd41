"""Readers to fuzz: each with a small valid input, written by our own writers, and the files of it
to break."""

from __future__ import annotations

import os
import shutil
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from handbench.bench import results
from handbench.bench.datasets.dataset import open_capture
from handbench.bench.datasets.maroon_alignment import load_any_transform
from handbench.bench.datasets.ti import import_ti_raw
from handbench.bench.datasets.touchstone import import_touchstone
from handbench.bench.scenes.scene_file import SceneFile
from handbench.bench.validation.inspection import problems_of
from handbench.calibration.spheres.description import load_target
from handbench.groundtruth.board.board import load_board
from handbench.groundtruth.cameras.camera_files import cameras_of, load_model
from handbench.groundtruth.mesh.surface import read_surface
from handbench.groundtruth.photos.masks import find_masks
from handbench.groundtruth.photos.photos import find_photos
from handbench.radar.data.depthmap import load_depthmap
from handbench.support.config import load
from handbench.support.store import Stage, cached
from tests.fuzz import capture_seeds as captures
from tests.fuzz import geometry_seeds as geometry
from tests.reports.synthetic_result import write_synthetic, write_synthetic_tradeoff
from tests.small_benchmark import BENCH, SCENE

OUT = "out"  # beside an input: where a reader that writes may write
STAGE = Stage("stage", geometry.depth, {}, [])


@dataclass(frozen=True)
class Reader:
    """A reader. write: makes a valid input in an empty folder; read: reads it, and writes nowhere
    but in OUT; files: those to break, one at a time (a file that is named twice, twice as often);
    share: of the inputs."""

    name: str
    write: Callable[[Path], Any]
    read: Callable[[Path], Any]
    files: tuple[str, ...]
    share: int = 2


def _capture(folder: Path) -> None:
    capture = open_capture(folder)
    _ = capture.about, capture.echoes(), capture.transform(), capture.mesh(), capture.truth
    capture.key()


def _maroon(folder: Path) -> None:
    _capture(folder / "hand" / "30")
    mask = open_capture(folder / "hand" / "30").mask
    mask(load_depthmap(folder / "depth.npz"), erode=True)


def _writing(write: Callable[[Path], Any]) -> Callable[[Path], None]:
    def read(folder: Path) -> None:
        try:
            write(folder)
        finally:
            shutil.rmtree(folder / OUT, ignore_errors=True)

    return read


def _benchmark(folder: Path) -> None:
    scene = SCENE.replace('"mesh"', '"hand"').replace('path = "ball.ply"', 'pose = "F"')
    (folder / "scene.toml").write_text(scene)
    (folder / "bench.toml").write_text(BENCH.replace("ball.toml", "scene.toml"))


def _scene(folder: Path) -> None:
    file = load(SceneFile, folder / "scene.toml", "a scene description")
    _ = file.causes, file.target.radar_from_target(), file.mount.radar_from_photo()


def _board(folder: Path) -> None:
    board = load_board(folder / "board.toml")
    board.corners_m(), board.cv_dictionary(), board.describe()
    if board.charuco is not None:
        board.charuco.cv_board()


def _target(folder: Path) -> None:
    target = load_target(folder / "target.toml")
    _ = target.centres_m, target.foam_delay_m


def _transform(folder: Path) -> None:
    transform = load_any_transform(folder / "radar_from_photo.json")
    transform.inverse().points(transform.points(geometry.POINTS_M))
    if transform.covariance is not None:
        transform.point_covariance(geometry.POINTS_M)


def _cameras(name: str) -> Callable[[Path], None]:
    def read(folder: Path) -> None:
        photos = geometry.photos(folder)
        for camera in cameras_of(photos, folder / name, metric=True):
            if camera.R is not None and camera.t is not None:
                camera.project(geometry.POINTS_M + [0, 0, 1])
        if (folder / name).is_dir():
            load_model(folder / name, photos)

    return read


def _mesh(name: str) -> Reader:
    return Reader(name, geometry.meshes, lambda folder: read_surface(folder / name).mesh, (name,))


def _result(folder: Path) -> None:
    result = results.load(folder)
    _ = result.scores, result.repeats, result.equal
    for capture in result.scored():
        for reference in capture.references:
            result.surface(capture.name, reference)
            for method in result.about.methods:
                result.errors(capture.name, method.name, reference)
        result.photo(capture.name)


def _kept(folder: Path) -> None:
    """A kept stage, and what it made once more beside it."""
    cached(folder, STAGE)
    STAGE.folder(folder).rename(folder / "stage")  # whatever its key is
    shutil.copy(folder / "stage" / "depth.npz", folder / "fresh.npz")


def _copy(source: str, target: str) -> None:
    """Copy a file or a pipe."""
    if os.path.isfile(source):
        shutil.copy2(source, target)
    else:
        os.mkfifo(target)


def _stage(folder: Path) -> None:
    """A stage whose files were changed is found out and made again."""
    there = STAGE.folder(folder)
    shutil.rmtree(there, ignore_errors=True)
    try:
        shutil.copytree(folder / "stage", there, symlinks=True, copy_function=_copy)
        cached(folder, STAGE)
        if (there / "depth.npz").read_bytes() != (folder / "fresh.npz").read_bytes():
            raise AssertionError("a changed file of a kept stage was taken for what was made")
    finally:
        shutil.rmtree(there, ignore_errors=True)


def _model(folder: str, suffix: str) -> tuple[str, ...]:
    parts = ("cameras", "images", "points3D", "frames", "rigs")
    return tuple(f"{folder}/{name}.{suffix}" for name in parts)


FRAME = f"{captures.SCANNED}/calibrated_data/000000.npy"
TABLES = ("table", "tasks", "repeats")
READERS: tuple[Reader, ...] = (
    Reader("capture", captures.capture, _capture, ("echoes.h5", "capture.toml", "array.json"), 6),
    Reader("scan", captures.scan, _capture, ("echoes.h5",), 3),
    Reader("mapping", captures.mapping, _capture, ("mapping.toml", "hand.mat", "hand.mat"), 4),
    Reader("matlab", captures.matlab, _capture, (captures.MATLAB,), 4),
    Reader(
        "maroon",
        captures.maroon,
        _maroon,
        (FRAME, FRAME, "hand/30/metadata.json", "hand/30/alignment.json"),
        3,
    ),
    Reader(
        "touchstone",
        captures.touchstone,
        _writing(lambda folder: import_touchstone(folder, folder / OUT)),
        ("11.s2p", "11.s2p", "positions.csv"),
        3,
    ),
    Reader(
        "ti_raw",
        captures.ti_raw,
        _writing(lambda folder: import_ti_raw(folder, folder / OUT)),
        ("profile.cfg", "profile.cfg", "adc_data.bin", "tx_m.csv"),
        3,
    ),
    Reader("scene", _benchmark, _scene, ("scene.toml",), 3),
    Reader(
        "validate",
        _benchmark,
        lambda folder: list(map(str, problems_of(str(folder / "bench.toml")))),
        ("bench.toml", "scene.toml"),
    ),
    Reader("target", geometry.places, _target, ("target.toml",)),
    Reader("board", geometry.places, _board, ("board.toml",)),
    Reader("transform", geometry.places, _transform, ("radar_from_photo.json",)),
    Reader("cameras", geometry.cameras, _cameras("cameras.json"), ("cameras.json",)),
    Reader("metashape", geometry.cameras, _cameras("cams.xml"), ("cams.xml",)),
    Reader("colmap", geometry.cameras, _cameras("sparse"), _model("sparse", "bin"), 4),
    Reader("colmap_text", geometry.cameras, _cameras("text"), _model("text", "txt"), 3),
    *map(_mesh, ("mesh.ply", "text.ply", "mesh.obj", "mesh.stl")),
    Reader("depth", geometry.depth, lambda f: load_depthmap(f / "depth.npz"), ("depth.npz",), 4),
    Reader(
        "photos",
        geometry.pictures,
        lambda folder: [photo.colours() for photo in find_photos(folder)],
        ("a.jpg", "b.png", "c.tif", "d.png"),
        5,
    ),
    Reader(
        "masks",
        geometry.pictures,
        lambda folder: find_masks(folder / "masks", geometry.photos(folder)),
        ("masks/a.jpg.png", "masks/b.png"),
    ),
    Reader(
        "small_photo",
        geometry.pictures,
        _writing(lambda folder: results.write_photo(folder / OUT, "hand", folder / "a.jpg")),
        ("a.jpg",),
    ),
    Reader(
        "result",
        lambda folder: write_synthetic(folder, ("F",), step_m=2e-2),
        _result,
        (
            "result.json",
            "config.toml",
            "depth/F__2fsk.npz",
            "errors/F__2fsk__truth.npz",
            *(f"{name}.csv" for name in TABLES),
        ),
        2,
    ),
    Reader(
        "tradeoff",
        write_synthetic_tradeoff,
        results.load_tradeoff,
        ("tradeoff.json", "tradeoff.csv"),
    ),
    Reader("stage", _kept, _stage, ("stage/depth.npz", "stage/stage.json")),
)

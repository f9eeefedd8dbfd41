"""Simulation of scenes into capture folders, with echoes, photographs, cameras, board, true surface
and description."""

import shutil
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np
import tomlkit

from handbench.bench.datasets.native import (
    DESCRIPTION,
    ECHOES,
    EMPTY,
    PHOTOS,
    TARGET,
    TRUE_TRANSFORM,
    TRUTH,
    TRUTHS,
    CaptureFile,
    save_capture_file,
)
from handbench.bench.scenes.build import Scene, build
from handbench.bench.scenes.echoes import echo_scene, echoes, surfaces
from handbench.bench.scenes.photographs import Studio, photo_effects
from handbench.bench.scenes.scene_file import HandTarget, MeshTarget, SceneFile
from handbench.bench.scenes.stand import stand_board
from handbench.groundtruth.board import save_board
from handbench.groundtruth.cameras import load_pycolmap, save_cameras
from handbench.groundtruth.mesh.ply import by_axis, write_ply
from handbench.groundtruth.mesh.surface import write_mesh
from handbench.radar.data.echoes_file import save_capture
from handbench.radar.simulation.scene import Choice
from handbench.support.config import parse
from handbench.support.errors import HandbenchError
from handbench.support.files import atomic_folder, atomic_path, write_text
from handbench.support.parallel import for_each
from handbench.support.progress import say
from handbench.support.store import stage

CAPTURE = "capture"  # folder of the stage that simulates a scene
JPEG_QUALITY = 96
MOST_FRAMES = 100_000
# names of the files of a simulated capture
WRITTEN = (
    TRUE_TRANSFORM,
    DESCRIPTION,
    ECHOES,
    EMPTY,
    TRUTH,
    TARGET,
    f"{TRUTHS}/[0-9]*.ply",
    f"{PHOTOS}/cam[0-9][0-9]*.jpg",
    f"{PHOTOS}/cameras.json",
    f"{PHOTOS}/truth_cameras.json",
    f"{PHOTOS}/board.toml",
)


@stage(
    "simulate",
    "bench/datasets",
    "bench/scenes",
    "calibration",
    "groundtruth/board.py",
    "groundtruth/cameras.py",
    "groundtruth/mesh",
    "radar/data",
    "radar/imaging",
    "radar/simulation",
)
def simulate(folder: Path, scene: dict[str, Any], base: str, frames: int) -> None:
    """Simulate a scene, and write the capture into the folder CAPTURE inside a stage's folder.
    scene: content of the scene file; base: folder of the files that the scene names; frames: how
    many frames are simulated."""
    file = parse(SceneFile, scene, f"scene of {base}")
    simulate_capture(build(file, Path(base)), folder / CAPTURE, frames)


def simulate_capture(scene: Scene, folder: str | Path, frames: int = 1) -> tuple[Choice, ...]:
    """Simulate a scene into a capture folder, which appears complete or not at all.

    The folder receives the echoes of `frames` frames, those of the empty room if the scene asks for
    them, photographs, true surface (of a moving target: that of each frame's start, with
    velocities) and description. Returns one row for each effect: whether it was simulated, and why.
    """
    if frames not in range(1, MOST_FRAMES + 1):
        raise HandbenchError(f"frames: is {frames!r}; expected a whole number, 1 to {MOST_FRAMES}")
    with atomic_folder(folder) as temporary:
        say(f"{scene.file.name}: echoes")
        radar_scene = echo_scene(scene)
        simulated = echoes(scene, frames, radar_scene)
        save_capture(temporary / ECHOES, simulated.capture)
        if simulated.empty is not None:
            save_capture(temporary / EMPTY, simulated.empty)
        if scene.cameras:
            say(f"{scene.file.name}: {len(scene.cameras)} photographs")
        moves = any(row.effect == "motion" and row.on for row in simulated.rows)
        moving = surfaces(scene, radar_scene, frames) if moves else ()
        return write_photos(scene, temporary, simulated.rows, moving)


def write_photos(
    scene: Scene,
    folder: str | Path,
    rows: tuple[Choice, ...] = (),
    moving: Iterable[tuple[np.ndarray, np.ndarray]] = (),
) -> tuple[Choice, ...]:
    """Write a scene's photographs and all other files of its capture folder, except the echoes.

    The files are `photos/` (if the scene has cameras), `truth.ply` (true surface in the radar
    frame, metres), `truth_radar_from_photo.json`, `target.toml` for a calibration target, and
    `capture.toml`. rows: the effects in the echoes. moving: of a moving target, the vertices and
    their velocities at the start of each frame (see `surfaces`), which are written to
    `truth/000.ply` and so on. Returns the rows, followed by those of the photographs.
    """
    folder = Path(folder)
    folder.mkdir(parents=True, exist_ok=True)
    write_mesh(folder / TRUTH, scene.target_mesh)
    for frame, (vertices_m, velocity_m_s) in enumerate(moving):
        file = folder / TRUTHS / f"{frame:03}.ply"
        file.parent.mkdir(exist_ok=True)
        faces = np.asarray(scene.target_mesh.triangles)
        write_ply(file, by_axis(vertices_m) | by_axis(velocity_m_s, "v"), faces)
        if frame == 0:
            shutil.copyfile(file, folder / TRUTH)
    scene.radar_from_photo.save(folder / TRUE_TRANSFORM)
    if scene.target is not None:
        write_text(folder / TARGET, tomlkit.dumps(scene.target.model_dump()))
    if scene.cameras:
        studio = Studio(scene)
        rows += photo_effects(studio.photos)
        _write_photographs(scene, folder / PHOTOS, studio)
    contains = sorted(path.name for path in folder.iterdir())
    save_capture_file(folder, _described(scene, contains, rows))
    return rows


def _described(scene: Scene, contains: list[str], rows: tuple[Choice, ...]) -> CaptureFile:
    """Return the content of a simulated capture's `capture.toml`. contains: names of the folder's
    other files; rows: the simulated effects."""
    target = scene.file.target
    hand = isinstance(target, HandTarget | MeshTarget)
    pose = target.pose if isinstance(target, HandTarget) else None
    return CaptureFile(
        name=scene.file.name,
        kind="hand" if hand else "other" if scene.target is None else "target",
        pose=pose if pose is None or isinstance(pose, str) else "free",
        distance_m=target.distance_m,
        seed=scene.file.seed,
        box_m=scene.box_m.ravel().round(6).tolist(),
        contains=tuple(contains),
        effects=rows,
    )


def _write_photographs(scene: Scene, folder: Path, studio: Studio) -> None:
    """Write the scene's photographs into a folder, with the intrinsics (`cameras.json`), the true
    cameras (`truth_cameras.json`) and the ArUco board (`board.toml`)."""
    import cv2

    load_pycolmap()  # here, not in a thread

    def take(number: int) -> None:
        camera = scene.cameras[number]
        image = studio.photograph(camera, number)
        _, packed = cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY])
        with atomic_path(folder / camera.name) as temporary:
            # not by OpenCV, which does not mind a full disk
            temporary.write_bytes(packed.tobytes())

    for_each(take, range(len(scene.cameras)))
    save_cameras(
        folder / "cameras.json",
        tuple(c.model_copy(update={"R": None, "t": None}) for c in scene.cameras),
    )
    save_cameras(folder / "truth_cameras.json", scene.cameras)
    save_board(folder / "board.toml", stand_board())

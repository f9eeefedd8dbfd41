"""The optical half of a capture folder: photographs, cameras, board, true surface, description."""

from __future__ import annotations

from pathlib import Path

import tomlkit

from bench.scenes.build import Scene
from bench.scenes.photographs import Studio
from bench.scenes.scene_file import HandTarget, MeshTarget
from groundtruth.board.board import save_board
from groundtruth.cameras.cameras import load_pycolmap, save_cameras
from groundtruth.mesh.mesh_files import write_mesh
from radar.simulation.selection import Choice
from radar.support.files import atomic_path, write_text
from radar.support.parallel import for_each

JPEG_QUALITY = 96


def write_photos(scene: Scene, folder: str | Path, rows: tuple[Choice, ...] = ()) -> None:
    """Write everything but the echoes: `photos/` (when the scene has any), `truth.ply` (metres, radar frame),
    `truth_radar_from_photo.json`, `target.toml` for a calibration target, and `capture.toml`; rows: of the effects."""
    folder = Path(folder)
    folder.mkdir(parents=True, exist_ok=True)
    write_mesh(folder / "truth.ply", scene.target_mesh)
    scene.radar_from_photo.save(folder / "truth_radar_from_photo.json")
    if scene.target is not None:
        _write_toml(folder / "target.toml", scene.target.model_dump())
    if scene.cameras:
        _write_photographs(scene, folder / "photos")
    _write_toml(folder / "capture.toml", description(scene, sorted(path.name for path in folder.iterdir()), rows))


def description(scene: Scene, contains: list[str], rows: tuple[Choice, ...]) -> dict:
    """The content of `capture.toml`; contains: what lies beside it; rows: the effects'."""
    target = scene.file.target
    return {
        "version": 1,
        "name": scene.file.name,
        "kind": _kind(scene),
        "pose": _pose(scene),
        "distance_m": target.distance_m,
        "units": "m",
        "seed": scene.file.seed,
        "box_m": scene.box_m.ravel().round(6).tolist(),
        "contains": contains,
        "effects": [row.model_dump(exclude_none=True) for row in rows],
    }


def _kind(scene: Scene) -> str:
    if scene.target is not None:
        return "target"
    return "hand" if isinstance(scene.file.target, HandTarget | MeshTarget) else "other"


def _pose(scene: Scene) -> str:
    target = scene.file.target
    if not isinstance(target, HandTarget):
        return ""
    return target.pose if isinstance(target.pose, str) else "free"


def _write_photographs(scene: Scene, folder: Path) -> None:
    import cv2

    studio = Studio(scene)
    load_pycolmap()  # here, not in a thread

    def take(number: int) -> None:
        camera = scene.cameras[number]
        image = studio.photograph(camera, number)
        _, packed = cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY])
        with atomic_path(folder / camera.name) as temporary:
            temporary.write_bytes(packed.tobytes())  # not by OpenCV, which does not mind a full disk

    for_each(take, range(len(scene.cameras)))
    save_cameras(folder / "cameras.json", tuple(c.model_copy(update={"R": None, "t": None}) for c in scene.cameras))
    save_cameras(folder / "truth_cameras.json", scene.cameras)
    save_board(folder / "board.toml", scene.board)


def _write_toml(path: Path, content: dict) -> None:
    write_text(path, tomlkit.dumps(content))

"""Photographs to a mesh: what is refused, and the eleven photographs of the fountain."""

import json
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from handbench.calibration.transforms import umeyama
from handbench.groundtruth.cameras.cameras import Camera, load_pycolmap, save_cameras
from handbench.groundtruth.mesh.mesh_files import raycasting_scene
from handbench.groundtruth.options import Options
from handbench.groundtruth.photos.photos import find_photos
from handbench.groundtruth.pipeline import reconstruct
from handbench.groundtruth.sparse.sfm import Lenses, structure_from_motion
from handbench.support.errors import HandbenchError

FOUNTAIN = Path(__file__).parents[2].parent / "shared" / "data" / "fountain-P11"


@pytest.fixture
def folder(tmp_path):
    for i in range(4):
        noise = np.random.default_rng(i).integers(0, 255, (120, 160), dtype=np.uint8)
        Image.fromarray(noise).save(tmp_path / f"p{i}.png")
    return tmp_path


def cameras(size=(160, 120), names=range(4)):
    return tuple(
        Camera(
            name=f"p{i}.png", width=size[0], height=size[1], params=(200, 200, 80, 60, 0, 0, 0, 0)
        )
        for i in names
    )


def test_without_a_scale_it_refuses_before_it_starts(folder):
    with pytest.raises(HandbenchError, match=r"nothing gives the scale.*--unscaled"):
        reconstruct(folder, Options())
    save_cameras(folder / "cameras.json", cameras())  # picked up, but without poses
    with pytest.raises(HandbenchError, match="nothing gives the scale"):
        reconstruct(folder, Options())


def test_cameras_must_fit_the_photographs(folder):
    save_cameras(folder / "other.json", cameras(names=range(3)))
    with pytest.raises(HandbenchError, match=r"other\.json: has no camera for p3\.png"):
        reconstruct(folder, Options(cameras=folder / "other.json", unscaled=True))
    save_cameras(folder / "cameras.json", cameras(size=(120, 160)))
    with pytest.raises(
        HandbenchError, match=r"p0\.png is 120 × 160 there, the photograph has 160 × 120"
    ):
        reconstruct(folder, Options(unscaled=True))
    with pytest.raises(HandbenchError, match="both are given"):
        reconstruct(
            folder, Options(cameras=folder / "cameras.json", intrinsics=(1, 1, 1, 1), unscaled=True)
        )


def test_a_box_inside_out_is_refused(folder):
    with pytest.raises(HandbenchError, match="box_m"):
        reconstruct(folder, Options(unscaled=True, box_m=(0, 0, 1, 1, 1, 0)))


def test_photographs_of_nothing_do_not_register(folder):
    with pytest.raises(
        HandbenchError, match="only 0 of 4 photographs could be registered, 3 are needed"
    ):
        reconstruct(folder, Options(unscaled=True))


def fountain(folder, shrink):
    """Write the photographs, shrunk from 3072 × 2048 pixels to save time, and the surveyed cameras;
    returns these."""
    if not FOUNTAIN.is_dir():
        pytest.skip(f"{FOUNTAIN} is missing")
    surveyed = []
    for path in sorted((FOUNTAIN / "images").glob("*.jpg")):
        with Image.open(path) as image:
            image.reduce(shrink).save(folder / path.name, quality=95)
        rows = [
            list(map(float, line.split()))
            for line in _lines(FOUNTAIN / "cameras" / f"{path.name}.camera")
        ]
        K, R, centre_m = np.array(rows[:3]) / shrink, np.array(rows[4:7]).T, np.array(rows[7])
        surveyed.append(
            Camera(
                name=path.name,
                width=3072 // shrink,
                height=-(-2048 // shrink),
                params=(K[0, 0], K[1, 1], K[0, 2], K[1, 2], 0, 0, 0, 0),
                R=tuple(map(tuple, R.tolist())),
                t=tuple((-R @ centre_m).tolist()),
            )
        )
    save_cameras(folder / "cameras.json", tuple(surveyed))
    return {camera.name: camera for camera in surveyed}


def _lines(path):
    return [line for line in path.read_text().splitlines() if line.strip()]


def test_fountain_registers_with_one_given_k(tmp_path):
    """COLMAP is 2.55 mm off the survey with all pixels and K given; 4 mm leaves room for a quarter
    of the pixels."""
    surveyed = fountain(tmp_path, shrink=2)
    params = next(iter(surveyed.values())).params
    (tmp_path / "sfm").mkdir()
    model = structure_from_motion(
        find_photos(tmp_path), tmp_path / "sfm", Lenses(intrinsics=params[:4])
    )
    images = list(model.images.values())
    centres = np.array([image.projection_center() for image in images])
    truth_m = np.array([surveyed[image.name].centre_m for image in images])
    matrix = umeyama(centres, truth_m, with_scale=True)
    error_m = np.linalg.norm(centres @ matrix[:3, :3].T + matrix[:3, 3] - truth_m, axis=1)
    assert len(images) == 11
    assert error_m.mean() < 4e-3
    assert [tuple(camera.params) for camera in model.cameras.values()] == [
        params[:4]
    ]  # bit for bit


def test_fountain_becomes_a_mesh_in_the_surveys_metres(tmp_path):
    surveyed = fountain(tmp_path, shrink=3)
    box_m = (-17.0, -12.5, -1.5, -14.5, -9.5, 1.0)  # its middle, for the time it takes
    result = reconstruct(tmp_path, Options(quality="draft", box_m=box_m), tmp_path / "work")
    assert len(result.cameras) == result.photographs == 11
    for camera in result.cameras:
        assert np.linalg.norm(camera.centre_m - surveyed[camera.name].centre_m) < 0.015
    assert result.scale.source == "poses" and result.scale.residual_m < 6e-3
    summary = json.loads((tmp_path / "work" / "summary.json").read_text())
    assert summary["registered"] == 11 and summary["options"]["quality"] == "draft"
    sparse = load_pycolmap().Reconstruction()
    sparse.read(tmp_path / "work" / "sparse")
    assert sparse.num_reg_images() == 11
    assert (tmp_path / "work" / "dense.ply").stat().st_size > 10_000
    vertices = result.surface.vertices_m
    assert ((vertices >= box_m[:3]) & (vertices <= box_m[3:])).all()
    points_m = np.array([p.xyz for p in sparse.points3D.values() if p.track.length() >= 4])
    points_m = points_m[
        ((points_m > np.array(box_m[:3]) + 0.1) & (points_m < np.array(box_m[3:]) - 0.1)).all(
            axis=1
        )
    ]
    distance_m = (
        raycasting_scene(result.surface.mesh).compute_distance(points_m.astype(np.float32)).numpy()
    )
    # two independent ways to the same surface: features triangulated, and depth maps of a quarter
    # of the resolution
    assert len(points_m) > 100 and np.median(distance_m) < 0.5 * result.cloud.pixel_m

"""Broken files: every reader reads them or refuses them with a HandbenchError."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory

import pytest
from hypothesis import given
from hypothesis import strategies as st

from handbench.bench.datasets.dataset import load_any_transform
from handbench.bench.scenes.scene_file import SceneFile
from handbench.calibration.target import load_target
from handbench.groundtruth.board import load_board
from handbench.groundtruth.camera_files import read_metashape
from handbench.groundtruth.cameras import load_cameras
from handbench.groundtruth.mesh.surface import read_surface
from handbench.groundtruth.pictures import open_picture
from handbench.radar.data.depthmap import load_depthmap
from handbench.radar.data.echoes_file import load_capture
from handbench.support.config import load
from handbench.support.errors import HandbenchError
from tests.strategies import examples

SEEDS = Path(__file__).with_name("seeds")  # a small valid file for each reader
FOUND = Path(__file__).with_name("found")  # what--NAME: broken ones that were not refused once


def read_picture(path: Path) -> None:
    with open_picture(path) as picture:
        picture.load()


READERS: dict[str, Callable[[Path], object]] = {
    "board.toml": load_board,
    "cameras.json": load_cameras,
    "cameras.xml": read_metashape,
    "depth.npz": load_depthmap,
    "echoes.h5": load_capture,
    "mesh.obj": read_surface,
    "mesh.ply": read_surface,
    "mesh.stl": read_surface,
    "photo.jpg": read_picture,
    "photo.png": read_picture,
    "scene.toml": partial(load, SceneFile, what="a scene"),
    "target.toml": load_target,
    "transform.json": load_any_transform,
}


@pytest.mark.parametrize("name", READERS)
def test_the_seeds_are_valid(name):
    READERS[name](SEEDS / name)


@pytest.mark.parametrize("name", READERS)
@given(data=st.data())
@examples(20)
def test_a_truncated_flipped_or_repeated_file_is_read_or_refused(name, data):
    content = (SEEDS / name).read_bytes()
    place = st.integers(0, len(content) - 1)
    start, stop = sorted((data.draw(place), data.draw(place)))
    flipped = bytes([content[start] ^ data.draw(st.integers(1, 255))])
    broken = data.draw(
        st.sampled_from(
            (
                content[:start],
                content[:start] + flipped + content[start + 1 :],
                content[:start] + content[stop:],
                content[:stop] + content[start:],
            )
        )
    )
    with TemporaryDirectory() as folder, suppress(HandbenchError):
        (Path(folder) / name).write_bytes(broken)
        READERS[name](Path(folder) / name)


@pytest.mark.parametrize("file", sorted(FOUND.iterdir()), ids=lambda file: file.name)
def test_a_file_that_did_harm_is_refused(file, tmp_path):
    name = file.name.partition("--")[2]
    (tmp_path / name).write_bytes(file.read_bytes())
    with pytest.raises(HandbenchError):
        READERS[name](tmp_path / name)

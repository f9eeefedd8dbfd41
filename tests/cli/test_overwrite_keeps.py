"""--overwrite deletes only files that the command itself has written; others are named and kept."""

import shutil

import pytest

from handbench.bench.datasets.simulated import WRITTEN
from handbench.cli.main import main
from handbench.cli.options import free_folder
from handbench.support.errors import HandbenchError


@pytest.fixture(scope="module")
def simulated(small_result, tmp_path_factory):
    """The capture of a ball, as `handbench simulate` writes it, and its scene."""
    folder = tmp_path_factory.mktemp("kept")
    shutil.copytree(next((small_result / "work").glob("simulate-*")) / "capture", folder / "ball")
    return folder / "ball"


ADDED = ("notes.txt", "array.json", "photos/IMG_0001.jpg", "deep/er/a.txt", ".hidden")


@pytest.mark.parametrize("name", ADDED)
def test_a_file_that_the_user_added_is_named_and_kept(simulated, tmp_path, name):
    capture = tmp_path / "ball"
    shutil.copytree(simulated, capture)
    free_folder(capture, True, WRITTEN)  # as it was written
    (capture / name).parent.mkdir(parents=True, exist_ok=True)
    (capture / name).write_text("mine")
    with pytest.raises(HandbenchError, match=f"has a file {name} that this command did not write"):
        free_folder(capture, True, WRITTEN)
    assert (capture / name).read_text() == "mine"


def test_a_recorded_capture_is_no_simulated_one(small_bench, simulated, tmp_path, capsys):
    capture = tmp_path / "recorded"
    capture.mkdir()
    for name in ("capture.toml", "echoes.h5"):
        shutil.copyfile(simulated / name, capture / name)
    before = (capture / "echoes.h5").read_bytes()
    scene = str(small_bench.parent / "ball.toml")
    assert main(["simulate", scene, "-o", str(capture), "--overwrite"]) == 2
    assert "this command did not make this folder" in " ".join(capsys.readouterr().err.split())
    assert (capture / "echoes.h5").read_bytes() == before

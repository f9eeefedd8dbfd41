"""--overwrite deletes only files that the command itself has written; others are named and kept."""

import shutil

import pytest

from handbench.bench.datasets.simulated import WRITTEN
from handbench.support.files import free_folder
from tests.refusals import refuse


@pytest.mark.parametrize(
    "name", ["notes.txt", "array.json", "photos/IMG_0001.jpg", "deep/er/a.txt", ".hidden"]
)
def test_a_file_that_the_user_added_is_named_and_kept(small_result, tmp_path, name):
    [simulated] = (small_result / "work").glob("simulate-*/capture")
    capture = shutil.copytree(simulated, tmp_path / "ball")
    free_folder(capture, True, WRITTEN)  # as it was written
    (capture / name).parent.mkdir(parents=True, exist_ok=True)
    (capture / name).write_text("mine")
    refuse(lambda: free_folder(capture, True, WRITTEN), str(capture), name)
    assert (capture / name).read_text() == "mine"

"""The stages of a reconstruction: what each depends on, and what the sparse one keeps."""

import numpy as np
import pytest

from handbench.cli.main import main
from handbench.groundtruth import pipeline
from handbench.groundtruth.cameras import load_pycolmap
from handbench.groundtruth.options import Options
from handbench.groundtruth.sparse.frame import Scale
from handbench.groundtruth.sparse.sparse import Sparse
from tests.groundtruth.noisy_model import noisy_model
from tests.groundtruth.room import photograph

# Another value of each option, and the first stage that it concerns; of paths, the files' content
# is in the key instead, which the caller hashes.
OTHER = {
    "intrinsics": ((1, 1, 1, 1), 0),
    "lenses": ("each", 0),
    "metric": (True, 0),
    "unscaled": (True, 0),
    "seed": (1, 0),
    "box_m": ((0, 0, 0, 1, 1, 1), 1),
    "quality": ("draft", 1),
    "dense": ("cuda", 1),
}


def test_an_option_is_in_the_keys_of_the_stages_that_it_concerns(tmp_path):
    def keys(masks=None, **options):
        chain = pipeline.stages(tmp_path, tmp_path, Options(**options), ["p"], masks)
        return [stage.key for stage in chain]

    assert OTHER.keys() | pipeline.FILES == Options.model_fields.keys()
    for name, (value, first) in OTHER.items():
        changed = [old != new for old, new in zip(keys(), keys(**{name: value}), strict=True)]
        assert changed == [k >= first for k in range(3)], name
    assert keys("a")[0] == keys("b")[0] and keys("a")[1] != keys("b")[1]


def test_the_sparse_stage_comes_back(tmp_path):
    scene, scale = noisy_model(), Scale("board", 20, 19, 1.25e-5)
    saved = Sparse(scene.model, scale, scene.covariance())
    saved.save(tmp_path)
    loaded = Sparse.load(tmp_path)
    assert loaded.scale == scale and loaded.cameras() == saved.cameras()
    np.testing.assert_array_equal(loaded.covariance, saved.covariance)


@pytest.mark.slow
def test_the_command_goes_on_from_its_stages(tmp_path, capsys):
    """Real photographs, real stages: COLMAP, PatchMatch, Poisson."""
    photos, out, work = (tmp_path / name for name in ("photos", "mesh.ply", "work"))
    photos.mkdir()
    photograph(photos)
    command = ["groundtruth", str(photos), "-o", str(out), "--unscaled", "--overwrite"]
    command += ["--quality", "draft", "--workdir", str(work)]
    for cached in (0, 3):
        assert main(command) == 0
        assert capsys.readouterr().err.count(": cached") == cached
    assert out.is_file() and not list(work.glob("**/.*"))
    assert load_pycolmap().Reconstruction(str(work / "sparse")).num_reg_images() == 4

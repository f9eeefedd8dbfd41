"""The stages of a reconstruction: what each depends on, and what the sparse one keeps."""

from pathlib import Path

import numpy as np
import pytest

from handbench.cli.main import main
from handbench.groundtruth import pipeline
from handbench.groundtruth.cameras.cameras import load_pycolmap
from handbench.groundtruth.options import Options
from handbench.groundtruth.sparse.frame import Scale
from handbench.groundtruth.sparse.sparse import Sparse
from handbench.support.errors import HandbenchError
from tests.groundtruth.noisy_model import adjusted, noisy_model
from tests.groundtruth.room import photograph

# The first stage that an option concerns, where it is not the first of all.
FIRST = dict.fromkeys(("box_m", "quality", "dense", "masks"), 1)


@pytest.mark.parametrize("name", sorted(Options.model_fields))
def test_a_stage_that_is_given_an_option_has_it_in_its_key(name, tmp_path):
    """Of paths the files' content is in the key instead, which the caller hashes."""
    other = {
        "cameras": Path("c"),
        "board": Path("b"),
        "masks": Path("m"),
        "intrinsics": (1, 1, 1, 1),
        "box_m": (0, 0, 0, 1, 1, 1),
        "quality": "draft",
        "dense": "cuda",
        "seed": 1,
        "lenses": "each",
    }.get(name, True)
    before, after = (
        pipeline.stages(tmp_path, tmp_path, Options(**options), ["p"])
        for options in ({}, {name: other})
    )
    given = [name in stage.arguments["options"] for stage in before]
    assert given.index(True) == FIRST.get(name, 0)
    if not isinstance(other, Path):
        changed = [old.key != new.key for old, new in zip(before, after, strict=True)]
        assert changed == [k >= given.index(True) for k in range(3)]


def test_other_masks_make_another_dense_stage(tmp_path):
    chains = [
        pipeline.stages(tmp_path, tmp_path, Options(), [], masks) for masks in (None, "a", "b")
    ]
    sparse, dense, _ = ({stage.key for stage in each} for each in zip(*chains, strict=True))
    assert len(sparse) == 1 and len(dense) == 3


def test_the_sparse_stage_comes_back(tmp_path):
    scene, scale = noisy_model(), Scale("board", 20, 19, 1.25e-5)
    before = Sparse(scene.model, scale, adjusted(scene))
    before.save(tmp_path)
    after = Sparse.load(tmp_path)
    assert after.scale == scale and after.cameras() == before.cameras()
    np.testing.assert_array_equal(after.covariance, before.covariance)
    (tmp_path / "scale.json").unlink()
    with pytest.raises(
        HandbenchError, match=r"scale\.json: expected a sparse stage's scale, found no such file"
    ):
        Sparse.load(tmp_path)


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

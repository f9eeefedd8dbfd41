"""The stages of a reconstruction: what each depends on, and what the sparse one keeps."""

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from handbench.cli.main import main
from handbench.groundtruth import dense_stage, mesh_stage, pipeline, sparse_stage
from handbench.groundtruth.cameras.cameras import load_pycolmap
from handbench.groundtruth.dense.fusion import Cloud
from handbench.groundtruth.mesh.surface import Surface
from handbench.groundtruth.mesh.target import TargetParts
from handbench.groundtruth.options import Distance, Options
from handbench.groundtruth.photos.photos import find_photos
from handbench.groundtruth.sparse.frame import Scale
from handbench.groundtruth.sparse.inputs import SparseInputs
from handbench.groundtruth.sparse.sparse import Sparse
from handbench.support.errors import HandbenchError
from tests.groundtruth.noisy_model import adjusted, noisy_model
from tests.groundtruth.room import photograph

ROOT = Path(__file__).parents[2]


@pytest.fixture
def counted(tmp_path, monkeypatch):
    """`reconstruct` with stages that do next to nothing; returns the function and the list of what
    was made."""
    made = []
    scene = noisy_model()
    solved = Sparse(scene.model, Scale("distances", 20, 20, 1e-5), adjusted(scene)[1])
    photos = tmp_path / "photos"
    photos.mkdir()
    for k, camera in enumerate(solved.cameras()):
        Image.new("L", (camera.width, camera.height), k).save(photos / camera.name)

    def step(name, result):
        return lambda *_: (made.append(name), result)[1]

    x, y = (axis.ravel() for axis in np.meshgrid(*[1e-3 * np.arange(-15.0, 16)] * 2))
    points_m, n = np.stack([x, y, 0 * x], axis=1), len(x)
    names = tuple(camera.name for camera in solved.cameras())
    facing, seen = np.tile([0.0, 0, 1], (n, 1)), np.ones((n, 5), bool)
    cloud = Cloud(points_m, facing, seen, np.full(n, 1e-4), names, 1e-3)
    triangle = points_m[[0, 1, -1]], np.array([(0, 1, 2)])
    surface = Surface(*triangle, np.full(3, 1e-4), np.ones(3, bool))
    monkeypatch.setattr(
        sparse_stage,
        "gather",
        lambda _, options: (SparseInputs(find_photos(photos), None, None, {}), options),
    )
    monkeypatch.setattr(sparse_stage, "register", step("sparse", solved))
    monkeypatch.setattr(dense_stage, "dense_cloud", step("dense", cloud))
    monkeypatch.setattr(
        mesh_stage,
        "measured_surface",
        step("mesh", (surface, TargetParts("all parts", 0.0, (1.0,), 0, 0.0))),
    )
    monkeypatch.setattr(pipeline, "resolve", lambda folder, options: (find_photos(folder), options))

    def run(**options):
        made.clear()
        result = pipeline.reconstruct(photos, Options(unscaled=True, **options), tmp_path / "work")
        return made.copy(), result

    return run


def test_each_option_reaches_the_stages_that_it_concerns(counted):
    everything, first = counted()
    assert everything == ["sparse", "dense", "mesh"]
    again, second = counted()
    assert again == []
    assert second.seconds == first.seconds and set(first.seconds) == {"sparse", "dense", "mesh"}
    np.testing.assert_array_equal(second.surface.sigma_m, first.surface.sigma_m)
    np.testing.assert_array_equal(second.cloud.views, first.cloud.views)
    for options, expected in (
        ({"components": "all"}, ["mesh"]),
        ({"quality": "draft"}, ["dense", "mesh"]),
        ({"box_m": (0, 0, 0, 1, 1, 1)}, ["dense", "mesh"]),
        ({"seed": 1}, ["sparse", "dense", "mesh"]),
        ({"metric": True}, ["sparse", "dense", "mesh"]),
        ({}, []),
    ):
        assert counted(**options)[0] == expected, options


@pytest.mark.parametrize("name", sorted(Options.model_fields))
def test_a_stage_that_is_given_an_option_has_it_in_its_key(name, tmp_path):
    """Of paths the files' content is in the key instead, which the caller hashes."""
    other = {
        "cameras": Path("c"),
        "model": Path("m"),
        "board": Path("b"),
        "masks": Path("m"),
        "intrinsics": (1, 1, 1, 1),
        "distances": (Distance(first="a", second="b", distance_m=1),),
        "box_m": (0, 0, 0, 1, 1, 1),
        "quality": "draft",
        "mask": "colour",
        "dense": "cuda",
        "components": "all",
        "seed": 1,
        "shared_intrinsics": False,
    }.get(name, True)
    before, after = (
        pipeline.stages(tmp_path, tmp_path, Options(**options), ["p"])
        for options in ({}, {name: other})
    )
    given = [name in stage.arguments["options"] for stage in before]
    assert any(given)
    if not isinstance(other, Path):
        changed = [old.key != new.key for old, new in zip(before, after, strict=True)]
        assert changed == [k >= given.index(True) for k in range(3)]


def test_a_run_goes_on_where_it_was_killed(counted, monkeypatch, tmp_path):
    def killed(*_):
        raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        patch.setattr(dense_stage, "dense_cloud", killed)
        with pytest.raises(KeyboardInterrupt):
            counted()
    assert [path.name[:6] for path in (tmp_path / "work" / "stages").iterdir()] == ["sparse"]
    assert counted()[0] == ["dense", "mesh"]


def test_other_masks_make_another_dense_stage(tmp_path):
    chains = [
        pipeline.stages(tmp_path, tmp_path, Options(), [], masks) for masks in (None, "a", "b")
    ]
    sparse, dense, _ = ({stage.key for stage in each} for each in zip(*chains, strict=True))
    assert len(sparse) == 1 and len(dense) == 3


@pytest.mark.parametrize("free", [(), tuple(range(8))])
def test_the_sparse_stage_comes_back(tmp_path, free):
    scene, scale = noisy_model(), Scale("board", 20, 19, 1.25e-5)
    before = Sparse(scene.model, scale, adjusted(scene, free)[1])
    before.save(tmp_path)
    after = Sparse.load(tmp_path)
    assert after.scale == scale and after.cameras() == before.cameras()
    np.testing.assert_array_equal(after.known.matrix, before.known.matrix)
    assert after.known.free == free
    for name, columns in before.known.places.items():
        np.testing.assert_array_equal(after.known.places[name], columns)
    (tmp_path / "scale.json").unlink()
    with pytest.raises(
        HandbenchError, match=r"scale\.json: expected a sparse stage's scale, found nothing"
    ):
        Sparse.load(tmp_path)


KILLED = """
import os, sys
from handbench.cli.main import main
from handbench.groundtruth import pipeline
cached = pipeline.cached

def killed(root, stage):
    made = cached(root, stage)
    if stage.name == sys.argv[1]:
        os._exit(9)
    return made

pipeline.cached = killed
sys.exit(main(sys.argv[2:]))
"""


@pytest.mark.slow
def test_the_command_killed_after_a_stage_goes_on_there(tmp_path, capsys):
    """Real photographs, real stages: COLMAP, plane sweep, Poisson. (A kill after the first, of
    stages that do nothing, is above.)"""
    photos, out, work = (tmp_path / name for name in ("photos", "mesh.ply", "work"))
    photos.mkdir()
    photograph(photos)
    command = ["groundtruth", str(photos), "-o", str(out), "--unscaled", "--overwrite"]
    command += ["--quality", "draft", "--workdir", str(work)]
    done = subprocess.run(
        [sys.executable, "-c", KILLED, "dense", *command], capture_output=True, text=True, cwd=ROOT
    )
    assert done.returncode == 9 and "cached" not in done.stderr
    for kept in ({"sparse", "dense"}, {"sparse", "dense", "mesh"}):
        assert main(command) == 0
        said = capsys.readouterr().err
        assert {s for s in ("sparse", "dense", "mesh") if f"{s}: cached" in said} == kept
    assert out.is_file() and not list(work.glob("**/.*"))
    assert load_pycolmap().Reconstruction(str(work / "sparse")).num_reg_images() == 4

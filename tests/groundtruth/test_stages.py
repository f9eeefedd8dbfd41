"""Stages that are kept, and what the sparse one keeps."""

import numpy as np
import pytest

from groundtruth import pipeline
from groundtruth.options import Options
from groundtruth.pipeline import STAMP, Stages, reconstruct
from groundtruth.sparse import inputs
from groundtruth.sparse.adjust import adjust
from groundtruth.sparse.bundle import Bundle
from groundtruth.sparse.covariance import camera_covariance
from groundtruth.sparse.frame import Scale
from groundtruth.sparse.sparse import INTRINSICS, Sparse
from radar.support.errors import HandbenchError
from radar.support.store import MANIFEST
from tests.groundtruth.noisy_model import noisy_model, poses_of


@pytest.fixture
def make():
    """A stage that counts how often it was made."""

    class Made:
        count = 0

        def __call__(self, folder):
            self.count += 1
            (folder / "result.txt").write_text(f"made {self.count}")

    return Made()


def test_what_was_made_is_not_made_again(tmp_path, make, capsys):
    first = Stages(tmp_path)
    folder = first("dense", ["a", 1, None], make)
    assert "cached" not in capsys.readouterr().err
    second = Stages(tmp_path)
    assert second("dense", ["a", 1, None], make) == folder
    assert capsys.readouterr().err == "dense: cached\n"
    assert make.count == 1 and (folder / "result.txt").read_text() == "made 1"
    assert second.seconds == first.seconds and first.seconds["dense"] >= 0  # of the time when it was made


@pytest.mark.parametrize("other", [["b", 1, None], ["a", 2, None], ["a", 1, ""], ["a", 1], ["a", None, 1]])
def test_what_depends_on_something_else_is_another_folder(tmp_path, make, other):
    stages = Stages(tmp_path)
    folders = {stages("dense", ["a", 1, None], make), stages("dense", other, make), stages("mesh", other, make)}
    assert len(folders) == make.count == 3


@pytest.mark.parametrize("end", [KeyboardInterrupt, ValueError, HandbenchError("known")])
def test_a_stage_that_was_killed_leaves_nothing_and_is_made_again(tmp_path, make, end):
    def killed(folder):
        (folder / "half.txt").write_text("half")
        raise end

    stages = Stages(tmp_path)
    with pytest.raises(end if isinstance(end, type) else type(end)):
        stages("dense", ["a"], killed)
    assert not list(tmp_path.iterdir()) and not stages.seconds
    folder = stages("dense", ["a"], make)
    assert {path.name for path in folder.iterdir()} == {"result.txt", STAMP, MANIFEST}


def test_changed_code_is_another_folder(tmp_path, make, monkeypatch):
    stages = Stages(tmp_path)
    before = stages("dense", ["a"], make)
    monkeypatch.setattr(pipeline, "SOURCES", (*pipeline.SOURCES, "radar/support/errors.py"))
    assert stages("dense", ["a"], make) != before


@pytest.mark.parametrize("name", [STAMP, MANIFEST, "result.txt"])
def test_a_broken_file_is_named_and_the_stage_made_again(tmp_path, make, capsys, name):
    folder = Stages(tmp_path)("dense", ["a"], make)
    (folder / name).write_text("{")
    assert Stages(tmp_path)("dense", ["a"], make) == folder
    assert f"{name} " in capsys.readouterr().err and (folder / "result.txt").read_text() == "made 2"


@pytest.fixture
def counted(tmp_path, monkeypatch):
    """`reconstruct` with stages that do next to nothing; returns the function and the list of what was made."""
    made = []
    scene = noisy_model()
    adjust(scene.model, scene.corners, scene.corners_m)
    bundle = Bundle(scene.model, scene.corners, scene.corners_m)
    solved = Sparse(scene.model, Scale("board", 20, 20, 1e-5), camera_covariance(bundle, Scale("board")))
    found = inputs.Inputs((), None, None, {})

    def step(name, result):
        return lambda *_: (made.append(name), result)[1]

    x, y = np.meshgrid(*[1e-3 * np.arange(-15.0, 16)] * 2)
    points_m = np.stack([x, y, 0 * x], axis=-1).reshape(-1, 3)
    n = len(points_m)
    names = tuple(f"p{i}.png" for i in range(5))
    cloud = pipeline.Cloud(points_m, np.tile([0.0, 0, 1], (n, 1)), np.ones((n, 5), bool), np.full(n, 1e-4), names, 1e-3)
    surface = pipeline.Surface(points_m[:3], np.array([(0, 1, 2)]), np.full(3, 1e-4), np.ones(3, bool))
    surface.vertices_m[2] += (0, 1e-3, 0)
    monkeypatch.setattr(pipeline, "gather", lambda _, options: (found, options))
    monkeypatch.setattr(pipeline, "register", step("sparse", solved))
    monkeypatch.setattr(pipeline, "_dense_cloud", step("dense", cloud))
    monkeypatch.setattr(pipeline, "_surface", step("mesh", surface))

    def run(**options):
        made.clear()
        result = reconstruct(tmp_path, Options(unscaled=True, **options), tmp_path / "work")
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


def test_a_run_goes_on_where_it_was_killed(counted, monkeypatch, tmp_path):
    def killed(*_):
        raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        patch.setattr(pipeline, "_dense_cloud", killed)
        with pytest.raises(KeyboardInterrupt):
            counted()
    assert [path.name[:6] for path in (tmp_path / "work" / "stages").iterdir()] == ["sparse"]
    assert counted()[0] == ["dense", "mesh"]


@pytest.mark.parametrize("free", [(), INTRINSICS])
def test_the_sparse_stage_comes_back(tmp_path, free):
    scene = noisy_model()
    adjust(scene.model, scene.corners, scene.corners_m, free)
    bundle = Bundle(scene.model, scene.corners, scene.corners_m, free)
    scale = Scale("board", 20, 19, 1.25e-5)
    before = Sparse(scene.model, scale, camera_covariance(bundle, scale))
    before.save(tmp_path)
    after = Sparse.load(tmp_path)
    assert after.scale == scale and Scale(**vars(after.scale)).source == "board"
    np.testing.assert_array_equal(poses_of(after.model), poses_of(before.model))
    np.testing.assert_array_equal(after.known.matrix, before.known.matrix)
    assert [camera.name for camera in after.cameras()] == [f"p{i}.png" for i in range(5)]
    for ours, theirs in zip(after.cameras(), before.cameras(), strict=True):
        assert ours == theirs
    (tmp_path / "scale.json").unlink()
    with pytest.raises(HandbenchError, match=r"scale\.json: expected a sparse stage's scale, found nothing"):
        Sparse.load(tmp_path)

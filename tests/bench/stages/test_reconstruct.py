"""Maps for equal treatment, frames and repeated times, through the stages and through `handbench
run`'s folder."""

import json
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from handbench.bench.results.maps import depth_path
from handbench.bench.stages import reconstruct
from handbench.bench.stages.reconstruct import (
    FRAMES,
    REPEATS,
    WINDOW_PX,
    Imager,
    read_treated,
    repeat,
    write_treated,
)
from handbench.bench.stages.score import completed_by
from handbench.calibration.transforms import identity
from handbench.groundtruth.mesh.depth import Reference
from handbench.radar.data.depthmap import DepthMap
from handbench.radar.data.echoes_file import load_capture, save_capture
from handbench.radar.methods.alignment import Aligned
from handbench.radar.methods.backprojection import Backprojection
from handbench.radar.methods.fsk import Fsk
from tests.bench.run.faults import execute

AXIS_M = 1e-3 * np.arange(9.0)


def depth(z_m: np.ndarray) -> DepthMap:
    return DepthMap(AXIS_M, AXIS_M, z_m, np.zeros(z_m.shape, np.float32), "x")


def test_a_projection_is_averaged_afterwards(tmp_path):
    rng = np.random.default_rng(3)
    z_m = np.where(rng.random((9, 9)) < 0.8, rng.normal(0.3, 1e-3, (9, 9)), np.nan)
    write_treated(tmp_path, lambda config: depth(z_m), Backprojection(), depth(z_m))
    found, reach = read_treated(tmp_path), WINDOW_PX // 2
    np.testing.assert_allclose(found["none"], z_m, rtol=1e-7)  # float32 on the disk
    for y, x in np.argwhere(np.isfinite(z_m)):
        near = z_m[max(y - reach, 0) : y + reach + 1, max(x - reach, 0) : x + reach + 1]
        assert found["window"][y, x] == pytest.approx(np.nanmean(near), rel=1e-7)
    assert np.isnan(found["window"][np.isnan(z_m)]).all()


@pytest.mark.parametrize(
    ("each_s", "more"), [([0.01, 0.02], 13), ([0.12, 0.12], 1), ([0.3, 0.3], 0)]
)
def test_times_are_repeated_for_a_fifth_of_a_second(each_s, more, monkeypatch):
    """On a clock that images alone move, of which the frames take these times in turns."""
    clock = SimpleNamespace(now=0.0)
    monkeypatch.setattr(reconstruct, "clock_s", lambda: clock.now)

    def image(frame):
        clock.now += each_s[frame]

    imager = SimpleNamespace(frames=[0, 1], task=SimpleNamespace(image=image))
    found = Imager.repeated(imager, [each_s[0], each_s[1], each_s[0]])
    assert len(found) == 3 + more


FILTERED = {"filter_px": 9, "drop_doubtful": True}


@pytest.mark.parametrize(
    "settings",
    [Aligned(threshold_db=-12), Fsk(threshold_db=-12), Fsk(threshold_db=-12, **FILTERED)],
)
def test_a_method_with_filters_is_imaged_with_the_same_ones_and_its_own_tolerance(
    settings, tmp_path
):
    """3-FSK's own map is one of them."""
    asked = []

    def image(config) -> DepthMap:
        asked.append(config)
        return depth(np.full((9, 9), 1e-3 * config.filter_px))

    write_treated(tmp_path, image, settings, depth(np.full((9, 9), 5e-3)))
    seen = {(c.filter_px, c.threshold_db) for c in asked}
    plain = settings == Fsk(threshold_db=-12)
    own = {(WINDOW_PX, -12)} if plain else set()
    assert seen == {(1, -12), (WINDOW_PX, -12)} - own
    assert {(getattr(c, "drop_doubtful", False), c.tolerance) for c in asked} == {
        (False, settings.tolerance)
    }
    for name, px in (("none", 1), ("window", WINDOW_PX)):
        assert read_treated(tmp_path)[name][0, 0] == pytest.approx(1e-3 * px, rel=1e-6)


def test_the_completed_reference_is_the_truth_where_there_is_no_mesh():
    maps_m = np.array([[[0.3, np.nan, np.nan]], [[0.31, 0.32, np.nan]]])
    leverage = np.where(np.isfinite(maps_m[0])[..., None], 1.0, np.nan) * np.ones(6)
    mesh, truth = (
        Reference(z_m, sigma_m * z_m / z_m, leverage, identity("radar"), met)
        for z_m, sigma_m, met in zip(maps_m, (1e-4, 0), (maps_m[1] > 1, maps_m[1] > 0), strict=True)
    )
    both = completed_by(mesh, truth)
    np.testing.assert_array_equal(both.z_m, [[0.3, 0.32, np.nan]])
    np.testing.assert_array_equal(both.mesh_sigma_m, [[1e-4, 0, np.nan]])
    np.testing.assert_array_equal(both.leverage[0, :, 0], [1, 0, 0])
    assert both.met[0, 1] and not both.met[0, 2]


def test_frames_that_repeat_or_are_silent_count_for_no_precision(recorded, tmp_path):
    """Of four frames, two are left; the second is no echo, the third the first one again with
    another gain."""
    capture = load_capture(recorded / "echoes.h5")
    samples = capture.samples[[0, 0, 0, 1]]
    samples[1] = 0
    samples[2] *= 0.7j
    save_capture(recorded / "echoes.h5", replace(capture, samples=samples, frame_times_s=None))
    config = {axis: {"start_m": 0, "stop_m": 0.004, "step_m": 0.002} for axis in "xy"}
    arguments = (str(recorded), "2fsk", config, "cpu", 1, 4)
    for stage, file in ((repeat, REPEATS), (reconstruct.reconstruct, FRAMES)):
        stage(tmp_path, *arguments)
        z_m = np.load(tmp_path / file)["z_m"]
        assert len(z_m) == (2 if stage is repeat else 4)
        assert np.isnan(z_m.reshape(len(z_m), -1)).all(axis=1).tolist() == (
            [False] * 2 if stage is repeat else [False, True, False, False]
        )


def test_a_run_has_equal_treatment_frames_and_enough_times(
    small_bench, recorded, undoubted, tmp_path, monkeypatch
):
    """The times are those of the frames but the first, whose image plans, and of the repetitions;
    the error on common pixels is made by hand too, from the files alone."""
    monkeypatch.setattr(Imager, "repeated", lambda imager, seconds: [*seconds, 7.0])
    text = small_bench.read_text().replace("repeats = 3", "repeats = 3\nframes = 3")
    small_bench.write_text(text)
    result, out = execute(small_bench, tmp_path / "out"), tmp_path / "out"
    of_2fsk = result.table[result.table.method == "2fsk"].set_index("metric").value
    assert of_2fsk["frames_max_deviation_mm"] > 0
    assert of_2fsk["frames_largest_mm"] >= of_2fsk["max_mm"]
    equal = result.equal.set_index(["metric", "treatment", "method"]).value
    assert equal["mae_mm", "window", "2fsk"] > 0
    compared = result.comparisons.groupby("treatment").metric.agg(set)
    assert compared["none"] == compared["window"] == {"mae_mm"}
    maps = {}
    for method in ("2fsk", "narrowband"):
        [folder] = (out / "work").glob(f"reconstruct-ball-{method}-*")
        maps[method] = np.load(folder / "treated.npz")["none"].astype(float)
        seconds = json.loads((folder / "timing.json").read_text())["seconds"]
        assert len(seconds) == 3 and seconds[-1] == 7.0 and 7.0 not in seconds[:-1]
    truth_m = np.load(depth_path(out, "ball", "truth"))["z_m"]
    both = np.isfinite([truth_m, *maps.values()]).all(axis=0)
    for method, z_m in maps.items():
        expected_mm = 1e3 * np.abs(z_m - truth_m)[both].mean()
        assert equal["mae_mm", "none", method] == pytest.approx(expected_mm, rel=1e-9)

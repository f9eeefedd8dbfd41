"""Maps for equal treatment, frames and settled times, through the stages and through `handbench
run`'s folder."""

import json
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from handbench.bench import results
from handbench.bench.evaluation.treatments import OPEN_DB, WINDOW_PX
from handbench.bench.run import reconstruct_stage
from handbench.bench.run.benchmark_file import load_benchmark
from handbench.bench.run.reconstruct_stage import read_treated, settled, write_treated
from handbench.bench.run.runner import run
from handbench.bench.run.scoring import completed_by
from handbench.calibration.transforms import identity
from handbench.groundtruth.mesh.depth import Reference
from handbench.radar.data.depthmap import DepthMap
from handbench.radar.methods.fsk_config import ThreeToneConfig
from handbench.radar.methods.projection_config import AlignedConfig, NarrowbandConfig

AXIS_M = 1e-3 * np.arange(9.0)


def depth(z_m: np.ndarray) -> DepthMap:
    return DepthMap(AXIS_M, AXIS_M, z_m, np.zeros(z_m.shape, np.float32), "x")


def test_a_method_with_filters_is_imaged_with_all_of_them_alike(tmp_path):
    asked = []

    def image(config: ThreeToneConfig) -> DepthMap:
        asked.append(config)
        return depth(np.full((9, 9), 1e-3 * config.coarse_filter_px))

    own = ThreeToneConfig(coarse_filter_px=3, fine_filter_px=9, drop_wrapped=True, threshold_db=-12)
    write_treated(tmp_path, image, own, depth(np.zeros((9, 9))))
    widths = [(c.coarse_filter_px, c.fine_filter_px, c.threshold_db, c.drop_wrapped) for c in asked]
    assert widths == [(p, p, db, False) for p in (1, WINDOW_PX) for db in (-12, OPEN_DB)]
    found = read_treated(tmp_path)
    assert found["none"].z_m[0, 0] == pytest.approx(1e-3) and found["window"].open_z_m[
        0, 0
    ] == pytest.approx(5e-3)


def test_a_projection_is_averaged_afterwards(tmp_path):
    rng = np.random.default_rng(3)
    z_m = np.where(rng.random((9, 9)) < 0.8, rng.normal(0.3, 1e-3, (9, 9)), np.nan)
    write_treated(tmp_path, lambda config: depth(z_m), NarrowbandConfig(), depth(z_m))
    found, reach = read_treated(tmp_path), WINDOW_PX // 2
    np.testing.assert_allclose(found["none"].z_m, z_m, rtol=1e-7)  # float32 on the disk
    for y, x in np.argwhere(np.isfinite(z_m)):
        near = z_m[max(y - reach, 0) : y + reach + 1, max(x - reach, 0) : x + reach + 1]
        assert found["window"].z_m[y, x] == pytest.approx(np.nanmean(near), rel=1e-7)
    assert np.isnan(found["window"].z_m[np.isnan(z_m)]).all()


@pytest.mark.parametrize(
    "settings", [AlignedConfig(threshold_db=-12), ThreeToneConfig(threshold_db=-12)]
)
def test_every_treatment_keeps_the_tolerance(settings, tmp_path):
    """As its own map's images are made, so are those of the others; 3-FSK's own one is one of
    them."""
    asked = []

    def image(config) -> DepthMap:
        asked.append(config)
        return depth(np.full((9, 9), 0.3))

    write_treated(tmp_path, image, settings, depth(np.zeros((9, 9))))
    seen = {(c.fine_filter_px, c.threshold_db) for c in asked}
    own = {(WINDOW_PX, -12)} if isinstance(settings, ThreeToneConfig) else set()
    assert seen == {(p, db) for p in (1, WINDOW_PX) for db in (-12, OPEN_DB)} - own
    assert not any(getattr(c, "drop_doubtful", False) for c in asked)
    assert {c.tolerance for c in asked} == {settings.tolerance}


def test_the_completed_reference_is_the_truth_where_there_is_no_mesh():
    mesh_m, truth_m = np.array([[0.3, np.nan, np.nan]]), np.array([[0.31, 0.32, np.nan]])
    leverage = np.where(np.isfinite(mesh_m)[..., None], 1.0, np.nan) * np.ones(6)
    mesh = Reference(
        mesh_m,
        np.where(np.isfinite(mesh_m), 1e-4, np.nan),
        leverage,
        identity("radar"),
        truth_m > 1,
    )
    truth = Reference(
        truth_m,
        np.where(np.isfinite(truth_m), 0.0, np.nan),
        leverage,
        identity("radar"),
        truth_m > 0,
    )
    both = completed_by(mesh, truth)
    np.testing.assert_array_equal(both.z_m, [[0.3, 0.32, np.nan]])
    np.testing.assert_array_equal(both.mesh_sigma_m, [[1e-4, 0, np.nan]])
    np.testing.assert_array_equal(both.leverage[0, :, 0], [1, 0, 0])
    assert both.met[0, 1] and not both.met[0, 2]


@pytest.mark.parametrize(
    ("seconds", "expected"),
    [
        ([1.0] * 5, False),  # of five, even the extremes miss the median in 6 %
        ([1.0] * 6, True),
        ([1.0, 1.0, 1.0, 1.0, 1.0, 1.2], False),
        ([1.0, 1.04, 1.0, 1.02, 1.06, 1.08], True),
        ([1.0] * 9 + [9.0], True),  # an outlier moves no median
        ([1.0] * 8 + [9.0] * 2, False),
    ],
)
def test_a_median_has_settled_when_its_interval_is_narrow(seconds, expected):
    assert settled(seconds) is expected


@pytest.mark.parametrize(
    ("each_s", "more"), [([0.01, 0.01], 3), ([0.01, 0.02], 33), ([0.3, 0.3], 1), ([0.6, 0.6], 0)]
)
def test_times_are_repeated_until_they_settle_or_half_a_second_has_gone(each_s, more, monkeypatch):
    """On a clock that images alone move, of which the frames take these times in turns: three equal
    times settle with three more; two that differ by a factor of two do not, and 33 of 10 and 20 ms
    fill half a second."""
    clock = SimpleNamespace(now=0.0, perf_counter=lambda: clock.now)
    monkeypatch.setattr(reconstruct_stage, "time", clock)

    def image(frame):
        clock.now += each_s[frame]

    imager = SimpleNamespace(frames=2, task=SimpleNamespace(image=image))
    found = reconstruct_stage.Imager.until_settled(imager, [each_s[0], each_s[1], each_s[0]])
    assert len(found) == 3 + more


def test_a_run_tells_equal_treatment_frames_and_enough_times(
    small_bench: Path, tmp_path: Path, monkeypatch
):
    """The times are those of the frames but the first, whose image plans, and what was repeated
    until they settled."""
    monkeypatch.setattr(
        reconstruct_stage.Imager, "until_settled", lambda imager, seconds: [*seconds, 7.0]
    )
    small_bench.write_text(
        small_bench.read_text().replace("repeats = 3", "repeats = 3\nframes = 4")
    )
    bench, base = load_benchmark(str(small_bench))
    result = run(bench, base, tmp_path / "out")
    spread = result.row("frames_max_deviation_mm", "2fsk", "truth").value
    first, largest = (
        result.row(key, "2fsk", "truth").value for key in ("max_mm", "frames_largest_mm")
    )
    assert spread > 0 and largest >= first
    equal = result.equal.set_index(["metric", "treatment", "method"]).value
    assert set(result.equal.reference) == {"truth"}
    assert (
        equal["common_percent", "none", "2fsk"] == equal["common_percent", "none", "narrowband"] > 0
    )
    assert equal["mae_mm", "window", "2fsk"] > 0
    assert set(result.comparisons.treatment) == {"", "none", "window"}
    assert set(result.comparisons[result.comparisons.treatment != ""].metric) == {
        "mae_mm",
        "aurc_mm",
    }
    assert "mae_mm" not in set(result.comparisons[result.comparisons.treatment == ""].metric)
    of_reference = result.scores[(result.scores.reference == "truth") & (result.scores.frame == 0)]
    each = of_reference.set_index(["metric", "treatment", "method", "capture"]).value
    assert each["mae_mm", "", "2fsk", "ball"] == result.row("mae_mm", "2fsk", "truth").value
    assert (
        each["mae_mm", "none", "2fsk", "ball"] == equal["mae_mm", "none", "2fsk"]
    )  # the mean of one capture
    assert (
        set(result.curves.method) == {"2fsk", "narrowband"} and (result.curves.risk_mm >= 0).all()
    )
    [timing] = (tmp_path / "out" / "work").glob("reconstruct-ball-2fsk-*/timing.json")
    seconds = json.loads(timing.read_text())["seconds"]
    assert len(seconds) == 4 and seconds[-1] == 7.0 != max(seconds[:3])


def test_a_table_of_equal_figures_is_made_by_hand_too(small_bench: Path, tmp_path: Path):
    """The error on common pixels, from the files of the result folder and of its stages alone."""
    bench, base = load_benchmark(str(small_bench))
    result = run(bench, base, tmp_path / "out")
    folders = {
        m: next((tmp_path / "out" / "work").glob(f"reconstruct-ball-{m}-*"))
        for m in ("2fsk", "narrowband")
    }
    maps = {
        m: np.load(folder / "treated.npz")["none_z_m"].astype(float)
        for m, folder in folders.items()
    }
    truth_m = np.load(results.depth_path(tmp_path / "out", "ball", "truth"))["z_m"]
    both = np.isfinite(truth_m) & np.isfinite(maps["2fsk"]) & np.isfinite(maps["narrowband"])
    equal = result.equal[
        (result.equal.metric == "mae_mm") & (result.equal.treatment == "none")
    ].set_index("method")
    for m, z_m in maps.items():
        assert equal.value[m] == pytest.approx(1e3 * np.abs(z_m - truth_m)[both].mean(), rel=1e-9)

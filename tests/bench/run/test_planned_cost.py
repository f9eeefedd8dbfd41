"""The predicted cost of a run by what it counts; what is refused, before anything is made of it."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from handbench.bench.datasets.dataset import open_capture
from handbench.bench.datasets.native import ECHOES, TRUTH, save_capture_file
from handbench.bench.pipeline.image import require_near
from handbench.bench.run import planned_cost
from handbench.bench.run.benchmark_file import load_benchmark
from handbench.bench.run.runner import run
from handbench.cli.main import main
from handbench.groundtruth.options import BASE_BYTES, DEPTHS_S, FEATURES_S, PAIR_S
from handbench.groundtruth.options import predict_effort as predicted_of_photographs
from handbench.radar.data.arrays import AntennaArray
from handbench.radar.data.echoes_file import load_capture, save_capture
from handbench.radar.methods.registry import method
from handbench.support.cost import TERMS_PER_S
from handbench.support.errors import HandbenchError


def predicted(bench_file: Path) -> planned_cost.Work:
    return planned_cost.of_run(*load_benchmark(str(bench_file)))


def test_a_run_prints_its_prediction(small_bench, tmp_path, capsys):
    run(*load_benchmark(str(small_bench)), tmp_path / "out")
    assert "GB (1 captures × 2 methods)" in capsys.readouterr().err


def test_an_image_counts_its_samples_pixels_and_voxels():
    """Planes count pixels × tones, volumes voxels, both their samples: two tones of 2-FSK, 128 of
    broadband."""
    planes, volume = (method(id).configure({}, "test") for id in ("2fsk", "broadband"))
    samples, pixels, voxels = 100.0, 301**2, np.prod(volume.grid().shape)
    scored_s = planned_cost.STAGE_S + planned_cost.SCORED_S * pixels
    of_planes_s = planned_cost.SAMPLE_S * 2 * samples + planned_cost.PIXEL_S * 2 * pixels
    of_volume_s = planned_cost.SAMPLE_S * 128 * samples + planned_cost.VOXEL_S * voxels
    assert planned_cost.imaging(planes, channels=samples).core_s == pytest.approx(
        scored_s + of_planes_s
    )
    assert planned_cost.imaging(volume, channels=samples).core_s == pytest.approx(
        scored_s + of_volume_s
    )
    assert planned_cost.imaging(volume, channels=samples).bytes_ == pytest.approx(
        BASE_BYTES + planned_cost.VOXEL_BYTES * voxels + planned_cost.SAMPLE_BYTES * 128 * samples
    )


def test_an_embedded_benchmark_grows_with_its_captures():
    bench, base = load_benchmark("hands")
    half = bench.model_copy(update={"capture": bench.capture[:6]})
    whole_s, half_s = (planned_cost.of_run(asked, base).core_s for asked in (bench, half))
    assert whole_s == pytest.approx(2 * half_s)


def test_a_sweep_counts_every_setting_on_every_capture():
    bench, base = load_benchmark("hands")
    chosen = planned_cost.ImagingSetting("a", "a", "2fsk", {}, 1, {})
    none, one, both = (
        planned_cost.of_sweep(bench, base, [chosen] * count, 3).core_s for count in (0, 1, 2)
    )
    assert both - one == pytest.approx(one - none)
    config = method("2fsk").configure({}, "test")
    assert one - none == pytest.approx(12 * planned_cost.imaging(config, frames=3).core_s)


def test_an_exact_sum_has_all_its_terms():
    """Pixels × tones × channels, twice, at the rate of the exact sum."""
    exact, fast = (method("2fsk").configure({"tolerance": each}, "test") for each in (None, 1e-5))
    more_s = (
        planned_cost.imaging(exact, channels=1e6).core_s
        - planned_cost.imaging(fast, channels=1e6).core_s
    )
    assert more_s == pytest.approx(2 * 301**2 * 2 * 1e6 / TERMS_PER_S)


def test_more_than_the_limit_is_refused_before_the_folder_is_made(
    small_bench, tmp_path, monkeypatch, capsys
):
    monkeypatch.setenv("HANDBENCH_HOURS", "1e-6")
    assert main(["run", str(small_bench), "-o", str(tmp_path / "out")]) == 2
    assert "1 captures × 2 methods: would take about" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("surface", [True, False])
def test_inspecting_counts_a_search_for_the_focus_where_there_is_no_surface(
    small_bench, tmp_path, surface
):
    capture = tmp_path / "capture"
    assert main(["simulate", str(small_bench.parent / "ball.toml"), "-o", str(capture)]) == 0
    if not surface:
        save_capture_file(
            capture, open_capture(capture).about.model_copy(update={"contains": (ECHOES,)})
        )
        (capture / TRUTH).unlink()
    expected_s = planned_cost.FITTED_S if surface else planned_cost.FOCUSED_S
    assert planned_cost.inspecting(capture) == expected_s
    assert planned_cost.inspecting(None) == planned_cost.FITTED_S


def test_what_cannot_be_opened_counts_nothing_and_is_told_by_the_run(small_bench, tmp_path):
    lost = small_bench.with_name("lost.toml")
    lost.write_text(small_bench.read_text().replace('scene = "ball.toml"', 'path = "nowhere"'))
    assert predicted(lost).core_s == 0


@pytest.mark.parametrize("command", ["run", "reconstruct"])
def test_antennas_in_millimetres_are_refused_before_they_are_imaged(
    small_bench, tmp_path, monkeypatch, capsys, command
):
    folder = small_bench.parent
    assert main(["simulate", str(folder / "ball.toml"), "-o", str(folder / "mm")]) == 0
    kept = load_capture(folder / "mm" / "echoes.h5")
    array = AntennaArray(*(1e3 * leg.position_m for leg in kept.aperture.legs))
    save_capture(folder / "mm" / "echoes.h5", replace(kept, aperture=array))
    bench = folder / "mm.toml"
    bench.write_text(small_bench.read_text().replace('scene = "ball.toml"', 'path = "mm"'))
    asked = [str(bench)] if command == "run" else [str(folder / "mm"), "--method", "2fsk"]
    out = tmp_path / ("out" if command == "run" else "out.npz")
    assert main([command, *asked, "-o", str(out)]) == 2
    assert "are its positions millimetres? multiply them by 1e-3" in capsys.readouterr().err
    assert not list(tmp_path.rglob("*.npz"))
    with pytest.raises(HandbenchError, match="expected 10 m at most"):
        require_near(load_capture(folder / "mm" / "echoes.h5"))
    assert require_near(kept) is kept
    monkeypatch.setenv("HANDBENCH_FARTHEST_M", "100")
    require_near(load_capture(folder / "mm" / "echoes.h5"))


def test_photographs_count_themselves_their_pairs_and_their_pixels():
    """The second difference over the number of photographs is one pair's cost."""
    one, two, three = (predicted_of_photographs(count, 8.0, "draft")[0] for count in (1, 2, 3))
    assert three - 2 * two + one == pytest.approx(PAIR_S)
    small, large = (predicted_of_photographs(2, megapixels, "high")[0] for megapixels in (8.0, 9.0))
    assert large - small == pytest.approx(FEATURES_S + DEPTHS_S["high"])

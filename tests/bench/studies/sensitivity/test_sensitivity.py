"""What a sensitivity study makes of its factors: checks by closed forms and by hand, on a sphere of
few pixels."""

from __future__ import annotations

import json
import os
import tomllib
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from handbench.bench.run.benchmark_file import load_benchmark
from handbench.groundtruth.mesh.mesh_files import load_open3d
from handbench.radar.data.arrays import SPEED_OF_LIGHT_M_S
from handbench.radar.methods.fsk_config import ThreeToneConfig
from handbench.support.config import parse
from handbench.support.errors import HandbenchError
from tests.bench.studies.sensitivity import measure_sensitivity, placement
from tests.bench.studies.sensitivity.measurement import Measurement
from tests.bench.studies.sensitivity.placement import relief_m, smooth_field
from tests.bench.studies.sensitivity.sensitivity_cases import BASE, Case
from tests.bench.studies.sensitivity.sensitivity_factors import FactorsFile

METHOD = """
[[method]]
id = "3fsk"
precision = true
config = { x = AXIS, y = AXIS, coarse_filter_px = 1, fine_filter_px = 1 }
""".replace("AXIS", "{ start_m = -0.02, stop_m = 0.02, step_m = 0.002 }")
FACTORS = """
frames = 2
settings = 6
placements = 2
[factor]
f3_phase_rad = [-0.1, 0.1]
filters_px = [1, 3]
distance_m = [-0.005, 0.005]
"""
FAMILIES = ("2fsk", "3fsk", "narrowband")


@pytest.fixture
def bench_file(small_bench: Path) -> Path:
    small_bench.write_text(small_bench.read_text() + METHOD)
    return small_bench


def measurement_of(bench_file, tmp_path, **changed):
    """The measurement of a benchmark, some of whose entries are changed."""
    bench, base = load_benchmark(str(bench_file))
    factors_file = parse(FactorsFile, tomllib.loads(FACTORS), "factors")
    return Measurement(
        bench.model_copy(update=changed), base.resolve(), factors_file, tmp_path / "work"
    )


def run(monkeypatch, *words):
    """The script, from its command line to its files."""
    monkeypatch.setattr("sys.argv", ["measure_sensitivity", *map(str, words)])
    measure_sensitivity.main()


@pytest.fixture
def measured(bench_file, tmp_path):
    """The measurement, and its error maps and depths of the strongest scatterer under some values,
    without noise."""
    measurement = measurement_of(bench_file, tmp_path)

    def found(**values):
        case = Case(0, "tested", {"phase_noise_rad": 0.0, **values})
        [of_hand] = measurement.found(case)
        return of_hand

    return found


def change_mm(one, other):
    """Mean change of the errors along z by method, on pixels that both observe."""
    return {
        f: 1e3 * float(np.nanmean(other.maps[f, 0].error_m - one.maps[f, 0].error_m))
        for f in FAMILIES
    }


def test_a_phase_at_f3_shifts_3fsk_and_narrowband_alone(measured):
    """z = z_e − cφ/(4π(f_b − f_a)): f3 is f_a of both steps, from f1 and from f2."""
    phase_rad, tones = 0.1, ThreeToneConfig()
    steps_hz = np.array([tones.f1_hz, tones.f2_hz]) - tones.f3_hz
    shift_mm = 1e3 * float(np.mean(SPEED_OF_LIGHT_M_S * phase_rad / (4 * np.pi * steps_hz)))
    found = change_mm(measured(), measured(f3_phase_rad=phase_rad))
    assert found["3fsk"] == pytest.approx(shift_mm, rel=2e-2) and found["2fsk"] == 0
    assert found["narrowband"] != 0


def test_a_phase_at_f2_shifts_2fsk(measured):
    """The strongest pixel takes cφ/(4πΔf), and so does z_e, which adds some percent off the
    axis."""
    shift_m = SPEED_OF_LIGHT_M_S * 0.02 / (4 * np.pi * 200e6)
    plain, turned = measured(), measured(f2_phase_rad=0.02)
    assert np.mean(turned.strongest_m["2fsk"] - plain.strongest_m["2fsk"]) == pytest.approx(
        shift_m, rel=5e-2
    )


def test_the_reference_s_error_is_that_and_nothing_else(measured):
    biased = change_mm(measured(), measured(reference_bias_m=1e-3))
    assert list(biased.values()) == pytest.approx([-1.0, -1.0, -1.0])
    erring = (
        measured(reference_error_m=1e-3).maps["2fsk", 0].error_m
        - measured().maps["2fsk", 0].error_m
    )
    assert 0.2e-3 < np.nanstd(erring) < 3e-3  # a few correlation lengths alone


def test_a_smooth_field_has_its_variance_and_correlation():
    points_m = np.random.default_rng(0).uniform(0, 1.0, (4000, 2))
    fields = np.stack([smooth_field(points_m, 0.02, seed) for seed in range(40)])
    apart = np.stack(
        [smooth_field(np.array([[0.0, 0.0], [0.02, 0.0]]), 0.02, seed) for seed in range(3000)]
    )
    assert fields.mean() == pytest.approx(0, abs=0.02) and fields.var() == pytest.approx(
        1, rel=0.02
    )
    assert np.corrcoef(apart.T)[0, 1] == pytest.approx(np.exp(-1), abs=0.05)
    assert np.array_equal(fields[0], smooth_field(points_m, 0.02, 0))


def test_a_distance_moves_depth_and_truth_alike(measured):
    plain, further = measured(), measured(distance_m=0.003)
    moved_m = np.nanmean(
        further.maps["3fsk", 0].reference_z_m - plain.maps["3fsk", 0].reference_z_m
    )
    assert moved_m == pytest.approx(3e-3, abs=1e-5)
    assert np.mean(further.strongest_m["3fsk"] - plain.strongest_m["3fsk"]) == pytest.approx(
        3e-3, abs=2e-4
    )


def test_the_box_and_the_filters_change_their_own_method(measured):
    plain = measured()
    assert {f for f, mm in change_mm(plain, measured(box_shift_m=0.001)).items() if mm} == {
        "narrowband"
    }
    assert {f for f, mm in change_mm(plain, measured(narrowband_filter_px=3)).items() if mm} == {
        "narrowband"
    }
    assert {f for f, mm in change_mm(plain, measured(filters_px=3)).items() if mm} == {"3fsk"}
    both = measured(coarse_filter_px=3, fine_filter_px=3).maps["3fsk", 0].error_m
    assert np.array_equal(both, measured(filters_px=3).maps["3fsk", 0].error_m, equal_nan=True)


@pytest.mark.parametrize("values", [{"phase_noise_rad": 0.03}, {"common_phase_rad": 0.03}])
def test_noise_of_either_kind_has_its_size_at_the_strongest_pixel(bench_file, tmp_path, values):
    """σ_z = cσ_φ/(4πΔf) over 40 repeats: within three standard deviations, 1/√(2·39) each."""
    measurement = measurement_of(bench_file, tmp_path, repeats=40)
    [found] = measurement.found(Case(0, "tested", {"phase_noise_rad": 0.0, **values}))
    expected_m = SPEED_OF_LIGHT_M_S * 0.03 / (4 * np.pi * 200e6)
    assert np.std(found.strongest_m["2fsk"], ddof=1) == pytest.approx(
        expected_m, rel=3 / np.sqrt(78)
    )


def test_antennas_err_alike_in_all_frames(measured):
    erring = measured(antenna_phase_rad=0.3, antenna_gain_db=1.0)
    assert np.ptp(erring.strongest_m["2fsk"]) < 1e-9 < abs(change_mm(measured(), erring)["2fsk"])


def test_facets_of_random_phase_are_mixed_by_their_share(bench_file, tmp_path):
    [hand] = measurement_of(bench_file, tmp_path).hands[True]
    none, half, all_of_it = (
        hand.clean({"diffuse": s}, tmp_path / "work").samples for s in (0.0, 0.5, 1.0)
    )
    assert np.allclose(half, (none + all_of_it) / 2, atol=1e-6 * np.abs(none).max())
    assert np.abs(np.vdot(none, all_of_it)) < 0.5 * np.linalg.norm(none) * np.linalg.norm(all_of_it)


def test_layers_are_steps_across_the_print():
    """Of a sphere: nothing at its equator, ±½ layer towards its poles; roughness has its σ."""
    sphere = load_open3d().geometry.TriangleMesh.create_sphere(0.03, resolution=60)
    vertices_m, faces = np.asarray(sphere.vertices), np.asarray(sphere.triangles)
    layers_m = np.linalg.norm(relief_m(vertices_m, faces, {"layer_m": 1e-3}, 2e-3, 1), axis=1)
    across = np.abs(vertices_m[:, 1]) / 0.03
    assert np.all(layers_m <= 0.5e-3 * across + 5e-6) and layers_m[across > 0.9].max() > 0.3e-3
    rough_m = np.linalg.norm(relief_m(vertices_m, faces, {"roughness_m": 1e-4}, 2e-3, 1), axis=1)
    assert np.sqrt(np.mean(rough_m**2)) == pytest.approx(1e-4, rel=0.1)


def test_the_script_measures_both_parts(bench_file, tmp_path, monkeypatch, capsys):
    out = tmp_path / "out"
    factors = tmp_path / "factors.toml"
    factors.write_text(FACTORS)
    run(monkeypatch, bench_file, "--factors", factors, "-o", out)
    one, both = (pd.read_csv(out / f"{name}.csv") for name in ("one_at_a_time", "joint"))
    assert (
        list(one.name[:2]) == [BASE, "without the study's economies"]
        and len(one) == 8
        and len(both) == 6
    )
    assert one["2fsk_mae_mm"][one.factor == "filters_px"].nunique() == 1  # 2-FSK has no filter
    assert both.distance.is_monotonic_increasing and set(both.placement) == {0, 1}
    assert {f"{f}_{k}" for f in FAMILIES for k in ("mae_mm", "max_mm")} <= set(
        one.dropna(axis=1).columns
    )
    for name in ("one_at_a_time", "joint"):
        assert {file.suffix for file in out.glob(f"{name}.*")} == {
            ".csv",
            ".json",
            ".md",
            ".png",
            ".pdf",
        }
        assert json.loads((out / f"{name}.json").read_text())["failures"] == {}
    said = capsys.readouterr().out
    assert "6 settings were tried." in said and "no finding" in said and "the paper" in said
    kept = sorted(folder.name for folder in (out / "work").iterdir())
    run(monkeypatch, bench_file, "--factors", factors, "--parts", "one", "-o", out)
    assert (
        sorted(folder.name for folder in (out / "work").iterdir()) == kept
    )  # nothing is simulated twice
    again = pd.read_csv(out / "one_at_a_time.csv")
    pd.testing.assert_frame_equal(again, one)


def test_echoes_of_an_edited_mesh_are_made_again(bench_file, tmp_path):
    """One bit of a coordinate, which neither the file's size nor its times tell of."""
    [hand] = measurement_of(bench_file, tmp_path).hands[True]
    before, mesh = hand.clean({}, tmp_path / "work"), bench_file.with_name("ball.ply")
    state, data = mesh.stat(), bytearray(mesh.read_bytes())
    data[data.index(b"end_header\n") + 11 + 8 * 3 * 40 + 5] ^= 1 << 3
    mesh.write_bytes(data)
    os.utime(mesh, ns=(state.st_atime_ns, state.st_mtime_ns))
    placement._built.cache_clear()  # as in the next run
    again = hand.clean({}, tmp_path / "work")
    assert len(list((tmp_path / "work").glob("echoes-*"))) == 2
    assert not np.array_equal(again.surface.vertices, before.surface.vertices)


def test_a_benchmark_without_scenes_is_refused(bench_file, tmp_path):
    [source] = load_benchmark(str(bench_file))[0].capture
    elsewhere = source.model_copy(update={"scene": None, "path": "captures/ball"})
    with pytest.raises(HandbenchError, match="simulates no scene"):
        measurement_of(bench_file, tmp_path, capture=(elsewhere,))
    with pytest.raises(HandbenchError, match="none of the paper's methods"):
        measurement_of(bench_file, tmp_path, method=())


def test_a_wrong_file_of_factors_ends_the_script_in_one_line(
    bench_file, tmp_path, monkeypatch, capsys
):
    factors = tmp_path / "factors.toml"
    factors.write_text("setings = 3\n")
    with pytest.raises(SystemExit) as ended:
        run(monkeypatch, bench_file, "--factors", factors, "-o", tmp_path / "out")
    said = capsys.readouterr().err
    assert (
        ended.value.code == 2
        and said.count("\n") == 1
        and "unknown key 'setings'; did you mean 'settings'" in said
    )

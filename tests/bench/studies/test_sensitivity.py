"""What a sensitivity study makes of its factors: checks by closed forms and by hand, on a sphere of few pixels."""

from __future__ import annotations

import json
import re
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from bench.cli.main import main
from bench.run.benchmark_file import load_benchmark
from bench.run.sensitivity_table import SIMULATED, Factors, SensitivityTable, completed, default
from bench.studies.sensitivity.cases import BASE, Case, filled, joint, one_at_a_time, told
from bench.studies.sensitivity.configured import sparser
from bench.studies.sensitivity.measure import Measurement
from bench.studies.sensitivity.nearness import PAPER, agreeing, answer, distance, factor_records
from bench.studies.sensitivity.placement import relief_m, smooth_field
from groundtruth.mesh.mesh_files import load_open3d
from radar.data.arrays import SPEED_OF_LIGHT_M_S
from radar.methods.fsk_config import ThreeToneConfig
from radar.methods.projection import BroadbandConfig
from radar.support.config import parse
from radar.support.errors import HandbenchError

METHOD = """
[[method]]
id = "3fsk"
precision = true
config = { x = AXIS, y = AXIS, coarse_filter_px = 1, fine_filter_px = 1 }
""".replace("AXIS", "{ start_m = -0.02, stop_m = 0.02, step_m = 0.002 }")
TABLE = """
[sensitivity]
frames = 2
settings = 6
placements = 2
[sensitivity.factor]
f3_phase_rad = [-0.1, 0.1]
filters_px = [1, 3]
distance_m = [-0.005, 0.005]
"""
FAMILIES = ("2fsk", "3fsk", "narrowband")


@pytest.fixture
def bench_file(small_bench: Path) -> Path:
    small_bench.write_text(small_bench.read_text() + METHOD + TABLE)
    return small_bench


@pytest.fixture
def measured(bench_file, tmp_path):
    """The measurement, and its error maps and depths of the strongest scatterer under some values, without noise."""
    measurement = Measurement(*load_benchmark(str(bench_file)), tmp_path / "work")

    def found(**values):
        case = Case(0, "tested", {"phase_noise_rad": 0.0, **values})
        [of_hand] = measurement.found(case)
        return of_hand

    return found


def change_mm(one, other):
    """Mean change of the errors along z by method, on pixels that both observe."""
    return {f: 1e3 * float(np.nanmean(other.maps[f, 0].error_m - one.maps[f, 0].error_m)) for f in FAMILIES}


def test_the_paper_s_own_figures_are_at_no_distance():
    """Its ten figures as OUTSIDE sources print them, typed once more."""
    assert sorted(PAPER.values()) == sorted([6.6, 1.7, 1.0, 13.4, 39.2, 28.8, 32.0, 64.9, 3.6, 0.3])
    assert distance(PAPER) == 0 and agreeing(PAPER, 0.1) == len(PAPER) == 10
    off = {name: 1.1 * value for name, value in PAPER.items()}
    assert distance(off) == pytest.approx(np.log(1.1)) and agreeing(off, 9) == 0 and agreeing(off, 11) == 10
    assert np.isnan(distance({**PAPER, "3fsk_mae_mm": None})) and np.isnan(distance({}))


def test_a_phase_at_f3_shifts_3fsk_and_narrowband_alone(measured):
    """z = z_e − cφ/(4π(f_b − f_a)): f3 is f_a of both steps, from f1 and from f2."""
    phase_rad, tones = 0.1, ThreeToneConfig()
    steps_hz = np.array([tones.f1_hz, tones.f2_hz]) - tones.f3_hz
    shift_mm = 1e3 * float(np.mean(SPEED_OF_LIGHT_M_S * phase_rad / (4 * np.pi * steps_hz)))
    found = change_mm(measured(), measured(f3_phase_rad=phase_rad))
    assert found["3fsk"] == pytest.approx(shift_mm, rel=2e-2) and found["2fsk"] == 0
    assert found["narrowband"] != 0


def test_a_phase_at_f2_shifts_2fsk(measured):
    """The strongest pixel takes cφ/(4πΔf), and so does z_e, which adds some percent off the axis."""
    shift_m = SPEED_OF_LIGHT_M_S * 0.02 / (4 * np.pi * 200e6)
    plain, turned = measured(), measured(f2_phase_rad=0.02)
    assert np.mean(turned.strongest_m["2fsk"] - plain.strongest_m["2fsk"]) == pytest.approx(shift_m, rel=5e-2)


def test_the_reference_s_error_is_that_and_nothing_else(measured):
    biased = change_mm(measured(), measured(reference_bias_m=1e-3))
    assert list(biased.values()) == pytest.approx([-1.0, -1.0, -1.0])
    erring = measured(reference_error_m=1e-3).maps["2fsk", 0].error_m - measured().maps["2fsk", 0].error_m
    assert 0.2e-3 < np.nanstd(erring) < 3e-3  # a few correlation lengths alone


def test_a_smooth_field_has_its_variance_and_correlation():
    points_m = np.random.default_rng(0).uniform(0, 1.0, (4000, 2))
    fields = np.stack([smooth_field(points_m, 0.02, seed) for seed in range(40)])
    apart = np.stack([smooth_field(np.array([[0.0, 0.0], [0.02, 0.0]]), 0.02, seed) for seed in range(3000)])
    assert fields.mean() == pytest.approx(0, abs=0.02) and fields.var() == pytest.approx(1, rel=0.02)
    assert np.corrcoef(apart.T)[0, 1] == pytest.approx(np.exp(-1), abs=0.05)
    assert np.array_equal(fields[0], smooth_field(points_m, 0.02, 0))


def test_a_distance_moves_depth_and_truth_alike(measured):
    plain, further = measured(), measured(distance_m=0.003)
    moved_m = np.nanmean(further.maps["3fsk", 0].reference_z_m - plain.maps["3fsk", 0].reference_z_m)
    assert moved_m == pytest.approx(3e-3, abs=1e-5)
    assert np.mean(further.strongest_m["3fsk"] - plain.strongest_m["3fsk"]) == pytest.approx(3e-3, abs=2e-4)


def test_the_box_and_the_filters_change_their_own_method(measured):
    plain = measured()
    assert {f for f, mm in change_mm(plain, measured(box_shift_m=0.001)).items() if mm} == {"narrowband"}
    assert {f for f, mm in change_mm(plain, measured(narrowband_filter_px=3)).items() if mm} == {"narrowband"}
    assert {f for f, mm in change_mm(plain, measured(filters_px=3)).items() if mm} == {"3fsk"}
    both = measured(coarse_filter_px=3, fine_filter_px=3).maps["3fsk", 0].error_m
    assert np.array_equal(both, measured(filters_px=3).maps["3fsk", 0].error_m, equal_nan=True)


@pytest.mark.parametrize("values", [{"phase_noise_rad": 0.03}, {"common_phase_rad": 0.03}])
def test_noise_of_either_kind_has_its_size_at_the_strongest_pixel(bench_file, tmp_path, values):
    """σ_z = cσ_φ/(4πΔf) over 40 repeats: within three standard deviations, 1/√(2·39) each."""
    bench, base = load_benchmark(str(bench_file))
    measurement = Measurement(bench.model_copy(update={"repeats": 40}), base, tmp_path / "work")
    [found] = measurement.found(Case(0, "tested", {"phase_noise_rad": 0.0, **values}))
    expected_m = SPEED_OF_LIGHT_M_S * 0.03 / (4 * np.pi * 200e6)
    assert np.std(found.strongest_m["2fsk"], ddof=1) == pytest.approx(expected_m, rel=3 / np.sqrt(78))


def test_antennas_err_alike_in_all_frames(measured):
    erring = measured(antenna_phase_rad=0.3, antenna_gain_db=1.0)
    assert np.ptp(erring.strongest_m["2fsk"]) < 1e-9 < abs(change_mm(measured(), erring)["2fsk"])


def test_facets_of_random_phase_are_mixed_by_their_share(measured, bench_file, tmp_path):
    measurement = Measurement(*load_benchmark(str(bench_file)), tmp_path / "work")
    [hand] = measurement.hands[True]
    none, half, all_of_it = (hand.clean({"diffuse": s}, tmp_path / "work").samples for s in (0.0, 0.5, 1.0))
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


def test_fewer_tones_keep_the_resolution():
    whole = BroadbandConfig()
    few = whole.model_copy(update=sparser(whole, 32))
    cells = [c.count * np.diff(c.tones_hz())[0] for c in (whole, few)]
    assert cells[0] == pytest.approx(cells[1]) and few.tones_hz().mean() == pytest.approx(whole.tones_hz().mean())


def test_the_joint_design_fills_its_ranges():
    factors = {"tilt_x_deg": (-10.0, 10.0), "filters_px": (1, 5, 9), "material": ("skin", "metal")}
    points = pd.DataFrame(filled(factors, 30, seed=4))
    parts = np.floor((points.tilt_x_deg + 10) / 20 * 30)
    assert sorted(parts) == list(range(30))  # one in each
    assert points.filters_px.value_counts().to_dict() == {1: 10, 5: 10, 9: 10}
    assert points.material.value_counts().to_dict() == {"skin": 15, "metal": 15}
    assert points.equals(pd.DataFrame(filled(factors, 30, seed=4)))


def test_the_cases_change_what_they_say():
    table = default()
    alone, together = one_at_a_time(table), joint(table)
    assert [case.values for case in alone[:2]] == [{}, {}] and not alone[1].economies
    assert [c.values for c in alone if "tilt_x_deg" in c.values] == [{"tilt_x_deg": -10.0}, {"tilt_x_deg": 10.0}]
    assert all(len(case.values) == 1 for case in alone[2:]) and len({case.name for case in alone}) == len(alone)
    assert len(together) == table.settings and len({case.number for case in together}) == table.settings
    places = {json.dumps({n: v for n, v in c.values.items() if n in SIMULATED}) for c in together}
    assert len(places) == table.placements == len({case.placement for case in together})
    assert all(not set(table.apart) & set(case.values) for case in together)
    assert told("distance_m", -0.015) == "distance -15 mm" and told("material", "metal") == "material metal"


def test_the_default_names_every_factor():
    assert list(default().factor.listed()) and not set(Factors.model_fields) - set(default().factor.listed())
    assert completed(None) is default()
    own = SensitivityTable(settings=7)
    assert completed(own).settings == 7 and completed(own).factor == default().factor
    assert completed(SensitivityTable(factor=Factors(height_m=(0.01,)))).factor.listed() == {"height_m": (0.01,)}


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"factor": {"tilt_x_degree": [1.0]}}, "unknown key 'factor.tilt_x_degree'; did you mean 'tilt_x_deg'"),
        ({"setings": 3}, "unknown key 'setings'; did you mean 'settings'"),
        ({"apart": ["filter_px"]}, "'apart' is ['filter_px']; unknown factor 'filter_px'; did you mean"),
        ({"factor": {"filters_px": [4]}}, "'factor.filters_px.0' is 4; expected an odd number"),
        ({"factor": {"material": ["wood"]}}, "'factor.material.0' is 'wood'; input should be 'skin'"),
        ({"factor": {"height_m": [0.1, 0.1]}}, "'factor' is {'height_m': [0.1, 0.1]}; 'height_m' lists a value twice"),
        ({"factor": {"diffuse": [1.5]}}, "'factor.diffuse.0' is 1.5"),
    ],
)
def test_what_is_wrong_with_a_table_is_said(values, message):
    with pytest.raises(HandbenchError, match=re.escape(f"s.toml: {message}")):
        parse(SensitivityTable, values, "s.toml")


def test_what_matters_is_found_and_what_does_not_is_not():
    """Of forty settings the distance follows one factor, by its middle; the other is noise."""
    random = np.random.default_rng(2)
    settings = pd.DataFrame({"a_m": random.uniform(-1, 1, 40), "b_m": random.uniform(-1, 1, 40)})
    settings = settings.assign(name="s", placement=0, agree=5, turned=False, distance=settings.a_m**2)
    settings = settings.sort_values("distance", ignore_index=True)
    ranges = {"a_m": (-1.0, 1.0), "b_m": (-1.0, 1.0)}
    found = factor_records(settings, ranges, settings.head(5))
    assert [record["factor"] for record in found] == ["a_m", "b_m"]
    assert found[0]["p"] < 1e-4 < 0.05 < found[1]["p"]
    words = answer(settings, 41, found, [], SensitivityTable())
    assert "41 settings were tried, 1 of which failed" in words and "possibility and no finding" in words
    assert "ties down: a (" in words and "Not shown to matter for the distance: b." in words
    assert "in 0 of 40 settings" in words


def test_placements_count_once():
    """Twelve settings on three placements have three values of a simulated factor."""
    settings = pd.DataFrame({"distance_m": [0.0, 0.5, 1.0] * 4, "placement": [0, 1, 2] * 4, "distance": range(12)})
    [record] = factor_records(settings, {"distance_m": (0.0, 1.0)}, settings.head(3))
    assert record["units"] == 3


def test_the_command_measures_both_parts(bench_file, tmp_path, capsys):
    out = tmp_path / "out"
    assert main(["sensitivity", str(bench_file), "-o", str(out)]) == 0
    one, both = (pd.read_csv(out / f"{name}.csv") for name in ("one_at_a_time", "joint"))
    assert list(one.name[:2]) == [BASE, "without the study's economies"] and len(one) == 8 and len(both) == 6
    assert one["2fsk_mae_mm"][one.factor == "filters_px"].nunique() == 1  # 2-FSK has no filter
    assert both.distance.is_monotonic_increasing and set(both.placement) == {0, 1}
    assert {f"{f}_{k}" for f in FAMILIES for k in ("mae_mm", "max_mm")} <= set(one.dropna(axis=1).columns)
    for name in ("one_at_a_time", "joint"):
        assert {file.suffix for file in out.glob(f"{name}.*")} == {".csv", ".json", ".md", ".png", ".pdf"}
        assert json.loads((out / f"{name}.json").read_text())["failures"] == {}
    said = capsys.readouterr().out
    assert "6 settings were tried." in said and "no finding" in said and "the paper" in said
    kept = sorted(folder.name for folder in (out / "work").iterdir())
    assert main(["sensitivity", str(bench_file), "-o", str(out), "--parts", "one"]) == 0
    assert sorted(folder.name for folder in (out / "work").iterdir()) == kept  # nothing is simulated twice
    again = pd.read_csv(out / "one_at_a_time.csv")
    pd.testing.assert_frame_equal(again, one)


def test_a_benchmark_without_scenes_is_refused(bench_file, tmp_path):
    bench, base = load_benchmark(str(bench_file))
    [source] = bench.capture
    elsewhere = source.model_copy(update={"scene": None, "path": "captures/ball"})
    recorded = bench.model_copy(update={"capture": (elsewhere,)})
    with pytest.raises(HandbenchError, match="simulates no scene"):
        Measurement(recorded, base, tmp_path)
    with pytest.raises(HandbenchError, match="none of the paper's methods"):
        Measurement(bench.model_copy(update={"method": ()}), base, tmp_path)

"""The study of trust: fits and figures against numbers that are known, and the truth of a mesh by
hand."""

import tomllib

import numpy as np
import pandas as pd
import pytest

from handbench.bench.scenes.shapes import plate_mesh
from handbench.radar.data.depthmap import DepthMap
from handbench.radar.methods.depth_uncertainty import FEATURES, probability
from tests.bench.studies.trust import measure_trust
from tests.bench.studies.trust.measure_trust import as_toml, figures
from tests.bench.studies.trust.trust_cases import BESIDE_M, off_mesh
from tests.bench.studies.trust.worth import (
    BINS,
    DROPPED_PERCENT,
    fitted,
    reliability,
    silent_percent,
)


def drawn(count=40_000, seed=1):
    """Features, and wrong pixels of a logistic function that is known."""
    rng, weights = np.random.default_rng(seed), np.array([-2.0, 1.5, -0.7, 0.0])
    found = rng.normal(0.3, [1, 2, 0.5], (count, 3))
    return found, rng.random(count) < probability(found, weights), weights


def test_the_fit_finds_the_weights_that_drew():
    found, wrong, weights = drawn()
    alike = np.ones(len(found))
    assert fitted(found, wrong, alike) == pytest.approx(weights, abs=0.1)
    assert (
        fitted(np.column_stack([found, alike]), wrong, alike)[-1] == 0
    )  # a feature that never changes
    twice = np.concatenate([found, found[wrong]]), np.concatenate([wrong, wrong[wrong]])
    half = np.r_[np.where(wrong, 0.5, 1.0), np.full(wrong.sum(), 0.5)]
    assert fitted(*twice, half) == pytest.approx(fitted(found, wrong, alike), abs=0.02)


def test_a_calibrated_probability_is_reliable():
    found, wrong, weights = drawn()
    p = probability(found, weights)
    told = reliability(p, wrong)
    assert sum(count for *_, count in told) == len(p) and len(told) <= len(BINS) - 1
    for mean, share, count in told:
        assert share == pytest.approx(mean, abs=4 * np.sqrt(mean * (1 - mean) / count) + 1e-3)
    nothing = np.zeros(len(p), bool)
    told = figures([p], [wrong], [nothing], [np.where(wrong, -1, 1)])
    assert told["brier"] < wrong.mean() * (1 - wrong.mean()) and told["held_percent"] == 100


def test_risk_falls_as_the_doubted_are_dropped():
    """Ten of a hundred pixels are wrong; p orders all but one of them last."""
    wrong = np.arange(100) >= 90
    p = np.arange(100) / 100
    wrong[0], wrong[90] = True, False
    found = dict(zip(DROPPED_PERCENT, silent_percent(p, wrong), strict=True))
    assert (
        found[0] == 10
        and found[5] == pytest.approx(100 * 5 / 95)
        and found[20] == pytest.approx(100 / 80)
    )
    told = figures([p], [wrong], [wrong], [-np.ones(100)])
    assert (
        told["silent_percent"] == 1
        and told["doubted_percent"] == 99
        and told["concentrated_percent"] == 100
    )
    assert (
        told["precision_percent"] == pytest.approx(100 * 9 / 49)
        and told["old_recall_percent"] == 100
    )


def test_a_depth_between_two_surfaces_is_off_from_both():
    axis_m = np.arange(-0.02, 0.0201, 0.001)
    front = plate_mesh(0.02, 0.06, 0.001, 0.005).translate([-0.01, 0, 0.28])
    behind = plate_mesh(0.02, 0.06, 0.001, 0.005).translate([0.01, 0, 0.31])
    top_m = [float(np.asarray(one.vertices)[:, 2].min()) for one in (front, behind)]
    z_m = np.full((len(axis_m),) * 2, (top_m[0] + top_m[1]) / 2)
    z_m[:, :20] = top_m[0]
    off_m, own_m = off_mesh(front + behind)(DepthMap(axis_m, axis_m, z_m, z_m, "x"))
    assert off_m[20, 10] == pytest.approx(0, abs=1e-6)
    assert off_m[20, 20:30] == pytest.approx(0.015, abs=1e-5)
    assert own_m[20, 10] == pytest.approx(0, abs=1e-6) and own_m[20, 30] == pytest.approx(
        0.015, abs=1e-5
    )
    beside, _ = off_mesh(front)(DepthMap(axis_m, axis_m, np.full_like(z_m, top_m[0]), z_m, "x"))
    past_m = axis_m[np.isfinite(beside[20])].max()
    assert past_m == pytest.approx(BESIDE_M + 0.0025, abs=0.0015)  # and half a resolution cell


def test_the_script_runs(tmp_path, monkeypatch, capsys):
    """At the smallest size that it takes: twenty scenes of points by one method, and their
    reliability."""
    words = ["--scenes", "20", "--methods", "3fsk", "--only", "points", "-o", str(tmp_path)]
    monkeypatch.setattr("sys.argv", ["measure", *words])
    measure_trust.main()
    assert "| 3fsk" in capsys.readouterr().out
    table = pd.read_csv(tmp_path / "trust.csv")
    assert (
        table.groupby("method").scenes.sum().to_dict() == {"3fsk": 20} and (table.pixels > 0).all()
    )
    assert (tmp_path / "trust.png").is_file()


def test_the_weights_file_reads_as_it_was_written():
    weights = {"2fsk": np.arange(1 + len(FEATURES)) / 8, "any": np.zeros(1 + len(FEATURES))}
    read = tomllib.loads(as_toml(weights))
    assert list(read) == ["2fsk", "any"] and list(read["2fsk"].values()) == weights["2fsk"].tolist()

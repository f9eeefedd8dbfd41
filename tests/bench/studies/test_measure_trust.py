"""The study of trust: fits and figures against numbers that are known, and the truth of a mesh by
hand."""

import tomllib

import numpy as np
import pytest

from handbench.bench.scenes.shapes import plate_mesh
from handbench.bench.studies.trust import measure_trust as study
from handbench.bench.studies.trust.trust_cases import off_mesh
from handbench.radar.data.depthmap import DepthMap
from handbench.radar.methods.depth_uncertainty import FEATURES, probability


@pytest.fixture(scope="module")
def drawn():
    """Features, and wrong pixels of a logistic function that is known."""
    rng, weights = np.random.default_rng(1), np.array([-2.0, 1.5, -0.7, 0.0])
    found = rng.normal(0.3, [1, 2, 0.5], (40_000, 3))
    return found, rng.random(len(found)) < probability(found, weights), weights


def test_the_fit_finds_the_weights_that_drew(drawn):
    found, wrong, weights = drawn
    every = np.ones(len(found))
    assert study.fitted(found, wrong, every) == pytest.approx(weights, abs=0.1)
    constant = np.column_stack([found, every])  # a feature that never changes
    assert study.fitted(constant, wrong, every)[-1] == 0


def test_risk_falls_as_the_doubted_are_dropped():
    """Ten of a hundred pixels are wrong; p orders all but one of them last."""
    wrong, p = np.arange(100) >= 90, np.arange(100) / 100
    wrong[0], wrong[90] = True, False
    found = study.figures([p], [{"wrong": wrong, "held": -np.ones(100)}])
    assert found["left_0_percent"] == 10
    assert found["left_5_percent"] == pytest.approx(100 * 5 / 95)
    assert found["left_20_percent"] == pytest.approx(100 / 80)
    assert (found["silent_percent"], found["doubted_percent"]) == (1, 99)
    assert found["precision_percent"] == pytest.approx(100 * 9 / 49)


def test_a_depth_between_two_surfaces_is_off_from_both():
    axis_m = np.arange(-0.02, 0.0201, 0.001)
    front = plate_mesh(0.02, 0.06, 0.001, 0.005).translate([-0.01, 0, 0.28])
    behind = plate_mesh(0.02, 0.06, 0.001, 0.005).translate([0.01, 0, 0.31])
    top_m = [float(np.asarray(one.vertices)[:, 2].min()) for one in (front, behind)]
    z_m = np.full((len(axis_m),) * 2, (top_m[0] + top_m[1]) / 2)
    z_m[:, :20] = top_m[0]
    off_m, own_m = off_mesh(front + behind)(DepthMap(axis_m, axis_m, z_m, z_m, "x"))
    assert off_m[20, 10] == pytest.approx(0, abs=1e-6) == own_m[20, 10]
    assert off_m[20, 20:30] == pytest.approx(0.015, abs=1e-5)


def test_weights_are_fitted_and_written_as_they_are_read(ran, monkeypatch, tmp_path):
    """Of four kinds of surfaces, two calibrate."""
    monkeypatch.setattr(study, "WEIGHTS", tmp_path / "trust.toml")
    words = ["--scenes", "4", "--methods", "3fsk", "--only", "points", "--fit"]
    found = ran(study, *words)
    scenes = {row["group"]: row["scenes"] for row in found["rows"]}
    assert scenes == {"calibration": 2, "other surfaces": 2}
    counts = [sum(row["pixels"] for row in found[name]) for name in ("rows", "reliability")]
    assert counts[0] == counts[1]
    written = tomllib.loads((tmp_path / "trust.toml").read_text())
    assert list(written["3fsk"]) == ["constant", *FEATURES] == list(written["any"])

"""The study's frame: echoes that are kept, fronts of bodies, and a scene that is measured."""

from __future__ import annotations

import json

import numpy as np
import pytest

from handbench.radar.data.arrays import AntennaArray
from handbench.support.errors import HandbenchError
from tests.references.exact import cases as scenes
from tests.references.exact import measure_exact
from tests.references.exact.cases import SCENES, Case, cases, front_m

SMALL = Case("sphere of 2 mm", SCENES["sphere of 2 mm"], "skin", "along")


def test_echoes_are_made_once_for_the_same_tones_antennas_and_bodies(tmp_path, monkeypatch):
    array, tones_hz = AntennaArray(np.zeros((1, 3)), np.zeros((2, 3))), np.array([80e9])
    first = scenes.kept_echoes(SMALL, tones_hz, array, tmp_path)
    made = []
    monkeypatch.setattr(
        scenes, "exact_echoes", lambda *given: made.append(given) or np.zeros((1, 1, 2))
    )
    np.testing.assert_array_equal(scenes.kept_echoes(SMALL, tones_hz, array, tmp_path), first)
    assert not made
    metal = Case(SMALL.name, SMALL.bodies, "metal", "along")
    for case, tone_hz in ((SMALL, 81e9), (metal, 80e9)):
        assert not scenes.kept_echoes(case, np.array([tone_hz]), array, tmp_path).any()


def test_what_has_no_exact_solution_is_refused():
    coated_finger = Case("finger", SCENES["one finger"], "palm", "along")
    with pytest.raises(HandbenchError, match="no exact solution"):
        scenes.exact_echoes(
            coated_finger, np.array([80e9]), AntennaArray(np.zeros((1, 3)), np.zeros((1, 3)))
        )


def test_the_front_is_the_nearest_surface():
    aside = next(case for case in cases("along") if case.name == "finger before palm, 12 mm aside")
    x_m = np.array([-0.03, 0.0, 0.012, 0.0199])
    found = front_m(aside, x_m, np.array([0.0, 0.02]))
    edge_m = 0.265 - np.sqrt(8e-3**2 - 7.9e-3**2)
    np.testing.assert_allclose(found, np.tile([np.nan, 0.299, 0.257, edge_m], (2, 1)))
    assert np.isfinite(front_m(SMALL, np.array([0.0, 0.003]), np.array([0.0]))).tolist() == [
        [True, False]
    ]


def test_a_scene_is_measured(tmp_path, monkeypatch):
    monkeypatch.setattr(measure_exact, "LADDERS", (("obliquity",), ("obliquity", "shadow_centre")))
    words = ["--tones", "few", "--only", "sphere of 2 mm, skin", "-o", str(tmp_path)]
    monkeypatch.setattr("sys.argv", ["measure_exact", *words])
    measure_exact.main()
    found = json.loads((tmp_path / "exact.json").read_text())
    rows, maps = found["rows"], found["maps"]
    assert [row["effects"] for row in rows] == ["obliquity", "obliquity, shadow_centre"]
    assert all(row["3fsk_mean_mm"] < 1 and row["3fsk_lost"] == 0 for row in rows)
    assert len(maps) == 6 and not {row["method"] for row in maps} & {"broadband"}

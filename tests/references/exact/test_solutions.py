"""The study's frame: fronts of bodies, and a scene that is measured."""

from __future__ import annotations

import json

import numpy as np

from tests.references.exact import measure_exact
from tests.references.exact.cases import cases, front_m


def test_the_front_is_the_nearest_surface():
    aside = next(case for case in cases("along") if case.name == "finger before palm, 12 mm aside")
    x_m = np.array([-0.03, 0.0, 0.012, 0.0199])
    found = front_m(aside, x_m, np.array([0.0, 0.02]))
    edge_m = 0.265 - np.sqrt(8e-3**2 - 7.9e-3**2)
    np.testing.assert_allclose(found, np.tile([np.nan, 0.299, 0.257, edge_m], (2, 1)))


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

"""The factors, the settings and the answer of a sensitivity study: checks by closed forms and by
hand."""

from __future__ import annotations

import json
import re
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from handbench.bench.run.benchmark_file import EMBEDDED, load_benchmark
from handbench.radar.methods.projection_config import BroadbandConfig
from handbench.support.config import parse
from handbench.support.errors import HandbenchError
from tests.bench.studies.sensitivity.configured import paper_methods, sparser
from tests.bench.studies.sensitivity.nearness import (
    PAPER,
    agreeing,
    answer,
    distance,
    factor_records,
)
from tests.bench.studies.sensitivity.sensitivity_cases import filled, joint, one_at_a_time, told
from tests.bench.studies.sensitivity.sensitivity_factors import (
    SIMULATED,
    Factors,
    FactorsFile,
    load_factors,
)


def test_the_paper_s_own_figures_are_at_no_distance():
    """Its ten figures as OUTSIDE sources print them, typed once more."""
    assert sorted(PAPER.values()) == sorted([6.6, 1.7, 1.0, 13.4, 39.2, 28.8, 32.0, 64.9, 3.6, 0.3])
    assert distance(PAPER) == 0 and agreeing(PAPER, 0.1) == len(PAPER) == 10
    off = {name: 1.1 * value for name, value in PAPER.items()}
    assert (
        distance(off) == pytest.approx(np.log(1.1))
        and agreeing(off, 9) == 0
        and agreeing(off, 11) == 10
    )
    assert np.isnan(distance({**PAPER, "3fsk_mae_mm": None})) and np.isnan(distance({}))


def test_fewer_tones_keep_the_resolution():
    whole = BroadbandConfig()
    few = whole.model_copy(update=sparser(whole, 32))
    cells = [c.count * np.diff(c.tones_hz())[0] for c in (whole, few)]
    assert cells[0] == pytest.approx(cells[1]) and few.tones_hz().mean() == pytest.approx(
        whole.tones_hz().mean()
    )


def test_the_joint_design_fills_its_ranges():
    factors = {"tilt_x_deg": (-10.0, 10.0), "filters_px": (1, 5, 9), "material": ("skin", "metal")}
    points = pd.DataFrame(filled(factors, 30, seed=4))
    parts = np.floor((points.tilt_x_deg + 10) / 20 * 30)
    assert sorted(parts) == list(range(30))  # one in each
    assert points.filters_px.value_counts().to_dict() == {1: 10, 5: 10, 9: 10}
    assert points.material.value_counts().to_dict() == {"skin": 15, "metal": 15}
    assert points.equals(pd.DataFrame(filled(factors, 30, seed=4)))


def test_the_cases_change_what_they_say():
    file = load_factors()
    alone, together = one_at_a_time(file), joint(file)
    assert [case.values for case in alone[:2]] == [{}, {}] and not alone[1].economies
    assert [c.values for c in alone if "tilt_x_deg" in c.values] == [
        {"tilt_x_deg": -10.0},
        {"tilt_x_deg": 10.0},
    ]
    assert all(len(case.values) == 1 for case in alone[2:]) and len(
        {case.name for case in alone}
    ) == len(alone)
    assert (
        len(together) == file.settings and len({case.number for case in together}) == file.settings
    )
    places = {json.dumps({n: v for n, v in c.values.items() if n in SIMULATED}) for c in together}
    assert len(places) == file.placements == len({case.placement for case in together})
    assert all(not set(file.apart) & set(case.values) for case in together)
    assert (
        told("distance_m", -0.015) == "distance -15 mm"
        and told("material", "metal") == "material metal"
    )


def test_the_default_names_every_factor(tmp_path):
    default = load_factors()
    assert list(default.factor.listed()) and not set(Factors.model_fields) - set(
        default.factor.listed()
    )
    (tmp_path / "f.toml").write_text("settings = 7\n")
    own = load_factors(tmp_path / "f.toml")
    assert own.settings == 7 and own.factor == default.factor and own.apart == default.apart
    (tmp_path / "f.toml").write_text("[factor]\nheight_m = [0.01]\n")
    assert load_factors(tmp_path / "f.toml").factor.listed() == {"height_m": (0.01,)}


def test_the_check_against_the_earlier_study_is_one_of_the_embedded_hands():
    """Its scenes are copies, since a benchmark's paths do not leave its folder: byte by byte."""
    settled = Path(__file__).with_name("settled")
    bench, base = load_benchmark(str(settled / "settled.toml"))
    scenes = [source.scene for source in bench.capture]
    assert scenes == ["hand_b.toml", "hand_f.toml", "hand_u.toml"]
    assert all((base / scene).read_bytes() == (EMBEDDED / scene).read_bytes() for scene in scenes)
    assert [entry.id for entry in paper_methods(bench).values()] == [
        entry.id for entry in bench.method
    ]
    assert len(one_at_a_time(load_factors(settled / "factors.toml"))) == 2 + 29


@pytest.mark.parametrize(
    ("values", "message"),
    [
        (
            {"factor": {"tilt_x_degree": [1.0]}},
            "unknown key 'factor.tilt_x_degree'; did you mean 'tilt_x_deg'",
        ),
        ({"setings": 3}, "unknown key 'setings'; did you mean 'settings'"),
        (
            {"apart": ["filter_px"]},
            "'apart' is ['filter_px']; unknown factor 'filter_px'; did you mean",
        ),
        ({"factor": {"filters_px": [4]}}, "'factor.filters_px.0' is 4; expected an odd number"),
        (
            {"factor": {"material": ["wood"]}},
            "'factor.material.0' is 'wood'; input should be 'skin'",
        ),
        (
            {"factor": {"height_m": [0.1, 0.1]}},
            "'factor' is {'height_m': [0.1, 0.1]}; 'height_m' lists a value twice",
        ),
        ({"factor": {"diffuse": [1.5]}}, "'factor.diffuse.0' is 1.5"),
    ],
)
def test_what_is_wrong_with_a_table_is_said(values, message):
    with pytest.raises(HandbenchError, match=re.escape(f"s.toml: {message}")):
        parse(FactorsFile, values, "s.toml")


def test_what_matters_is_found_and_what_does_not_is_not():
    """Of forty settings the distance follows one factor, by its middle; the other is noise."""
    random = np.random.default_rng(2)
    settings = pd.DataFrame({"a_m": random.uniform(-1, 1, 40), "b_m": random.uniform(-1, 1, 40)})
    settings = settings.assign(
        name="s", placement=0, agree=5, turned=False, distance=settings.a_m**2
    )
    settings = settings.sort_values("distance", ignore_index=True)
    ranges = {"a_m": (-1.0, 1.0), "b_m": (-1.0, 1.0)}
    found = factor_records(settings, ranges, settings.head(5))
    assert [record["factor"] for record in found] == ["a_m", "b_m"]
    assert found[0]["p"] < 1e-4 < 0.05 < found[1]["p"]
    words = answer(settings, 41, found, [], FactorsFile())
    assert (
        "41 settings were tried, 1 of which failed" in words
        and "possibility and no finding" in words
    )
    assert "ties down: a (" in words and "Not shown to matter for the distance: b." in words
    assert "in 0 of 40 settings" in words


def test_placements_count_once():
    """Twelve settings on three placements have three values of a simulated factor."""
    settings = pd.DataFrame(
        {"distance_m": [0.0, 0.5, 1.0] * 4, "placement": [0, 1, 2] * 4, "distance": range(12)}
    )
    [record] = factor_records(settings, {"distance_m": (0.0, 1.0)}, settings.head(3))
    assert record["units"] == 3

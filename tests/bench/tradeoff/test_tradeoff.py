"""What a trade-off makes of its figures: the sweep's settings, fronts, answers, counts."""

import json
from dataclasses import replace
from pathlib import Path
from unittest.mock import Mock

import pytest
from hypothesis import given
from hypothesis import strategies as st

from handbench.bench.results import (
    Section,
    Setting,
    Tradeoff,
    TradeoffFacts,
    load_tradeoff,
    write_tradeoff,
)
from handbench.bench.run.sweep import TradeoffSweep, complete_sweep, default, imaging_settings
from handbench.bench.tradeoff.imaging import counted_factor
from handbench.bench.tradeoff.run import _link_or_copy
from handbench.bench.tradeoff.settings import answer, dominates, front, rank
from handbench.cli.tradeoff import LENGTHS, TIMES, quantity
from handbench.radar.methods.fsk_config import ThreeToneConfig
from handbench.radar.methods.projection_config import BroadbandConfig
from handbench.support.config import parse
from handbench.support.errors import HandbenchError


def line(
    name: str, error: float | None, seconds: float | None, method: str = "2fsk", **known: float
) -> Setting:
    about = {"section": "imaging", "name": name, "title": name, "metric": "mae_mm", "unit": "mm"}
    figures = {
        "error": error,
        "low": error and 0.8 * error,
        "high": error and 1.2 * error,
        "seconds": seconds,
        "seconds_low": seconds and 0.9 * seconds,
        "seconds_high": seconds and 1.1 * seconds,
    }
    return Setting(knobs=json.dumps({"method": method}), **about, **figures, **known)


def folder_with(settings: list[Setting], folder: Path) -> Tradeoff:
    about = {"metric": "mae_mm", "unit": "mm", "definition": "", "seconds": ""}
    section = Section(name="imaging", title="Imaging", reference=settings[0].name, **about)
    folder.mkdir()
    facts = TradeoffFacts(name="t", scored_against="truth", sections=(section,))
    write_tradeoff(folder, facts, settings)
    return load_tradeoff(folder)


SLOW, FAST, WORSE = (
    line("slow", 0.5, 0.3, "broadband"),
    line("fast", 5.0, 0.02),
    line("worse", 6.0, 0.4, "broadband"),
)
UNKNOWN = line("unknown", None, 0.01)


def test_the_front_names_what_dominates():
    """Of all methods, and of each method."""
    other = replace(WORSE, name="other", knobs=json.dumps({"method": "narrowband"}))
    ranked = {s.name: s for s in rank([SLOW, FAST, WORSE, other, UNKNOWN], "slow")}
    assert [name for name, s in ranked.items() if s.on_front] == ["slow", "fast"]
    assert ranked["worse"].dominated_by == "slow" and ranked["unknown"].dominated_by == ""
    assert ranked["other"].on_method_front and not ranked["worse"].on_method_front
    assert ranked["fast"].ratio == pytest.approx(0.02 / 0.3)


def test_a_setting_that_sees_more_is_not_beaten_by_one_that_sees_less():
    whole, half = (
        line("whole", 2.0, 0.5, seen_percent=30.0),
        line("half", 1.0, 0.1, seen_percent=15.0),
    )
    assert {s.name for s in front([whole, half])} == {"whole", "half"}
    assert not dominates(whole, half) and dominates(replace(half, seen_percent=30.0), whole)


def test_a_capture_s_file_is_linked_or_where_links_fail_copied(tmp_path, monkeypatch):
    (tmp_path / "a").write_text("echoes")
    names = [str(tmp_path / name) for name in "abc"]
    for _ in range(2):  # another setting has linked it already
        _link_or_copy(*names[:2])
    monkeypatch.setattr("os.link", Mock(side_effect=OSError(18, "another file system")))
    _link_or_copy(names[0], names[2])
    linked, copied = (Path(name) for name in names[1:])
    assert linked.samefile(names[0]) and not copied.samefile(names[0])
    assert copied.read_text() == "echoes"


SEEN = st.sampled_from([None, 1, 2])


@given(st.lists(st.tuples(st.integers(1, 6), st.integers(1, 6), SEEN), min_size=1, max_size=12))
def test_every_setting_is_on_the_front_or_dominated_by_one_that_is(figures):
    settings = [
        line(f"s{k}", float(error), float(seconds), seen_percent=seen and 10.0 * seen)
        for k, (error, seconds, seen) in enumerate(figures)
    ]
    best = {s.name for s in front(settings)}
    for s in rank(settings, "s0"):
        assert s.on_front == (s.name in best) == (s.dominated_by == "")
        if not s.on_front:
            assert s.dominated_by in best
            assert dominates(next(t for t in settings if t.name == s.dominated_by), s)


def test_the_paper_s_count_on_its_own_grids():
    assert counted_factor(BroadbandConfig(), ThreeToneConfig()) == pytest.approx(128 * 81 / 7)


def sweep(**entry: object) -> TradeoffSweep:
    return parse(TradeoffSweep, {"imaging": [entry]}, "test")


def test_knobs_multiply_and_go_into_tables():
    knobs = {"x.step_m,y.step_m": [1e-3, 2e-3], "count": [32, 64, 128]}
    asked = sweep(
        method="broadband", config={"tolerance": 1e-3}, sweep=knobs, every_nth_antenna=[1, 2]
    )
    settings = imaging_settings(asked, {})
    assert len(settings) == len({s.name for s in settings}) == 2 * 3 * 2
    last, axis = settings[-1], {"start_m": -0.15, "stop_m": 0.15, "step_m": 2e-3}
    assert last.name == "broadband-tolerance-1e-3-xy.step-2mm-count-128-every_nth_antenna-2"
    assert last.config["x"] == axis == last.config["y"] and last.every_nth_antenna == 2


def test_what_the_benchmark_says_of_a_method_holds_unless_swept():
    known = {"2fsk": {"threshold_db": -8.0, "tolerance": 1e-4}}
    [setting] = imaging_settings(sweep(method="2fsk", config={"tolerance": 1e-2}), known)
    assert setting.config == {"threshold_db": -8.0, "tolerance": 1e-2}


@pytest.mark.parametrize(
    ("least", "name"),
    [
        ({"max_error_mm": 2.0}, "slow"),  # 'near' has 1.9 mm, but up to 2.28 mm
        ({"max_error_mm": 2.3}, "near"),
        ({"max_seconds": 0.34}, "near"),  # 'slow' takes 0.3 s, up to 0.33 s, later a tenth more
        ({"max_error_mm": 6.1, "max_seconds": 0.37}, "near"),
    ],
)
def test_answers_hold_settings_to_their_worst(tmp_path, least, name):
    found = folder_with([SLOW, FAST, line("near", 1.9, 0.01)], tmp_path / "t")
    assert answer(found, **least)[0].name == name


def test_no_answer_names_the_nearest(tmp_path):
    found = folder_with([SLOW, FAST, UNKNOWN], tmp_path / "t")
    words = r"MAE ≤ 0.1 mm; the nearest is 'slow' with 0.5 mm \(up to 0.6 mm\)"
    with pytest.raises(HandbenchError, match=words):
        answer(found, max_error_mm=0.1)
    unsure = folder_with([replace(SLOW, low=None, high=None)], tmp_path / "u")
    words = "on these captures, too few to promise it for others"
    assert answer(unsure, max_error_mm=0.5)[1].endswith(words)
    assert "these captures" not in answer(found, max_error_mm=10.0)[1]


def test_the_acquisition_is_counted_when_asked_for(tmp_path):
    many, few = (
        line("many", 0.5, 0.02, acquisition_s=0.128),
        line("few", 1.0, 0.03, acquisition_s=0.002),
    )
    found = folder_with([many, few], tmp_path / "t")
    assert answer(found, max_seconds=0.05)[0].name == "many"
    counted = answer(found, max_seconds=0.05, count_acquisition=True)[0]
    assert counted.name == "few" and counted.seconds == pytest.approx(0.032)


@pytest.mark.parametrize(
    ("text", "units", "value"),
    [("0.5 cm", LENGTHS, 5.0), (".1s", TIMES, 0.1), ("1e3 µs", TIMES, 1e-3)],
)
def test_quantities_carry_their_unit(text, units, value):
    assert quantity(text, units, "--max") == pytest.approx(value)


@pytest.mark.parametrize("text", ["2", "-2mm", "2 ms", "nan mm", ""])
def test_other_quantities_are_refused(text):
    with pytest.raises(HandbenchError, match="--max-mae: is"):
        quantity(text, LENGTHS, "--max-mae")


REFUSED = {
    "method": ({"method": "2fks"}, "did you mean '2fsk'"),
    "key": ({"sweep": {"tolerence": [1e-2]}}, "did you mean 'tolerance'"),
    "axis": ({"sweep": {"x.stp_m": [1e-3]}}, "stp_m"),
    "no table": ({"sweep": {"tolerance.fine": [1]}}, "is not a table"),
    "twice": ({"sweep": {"tolerance": [1e-2, 1e-2]}}, "listed twice"),
    "nothing": ({"sweep": {"tolerance": []}}, "test: "),
    "no antenna": ({"every_nth_antenna": [0]}, "test: "),
}


@pytest.mark.parametrize(("entry", "words"), REFUSED.values(), ids=REFUSED)
def test_what_a_sweep_cannot_mean_is_refused(entry, words):
    with pytest.raises(HandbenchError, match=words):
        imaging_settings(sweep(**{"method": "2fsk", **entry}), {})


def test_the_default_sweep_is_whole_and_a_reference_is_one_of_it():
    settings = imaging_settings(default(), {})
    assert default().reference in {s.name for s in settings}
    assert {"2fsk", "3fsk", "broadband", "narrowband"} <= {s.method for s in settings}
    own = complete_sweep(TradeoffSweep(repeats=7))
    assert (own.repeats, own.imaging) == (7, default().imaging)
    with pytest.raises(HandbenchError, match=r"tradeoff\.reference: there is no setting 'x'"):
        imaging_settings(sweep(method="2fsk").model_copy(update={"reference": "x"}), {})

"""What a trade-off makes of its figures: the sweep's settings, fronts, answers, counts."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
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
from handbench.bench.run.sweep import (
    ImagingEntry,
    TradeoffSweep,
    complete_sweep,
    default,
    imaging_settings,
)
from handbench.bench.tradeoff.imaging import counted_factor
from handbench.bench.tradeoff.settings import answer, dominates, front, rank, with_acquisition
from handbench.cli.tradeoff import LENGTHS, TIMES, quantity
from handbench.radar.methods.fsk_config import ThreeToneConfig
from handbench.radar.methods.projection_config import BroadbandConfig
from handbench.support.config import parse
from handbench.support.errors import HandbenchError


def line(
    name: str, error: float | None, seconds: float | None, method: str = "2fsk", **known: float
) -> Setting:
    figures = {
        "low": error and 0.8 * error,
        "high": error and 1.2 * error,
        "seconds_low": seconds and 0.9 * seconds,
        "seconds_high": seconds and 1.1 * seconds,
        "acquisition_s": None,
        **known,
    }
    return Setting(
        section="imaging",
        name=name,
        title=name,
        knobs=json.dumps({"method": method}),
        metric="mae_mm",
        error=error,
        unit="mm",
        seconds=seconds,
        ratio=None,
        plan_s=None,
        imaging_s=None,
        extraction_s=None,
        operations=None,
        peak_memory_mb=None,
        on_front=False,
        dominated_by="",
        **figures,
    )


def folder_with(settings: list[Setting], folder: Path) -> Tradeoff:
    section = Section(
        name="imaging",
        title="Imaging",
        metric="mae_mm",
        unit="mm",
        definition="",
        seconds="",
        reference=settings[0].name,
    )
    folder.mkdir()
    write_tradeoff(
        folder, TradeoffFacts(name="t", scored_against="truth", sections=(section,)), settings
    )
    return load_tradeoff(folder)


SLOW, FAST, WORSE = (
    line("slow", 0.5, 0.3, "broadband"),
    line("fast", 5.0, 0.02),
    line("worse", 6.0, 0.4, "broadband"),
)
UNKNOWN = line("unknown", None, 0.01)


def test_the_front_names_what_dominates():
    ranked = {s.name: s for s in rank([SLOW, FAST, WORSE, UNKNOWN], "slow")}
    assert [name for name, s in ranked.items() if s.on_front] == ["slow", "fast"]
    assert ranked["worse"].dominated_by == "slow" and not ranked["worse"].on_method_front
    assert ranked["fast"].ratio == pytest.approx(0.02 / 0.3)
    assert not ranked["unknown"].on_front and ranked["unknown"].dominated_by == ""


def test_a_method_s_own_front_survives_another_method():
    other = replace(WORSE, knobs=json.dumps({"method": "narrowband"}))
    [ranked] = [s for s in rank([SLOW, FAST, other], "slow") if s.name == "worse"]
    assert ranked.dominated_by == "slow" and not ranked.on_front and ranked.on_method_front


def test_a_setting_that_sees_more_is_not_beaten_by_one_that_sees_less():
    whole, half = (
        line("whole", 2.0, 0.5, seen_percent=30.0),
        line("half", 1.0, 0.1, seen_percent=15.0),
    )
    assert {s.name for s in front([whole, half])} == {"whole", "half"}
    assert not dominates(whole, half) and dominates(replace(half, seen_percent=30.0), whole)


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


def test_answers_hold_settings_to_their_worst(tmp_path):
    near = line("near", 1.9, 0.01)  # 1.9 mm, but up to 2.28 mm
    found = folder_with([SLOW, FAST, near], tmp_path / "t")
    assert answer(found, max_error_mm=2.0)[0].name == "slow"
    assert answer(found, max_error_mm=2.3)[0].name == "near"
    assert answer(found, max_seconds=0.3)[0].name == "near"  # 'slow' takes 0.3 s, but up to 0.33 s
    assert (
        answer(found, max_seconds=0.34)[0].name == "near"
    )  # and a later run may take a tenth more
    assert answer(found, max_seconds=0.37)[0].name == "slow"
    assert answer(found, max_error_mm=6.1, max_seconds=0.37)[0].name == "near"


def test_no_answer_names_the_nearest(tmp_path):
    found = folder_with([SLOW, FAST, UNKNOWN], tmp_path / "t")
    with pytest.raises(
        HandbenchError, match=r"MAE ≤ 0.1 mm; the nearest, 'slow', has 0.5 mm \(up to 0.6 mm\)"
    ):
        answer(found, max_error_mm=0.1)
    unsure = folder_with([replace(SLOW, low=None, high=None)], tmp_path / "u")
    with pytest.raises(HandbenchError, match=r"0.5 mm \(on these captures\)"):
        answer(unsure, max_error_mm=0.1)
    assert answer(unsure, max_error_mm=0.5)[1].endswith(
        "on these captures, too few to promise it for others"
    )
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
    assert with_acquisition([many])[0].seconds_high == pytest.approx(0.022 + 0.128)


@pytest.mark.parametrize(("text", "units", "value"), [
    ("2mm", LENGTHS, 2.0), ("0.5 cm", LENGTHS, 5.0), ("33ms", TIMES, 0.033), (".1s", TIMES, 0.1),
    ("1e3 µs", TIMES, 1e-3),
])  # fmt: skip
def test_quantities_carry_their_unit(text, units, value):
    assert quantity(text, units, "--max") == pytest.approx(value)


@pytest.mark.parametrize("text", ["2", "mm", "-2mm", "0mm", "2 ms", "nan mm", "2mm; 3mm", ""])
def test_other_quantities_are_refused(text):
    with pytest.raises(HandbenchError, match="--max-mae: is"):
        quantity(text, LENGTHS, "--max-mae")


def test_the_paper_s_count_on_its_own_grids():
    assert counted_factor(BroadbandConfig(), ThreeToneConfig()) == pytest.approx(128 * 81 / 7)


def sweep(**entry: object) -> TradeoffSweep:
    return parse(TradeoffSweep, {"imaging": [entry]}, "test")


def test_knobs_multiply_and_go_into_tables():
    settings = imaging_settings(
        sweep(
            method="broadband",
            config={"tolerance": 1e-3},
            sweep={"x.step_m,y.step_m": [1e-3, 2e-3], "count": [32, 64, 128]},
            every_nth_antenna=[1, 2],
        ),
        {},
    )
    assert len(settings) == len({s.name for s in settings}) == 2 * 3 * 2
    last = settings[-1]
    assert last.name == "broadband-tolerance-1e-3-xy.step-2mm-count-128-every_nth_antenna-2"
    assert (
        last.config["x"] == {"start_m": -0.15, "stop_m": 0.15, "step_m": 2e-3} == last.config["y"]
    )
    assert last.every_nth_antenna == 2 and "z" not in last.config


def test_a_list_among_the_values_is_one_value():
    ladders = [[82e9, 81.8e9, 79.5e9], [82e9, 81.8e9, 81.3e9, 79.5e9]]
    settings = imaging_settings(sweep(method="nfsk", sweep={"tones_hz": ladders}), {})
    assert [len(s.config["tones_hz"]) for s in settings] == [3, 4]
    assert settings[0].name == "nfsk-tones-82_81.8_79.5GHz"


def test_settings_that_differ_in_tables_alone_have_numbers():
    rough, fine = ({"start_m": -0.1, "stop_m": 0.1, "step_m": step} for step in (2e-3, 1e-3))
    entries = [{"method": "2fsk", "config": {"x": axis}} for axis in (rough, fine)]
    settings = imaging_settings(parse(TradeoffSweep, {"imaging": entries}, "test"), {})
    assert [(s.name, s.config["x"]) for s in settings] == [("2fsk", rough), ("2fsk-no-2", fine)]


def test_what_the_benchmark_says_of_a_method_holds_unless_swept():
    known = {"2fsk": {"threshold_db": -8.0, "tolerance": 1e-4}}
    [setting] = imaging_settings(sweep(method="2fsk", config={"tolerance": 1e-2}), known)
    assert setting.config == {"threshold_db": -8.0, "tolerance": 1e-2}


@pytest.mark.parametrize(("entry", "complaint"), [
    ({"method": "2fks"}, "did you mean '2fsk'"),
    ({"method": "2fsk", "sweep": {"tolerence": [1e-2]}}, "did you mean 'tolerance'"),
    ({"method": "2fsk", "sweep": {"x.stp_m": [1e-3]}}, "stp_m"),
    ({"method": "2fsk", "sweep": {"tolerance.fine": [1]}}, "is no table"),
    ({"method": "2fsk", "sweep": {"tolerance": [1e-2, 1e-2]}}, "listed twice"),
])  # fmt: skip
def test_what_a_method_does_not_take_is_refused(entry, complaint):
    with pytest.raises(HandbenchError, match=complaint):
        imaging_settings(sweep(**entry), {})


@pytest.mark.parametrize("entry", [
    {"sweep": {"tolerance": []}}, {"every_nth_antenna": [0]}, {"every_nth_antenna": []}, {"knobs": {}},
])  # fmt: skip
def test_entries_are_strict(entry):
    with pytest.raises(HandbenchError, match="test: "):
        parse(ImagingEntry, {"method": "2fsk", **entry}, "test")


def test_the_default_sweep_is_whole():
    settings = imaging_settings(default(), {})
    assert len(settings) >= 20 and default().reference in {s.name for s in settings}
    assert {"2fsk", "3fsk", "broadband", "narrowband"} <= {s.method for s in settings}
    assert complete_sweep(None) == default()
    own = complete_sweep(TradeoffSweep(repeats=7))
    assert (
        own.repeats == 7
        and own.imaging == default().imaging
        and own.reference == default().reference
    )


def test_an_unknown_reference_is_refused():
    with pytest.raises(HandbenchError, match=r"tradeoff\.reference: no setting 'x'"):
        imaging_settings(sweep(method="2fsk").model_copy(update={"reference": "x"}), {})


def test_a_trade_off_of_before_reads_without_its_last_column(tmp_path):
    found = folder_with([SLOW], tmp_path / "t")
    file = found.folder / "tradeoff.csv"
    file.write_text(
        "\n".join(row.rpartition(",")[0] for row in file.read_text().splitlines()) + "\n"
    )
    [setting] = load_tradeoff(found.folder).settings
    assert setting == SLOW and np.isclose(setting.error, 0.5)

"""The trade-off over the speed of a hand: its errors against the formula, and the best setting."""

from __future__ import annotations

import json
from types import SimpleNamespace

import pytest

from handbench.bench.results import Section, Setting, best_at_each_speed
from handbench.bench.run.sweep import TradeoffSweep
from handbench.bench.tradeoff import motion
from handbench.bench.tradeoff.settings import rank
from handbench.reports.figures.motion import over_speed
from handbench.support.config import parse

SPHERE = {"kind": "sphere", "radius_m": 0.03, "edge_m": 2e-3, "distance_m": 0.3}
C_M_S = 299_792_458.0


@pytest.mark.slow
def test_motion_shifts_depths_by_the_formula_and_a_repeated_tone_takes_it_off(monkeypatch):
    monkeypatch.setitem(motion.SCENE, "target", SPHERE)
    entries = [{"method": id, "config": {"tolerance": 1e-3}} for id in ("3fsk", "3fsk-doppler")]
    knobs = {"speed_m_s": [0.02], "step_s": [1e-3], "imaging": entries, "phase_noise_rad": 0.0}
    sweep = parse(TradeoffSweep, {"motion": knobs}, "test")
    bench = SimpleNamespace(method=(), seed=1)
    plain, doppler = motion.measure_motion(SimpleNamespace(sweep=sweep, bench=bench)).lines
    # f3 (t3 − t1)/(f1 − f3) of the speed
    assert plain.error == pytest.approx(1e3 * 79.5 / 2.5 * 2e-3 * 0.02, rel=0.15)
    assert doppler.error < 0.2 and doppler.velocity_mae_mm_s < 2
    assert doppler.velocity_limit_m_s == pytest.approx(C_M_S / (4 * 82e9 * 3e-3))
    assert (plain.seconds, doppler.seconds) == pytest.approx((3e-3, 4e-3))


def at(name: str, speed_m_s: float, error: float, seconds: float, limit_m_s: float) -> Setting:
    about = {"section": "motion", "title": name, "metric": "mae_mm", "unit": "mm"}
    figures = {"error": error, "seconds": seconds, "velocity_limit_m_s": limit_m_s}
    knobs = json.dumps({"method": name.partition("-")[0]})
    return Setting(name=name, knobs=knobs, speed_m_s=speed_m_s, **about, **figures)


def test_settings_are_compared_at_the_same_speed():
    settings = [
        at("3fsk-slow", 0.0, 0.5, 2e-3, 0.1),
        at("2fsk-slow", 0.0, 0.6, 3e-3, 0.1),
        at("3fsk-fast", 0.2, 5.0, 2e-3, 0.1),
        at("2fsk-fast", 0.2, 4.0, 3e-3, 0.3),
    ]
    ranked = rank(settings, "3fsk-slow")
    assert [s.dominated_by for s in ranked] == ["", "3fsk-slow", "", ""]
    assert [s.name for s in best_at_each_speed(ranked)] == ["3fsk-slow", "2fsk-fast"]
    assert [s.beyond_limit for s in ranked] == [False, False, True, False]
    words = dict.fromkeys(("metric", "definition", "seconds"), "mae_mm")
    about = Section(name="motion", title="Motion", unit="mm", reference="3fsk-slow", **words)
    [axis] = over_speed(about, tuple(ranked)).figure.axes
    x = [line.get_xdata().tolist() for line in axis.lines if len(line.get_xdata()) > 1]
    assert x == [[pytest.approx(0.08), 0.2]] * 2  # at rest: left of the slowest speed

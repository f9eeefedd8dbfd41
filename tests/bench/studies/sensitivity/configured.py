"""The paper's methods in a benchmark, and their configurations under a setting."""

from __future__ import annotations

import numpy as np

from handbench.bench.evaluation.metrics import HEADLINE, METRICS
from handbench.bench.run.benchmark_file import BenchFile, MethodEntry
from handbench.radar.methods.fsk_config import ThreeToneConfig, TwoToneConfig
from handbench.radar.methods.projection_config import BroadbandConfig, NarrowbandConfig
from handbench.radar.methods.registry import method
from handbench.support.config import Config
from handbench.support.errors import HandbenchError
from tests.bench.studies.sensitivity.sensitivity_cases import Case
from tests.bench.studies.sensitivity.sensitivity_factors import FactorsFile

FAMILIES = tuple(METRICS[HEADLINE].paper)  # the paper's methods
WINDOWS = ("coarse_filter_px", "fine_filter_px")
FILTERS: dict[str, tuple[str, ...]] = {"filters_px": WINDOWS, **{name: (name,) for name in WINDOWS}}


def paper_methods(bench: BenchFile) -> dict[str, MethodEntry]:
    """The benchmark's method of each of the paper's: itself, or else the first of its variants.
    HandbenchError where there is none at all."""
    found: dict[str, MethodEntry] = {}
    for family in FAMILIES:
        own = [entry for entry in bench.method if entry.id.split("-")[0] == family]
        if own:
            found[family] = next((entry for entry in own if entry.id == family), own[0])
    if not found:
        known = ", ".join(FAMILIES)
        raise HandbenchError(
            f"sensitivity: the benchmark has none of the paper's methods; add one of {known}"
        )
    return found


def configured(entry: MethodEntry, case: Case, file: FactorsFile) -> Config:
    """A method's configuration under a setting."""
    chosen, where, changed = method(entry.id), f"method '{entry.id}'", dict(entry.config)
    known = chosen.configure(changed, where)
    if isinstance(known, ThreeToneConfig):
        for name, windows in FILTERS.items():
            changed |= {window: case.values[name] for window in windows if name in case.values}
    if isinstance(known, BroadbandConfig | NarrowbandConfig):
        if case.economies and file.tolerance is not None:
            changed["tolerance"] = file.tolerance
        if case.economies and file.sweep_tones is not None and isinstance(known, BroadbandConfig):
            changed |= sparser(known, file.sweep_tones)
        if shift_m := float(case.values.get("box_shift_m", 0.0)):
            ends_m = {key: getattr(known.z, key) + shift_m for key in ("start_m", "stop_m")}
            changed["z"] = {**ends_m, "step_m": known.z.step_m}
    return chosen.configure(changed, where)


def sparser(config: BroadbandConfig, count: int) -> dict[str, float | int]:
    """A sweep of fewer tones of the same resolution, c/(2·count·Δf), about the same middle."""
    middle_hz = (config.start_hz + config.stop_hz) / 2
    step_hz = (config.stop_hz - config.start_hz) / (config.count - 1) * config.count / count
    half_hz = step_hz * (count - 1) / 2
    return {"start_hz": middle_hz - half_hz, "stop_hz": middle_hz + half_hz, "count": count}


def grid_of(config: Config) -> tuple[np.ndarray, np.ndarray]:
    """The pixels x_m [nx], y_m [ny] of a method of the paper."""
    assert isinstance(config, TwoToneConfig | BroadbandConfig | NarrowbandConfig)
    return config.x.values_m(), config.y.values_m()


def tones_of(config: Config) -> np.ndarray:
    """The frequencies [f] that a method of the paper images."""
    if isinstance(config, BroadbandConfig | NarrowbandConfig):
        return config.tones_hz()
    assert isinstance(config, TwoToneConfig)
    return np.array(config.ladder_hz)

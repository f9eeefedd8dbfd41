"""The tables of a run: figures with their intervals, comparisons, and both under equal treatment."""

from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import pandas as pd

from handbench.bench.evaluation.alike import SMOOTHING
from handbench.bench.evaluation.equal_treatment import SHARES_PERCENT
from handbench.bench.evaluation.metrics import HEADLINE, METRICS, TITLES, over_frames, pool
from handbench.bench.evaluation.rows import accuracy_rows, frame_rows, precision_rows, time_rows
from handbench.bench.evaluation.scoring_protocols import protocol
from handbench.bench.evaluation.statistics.intervals import figure_interval
from handbench.bench.evaluation.statistics.paired import compare
from handbench.bench.results import REFERENCES
from handbench.bench.results.about import SHARES
from handbench.bench.results.tables import CAPTURES, COMPARISONS, CURVES, EQUAL, TABLE, frame
from handbench.bench.run.outcome import Basis, Line, Outcome, deviations, errors, repeated, surfaces
from handbench.bench.run.scoring import EACH_FRAME, FIGURES, TREATED
from handbench.support.files import read_json

ALIKE_COMPARED = (HEADLINE, "aurc_mm")  # the figures by which equally treated methods are compared
EACH = (HEADLINE, "max_mm", *SHARES)  # the figures that are told for each capture
Figures = dict[tuple[str, str], pd.DataFrame]  # (reference, method) → `of_captures` of those that have the reference


def tables(outcome: Outcome, on: Basis) -> dict[str, pd.DataFrame]:
    """The result's tables by name, but for tasks and repeats."""
    figures = _figures(outcome, on)
    alike = _equal_treatment(outcome, on)
    each = [
        row
        for (reference, method), captures in figures.items()
        for row in _each_rows(method, "", reference, _scored(outcome, on, reference), captures[list(EACH)])
    ]
    return {
        "table": tabulate(outcome, on, figures),
        "comparisons": pd.concat([frame(COMPARISONS), _own(outcome, on, figures), *alike.compared]),
        "equal": frame(EQUAL, alike.figures),
        "curves": frame(CURVES, alike.curves),
        "captures": frame(CAPTURES, [*each, *alike.captures]),
    }


def _figures(outcome: Outcome, on: Basis) -> Figures:
    """The figures that the stages which scored the captures left, in the order of references, methods and captures."""
    columns = [*pool([]), "floor_mm"]
    rows: dict[tuple[str, str], list[np.ndarray]] = {}
    for capture in on.captures:
        for reference, methods in kept(outcome, capture.name, FIGURES).items():
            for method, values in methods.items():
                rows.setdefault((reference, method), []).append(np.array([values[key] for key in columns], float))
    wanted = [(reference, entry.id) for reference in REFERENCES for entry in on.methods]
    return {each: pd.DataFrame(rows[each], columns=columns) for each in wanted if each in rows}


def _scored(outcome: Outcome, on: Basis, reference: str) -> list[str]:
    """The captures that have the reference."""
    return [capture.name for capture in on.captures if reference in outcome.references[capture.name]]


def tabulate(outcome: Outcome, on: Basis, figures: Figures) -> pd.DataFrame:
    """The result's `TABLE`, one block per reference."""
    rows, repeats = [frame(TABLE)], repeated(outcome)
    seed, chosen = outcome.bench.seed, protocol(outcome.bench.protocol)
    precise = [capture.name for capture in on.repeated]
    frames = {capture.name: kept(outcome, capture.name, EACH_FRAME) for capture in on.captures}
    for (reference, method), captures in figures.items():
        names = _scored(outcome, on, reference)
        about = outcome, names, method, reference
        rows.append(accuracy_rows(method, reference, errors(*about), seed, surfaces(*about), chosen, captures))
        of_captures_frames = [over_frames(frames[name][reference][method]) for name in names]
        rows.append(frame_rows(method, reference, of_captures_frames, chosen))
        entry = next(entry for entry in on.methods if entry.id == method)
        if entry.precision and precise and "precision_mm" in chosen.metrics:
            several = [name for name in precise if (name, method) in outcome.deviations]
            spread = deviations(outcome, several, method) if several else None
            mine = repeats[repeats.method == method]
            strongest_m = [mine.z_m[mine.capture == name].to_numpy() for name in precise]
            rows.append(precision_rows(method, reference, strongest_m, spread))
        seconds = [s for capture in on.all_captures for s in outcome.seconds.get((capture.name, method), [])]
        rows.append(time_rows(method, reference, seconds, seed))
    table = pd.concat(rows)
    return table if outcome.bench.reproduces else table.assign(paper=np.nan)


def _own(outcome: Outcome, on: Basis, figures: Figures) -> pd.DataFrame:
    """Every pair of methods by the protocol's compared metrics, each method as it is, against each reference."""
    lines = [frame(COMPARISONS)]
    for reference in REFERENCES:
        found = {method: captures for (of, method), captures in figures.items() if of == reference}
        for metric in protocol(outcome.bench.protocol).compared if found else ():
            by_method = {method: captures[metric].to_numpy() for method, captures in found.items()}
            lines.append(compare(by_method, reference, metric, _titles(on)))
    return pd.concat(lines)


@dataclass
class Alike:
    """Lines of `EQUAL`, `CURVES` and `CAPTURES`, and tables of `COMPARISONS`, under equal treatment."""

    figures: list[Line] = field(default_factory=list)
    curves: list[Line] = field(default_factory=list)
    captures: list[Line] = field(default_factory=list)
    compared: list[pd.DataFrame] = field(default_factory=list)


def _equal_treatment(outcome: Outcome, on: Basis) -> Alike:
    """Every treatment, against the reference with the most surface that all captures have; of the methods that every
    capture was treated by."""
    names = [capture.name for capture in on.captures]
    for reference in ("completed", *REFERENCES):
        if names == _scored(outcome, on, reference):
            break
    else:
        return Alike()
    rows: dict[tuple[str, str], list[dict[str, Any]]] = {}  # by treatment and method
    sums_mm: dict[tuple[str, str], np.ndarray] = {}  # of the curves, which are long
    for name in names:
        for treatment, treated in kept(outcome, name, TREATED)[reference].items():
            for key, of in (((treatment, method), of) for method, of in treated.items()):
                rows.setdefault(key, []).append(of["figures"])
                sums_mm[key] = sums_mm.get(key, 0.0) + np.array(of["curve_mm"], float)
    everywhere = {key for key, captures in rows.items() if len(captures) == len(names)}
    methods = [entry.id for entry in on.methods if all((t, entry.id) in everywhere for t in SMOOTHING)]
    found = Alike()
    for treatment in SMOOTHING if len(methods) > 1 else ():
        each = {method: pd.DataFrame(rows[treatment, method], dtype=float) for method in methods}
        for method, captures in each.items():
            found.figures += figure_rows(method, treatment, reference, captures)
            found.captures += _each_rows(method, treatment, reference, names, captures[list(ALIKE_COMPARED)])
            found.curves += curve_rows(method, treatment, reference, sums_mm[treatment, method] / len(names))
        for metric in ALIKE_COMPARED:
            by_method = {method: captures[metric].to_numpy() for method, captures in each.items()}
            found.compared.append(compare(by_method, reference, metric, _titles(on), treatment))
    return found


def _each_rows(method: str, treatment: str, reference: str, names: list[str], captures: pd.DataFrame) -> Iterable[Line]:
    """Lines of `CAPTURES`."""
    for metric in captures.columns:
        for name, value in zip(names, captures[metric], strict=True):
            yield metric, treatment, method, name, value, METRICS[metric].unit, reference


def figure_rows(method: str, treatment: str, reference: str, captures: pd.DataFrame) -> Iterable[Line]:
    """Lines of `EQUAL`: the figures of the captures, one a line of theirs, averaged."""
    for metric in captures.columns:
        low, high = figure_interval(metric, captures[metric].to_numpy()) or (None, None)
        yield metric, treatment, method, captures[metric].mean(), low, high, METRICS[metric].unit, reference


def curve_rows(method: str, treatment: str, reference: str, curve_mm: np.ndarray) -> Iterable[Line]:
    """Lines of `CURVES`: the mean of the captures' curves, as far as all of them reach (NaN: no further)."""
    for share, risk_mm in zip(SHARES_PERCENT, curve_mm, strict=True):
        if np.isfinite(risk_mm):
            yield method, treatment, reference, share, risk_mm


def _titles(on: Basis) -> dict[str, str]:
    return {entry.id: TITLES.get(entry.id, entry.id) for entry in on.methods}


def kept(outcome: Outcome, capture: str, file: str) -> Any:
    """The content of a JSON file that the stage that scored a capture left."""
    return read_json(outcome.scores[capture] / file, "a scored capture's figures")

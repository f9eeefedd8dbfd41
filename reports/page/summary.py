"""The top of a report: what the figures say in three lines, the table of the methods' main figures,
and a small table of each capture."""

import math
from dataclasses import replace
from itertools import combinations
from typing import Any

import pandas as pd
from markupsafe import Markup

from handbench.bench.evaluation.intervals import FEWEST, note
from handbench.bench.evaluation.metrics import HEADLINE, chosen
from handbench.bench.evaluation.tables import each
from handbench.bench.results.about import CaptureFacts, MethodFacts
from handbench.bench.results.result_folder import Result, best
from handbench.reports.figures.style import drawn_references
from handbench.reports.tables.rounding import figure
from handbench.reports.tables.table import Table, figures, main_lines

SMOOTHED = "window"  # the equal treatment in the main table


def main_table(result: Result) -> Table:
    """Return the main figures of all methods against the first reference, with the tones of each
    method below its title; the second column compares them on the pixels that all see."""
    equal = result.equal[(result.equal.metric == HEADLINE) & (result.equal.treatment == SMOOTHED)]
    table = figures(result, pd.concat([main_lines(result, chosen("summary")), equal]))
    tones = {
        method.title: f"{method.title}\n{tones_text(method)}".strip()
        for method in result.about.methods
    }
    return replace(table, texts=table.texts.rename(tones))


def tones_text(method: MethodFacts) -> str:
    """Return the tones of a method as text, such as "82, 79.5 GHz" or "128 tones, 72 to 82 GHz"; ""
    if its settings name none. Settings of captures that differ are all named."""
    texts = []
    for config in method.config.values():
        tones_hz = config.get("tones_hz", ())
        if isinstance(tones_hz, dict):
            start_ghz, stop_ghz = (tones_hz[key] / 1e9 for key in ("start_hz", "stop_hz"))
            texts.append(f"{tones_hz['count']} tones, {start_ghz:g} to {stop_ghz:g} GHz")
        elif tones_hz:
            texts.append(f"{', '.join(f'{hz / 1e9:g}' for hz in tones_hz)} GHz")
    return "; ".join(dict.fromkeys(texts))


def leads(result: Result) -> dict[str, str]:
    """Return the lines on top of a report, heading → text: which method is best at what, what
    limits the figures, and whether the methods have the order of the paper. A line without text is
    left out."""
    lines = {
        "Best": _best(result),
        "Limits": " · ".join(limits(result)),
        "Paper": _order_of_paper(result),
    }
    return {heading: text for heading, text in lines.items() if text}


def _best(result: Result) -> str:
    """Name for each main metric the method with the best figure, and those that are not shown to be
    worse."""
    titles, texts = result.about.method_titles, []
    for metric in chosen("summary"):
        lines = main_lines(result, [metric])
        if lines.empty:
            continue
        higher = result.about.metrics[metric].better == "higher"
        first: Any = next(each(lines.sort_values("value", ascending=not higher)))
        names = dict.fromkeys((first.method, *best(result.compared(metric, first.reference))))
        methods = Markup(" or ").join(Markup("<b>{}</b>").format(titles[name]) for name in names)
        value = figure(first.value, first.low, first.high, first.unit).partition(" ")[0]
        texts.append(
            Markup("{} {}, {} {}").format(result.title(metric), methods, value, first.unit)
        )
    return Markup(" · ").join(texts)


def limits(result: Result) -> list[str]:
    """Say how large the reference's own error is, how much of the surface is seen, whether there
    are too few captures for a test, and whether times are disturbed."""
    texts = []
    for metric in chosen("limits"):
        lines = main_lines(result, [metric])
        if len(lines):
            unit = lines.unit.iloc[0]
            ends = (figure(end, unit=unit) for end in lines.value.agg(["min", "max"]))
            texts.append(f"{result.title(metric)} {'–'.join(dict.fromkeys(ends))} {unit}")
    if (count := len(result.scored())) < FEWEST:
        texts.append(note(count))
    if result.busy():
        texts.append("other programs ran meanwhile, so the times are too long")
    return texts


def _order_of_paper(result: Result) -> str:
    """Say whether the methods have the order of the paper by MAE; "" without two of its figures."""
    lines = main_lines(result, [HEADLINE])
    known = lines[lines.paper.notna()].sort_values("value")
    if len(known) < 2:
        return ""
    titles = result.about.method_titles
    exchanged = [
        f"{titles[a.method]} before {titles[b.method]}"
        for a, b in combinations(each(known), 2)
        if a.paper > b.paper
    ]
    but = f", but for {' and '.join(exchanged)}" if exchanged else ""
    return f"by {result.title(HEADLINE)}, the methods are in the paper's order{but}"


def capture_table(result: Result, capture: CaptureFacts) -> Table | None:
    """Return the table of one capture: those of the main metrics that it has, of every method. None
    if it has no figures, because its reference failed or all methods did."""
    scores = result.scores
    lines = scores[(scores.capture == capture.name) & scores.metric.isin(chosen("summary"))]
    lines = lines[(lines.treatment == "") & (lines.frame == 0)]
    drawn = drawn_references([capture])[:1]
    lines = lines[lines.reference.isin(drawn)].dropna(subset="value")
    if lines.empty:
        return None
    units = {key: metric.unit for key, metric in result.about.metrics.items()}
    lines = lines.assign(low=math.nan, high=math.nan, unit=lines.metric.map(units))
    return figures(result, lines, stars=False)  # the tests are on all captures

"""`handbench design`: how many hands show a difference between methods, and which tones tell a depth best."""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING

import numpy as np

from handbench.cli.options import free
from handbench.support.errors import HandbenchError

if TYPE_CHECKING:
    import pandas as pd

    from handbench.bench.evaluation.statistics.sample_size import Components
    from handbench.bench.results import Result

GRID = 128  # tones of a band that is designed for: those of the paper's sweep
FREQUENCIES = {"GHz": 1e9, "MHz": 1e6}
UNSURE = 5  # captures: with fewer, the answer is hardly more than its order of magnitude


def run(options: argparse.Namespace) -> None:
    """Every pair of a result's methods: the hands that show the effect, shown; and written where -o asks for it. With
    --tones instead: sets of tones."""
    if options.tones is not None:
        return _tones(options)
    from handbench.bench.evaluation.metrics import AVERAGED, METRICS
    from handbench.bench.evaluation.statistics.sample_size import components, design
    from handbench.bench.results import load
    from handbench.bench.results.tables import DESIGN, write
    from handbench.bench.studies.tradeoff.answer import LENGTHS, quantity
    from handbench.support.config import suggest

    if options.result is None or options.effect is None:
        raise HandbenchError(
            "design: expected a result folder and an effect, as in RESULT --effect 0.2mm; or --tones 5"
        )
    if options.metric not in (*AVERAGED, "aurc_mm"):
        known = suggest(options.metric, list(AVERAGED))
        raise HandbenchError(f"--metric: '{options.metric}' is no figure of single captures; {known}")
    metric = METRICS[options.metric]
    effect = quantity(options.effect, LENGTHS if metric.unit == "mm" else {metric.unit: 1.0}, "--effect")
    if not 0.05 < options.power < 1:
        raise HandbenchError(f"--power: is {options.power:g}; expected more than 0.05 and less than 1, as 0.8")
    if options.out is not None:
        free(options.out, options.overwrite)
    result = load(options.result)
    reference, figures, said = _figures(result, metric.key, options.treatment)
    try:
        parts = components(np.stack(list(figures.values()), axis=1))
        pairs = design(figures, effect, options.power)
    except HandbenchError as error:
        raise HandbenchError(f"{options.result}: {error}; run more hands") from None
    if options.out is not None:
        write(options.out, pairs, DESIGN)
    titles = {method.name: method.title for method in result.about.methods}
    about = f"{metric.title} against {reference}, {said}, {parts.captures} hands; differences in {metric.unit}"
    question = f"Hands that show {effect:g} {metric.unit} with a power of {100 * options.power:g} %"
    show(pairs, parts, titles, about, question)


def _tones(options: argparse.Namespace) -> None:
    """The most accurate sets of tones that wrap seldom enough, shown beside the ladder of `nfsk`."""
    from handbench.bench.studies.tradeoff.answer import LENGTHS, quantity
    from handbench.radar.methods.fsk_config import LadderConfig
    from handbench.radar.methods.tone_sets import best_sets, tone_set
    from handbench.reports.tables.result_tables import terminal_table, wide_console

    if options.result is not None or options.out is not None or options.effect is not None:
        raise HandbenchError("design: --tones stands alone; leave out RESULT, --effect and -o")
    ends = options.band.split(",")
    if len(ends) != 2:
        raise HandbenchError(f"--band: is '{options.band}'; expected two frequencies, as 72GHz,82GHz")
    low_hz, high_hz = sorted(quantity(end, FREQUENCIES, "--band") for end in ends)
    pair_hz = 0.0 if options.pair == "0" else quantity(options.pair, FREQUENCIES, "--pair")
    reach_m = 1e-3 * quantity(options.reach, LENGTHS, "--reach")
    if not 0 < options.noise <= 1 or not 1e-4 <= options.wraps < 1 or low_hz == high_hz or pair_hz >= high_hz - low_hz:
        raise HandbenchError(
            "design: expected --noise above 0 to 1 rad, --wraps 1e-4 to 1, and a band wider than --pair"
        )
    band_hz = np.linspace(low_hz, high_hz, GRID)
    sets = best_sets(options.tones, band_hz, pair_hz, options.noise, reach_m, options.wraps)
    if not sets:
        raise HandbenchError(f"--tones: no set of {options.tones} wraps in {options.wraps:g} or less; allow one more")
    ladder = tone_set(np.array(LadderConfig().tones_hz), options.noise, reach_m, options.wraps)
    lines: list[tuple[str, ...]] = [
        (
            about,
            ", ".join(f"{f / 1e9:.4g}" for f in each.tones_hz),
            f"{1e3 * each.bound_m:.3f}",
            f"{100 * each.wraps:.2f}",
        )
        for about, each in [*((f"{i}", each) for i, each in enumerate(sets, start=1)), ("ladder of nfsk", ladder)]
    ]
    heading = f"Sets of {options.tones} tones at a phase noise of {options.noise:g} rad, within ±{1e3 * reach_m:g} mm"
    wide_console().print(terminal_table(heading, ("", "tones GHz", "σ of the bound mm", "wraps %"), lines))


def _figures(result: Result, metric: str, treatment: str) -> tuple[str, dict[str, np.ndarray], str]:
    """The reference, method → the metric of its captures [n], and the treatment in words."""
    from handbench.bench.evaluation.statistics.compare_results import figures_of
    from handbench.bench.results import REFERENCES

    lines = result.captures[(result.captures.metric == metric) & (result.captures.treatment == treatment)]
    if len(lines):
        found = {str(method): group.value.to_numpy() for method, group in lines.groupby("method", sort=False)}
        return lines.reference.iloc[0], found, {"none": "unsmoothed", "window": "all averaged alike"}[treatment]
    reference = next((r for r in REFERENCES if all(r in c.references for c in result.scored())), None)
    if reference is None:
        raise HandbenchError(f"{result.folder}: has no reference that all of its captures share")
    return reference, figures_of(result, metric, reference), "each method as it is"


def show(pairs: pd.DataFrame, parts: Components, titles: dict[str, str], about: str, question: str) -> None:
    """Print the table of `design` with what it stands on."""
    from handbench.bench.results.tables import DESIGN, each
    from handbench.reports.tables.result_tables import terminal_table, wide_console

    columns = [column for column in DESIGN.columns if column.heading]
    lines = []
    for line in each(pairs):
        cells = {c.name: c.cell(getattr(line, c.name)) or "> 100 000" for c in DESIGN.columns if c.kind is float}
        cells["needed"] += f" [{cells['needed_low']}, {cells['needed_high']}]"
        lines.append((f"{titles[line.b]} − {titles[line.a]}", *(cells[column.name] for column in columns)))
    console = wide_console()
    console.print(terminal_table(question, ("", *(column.heading for column in columns)), lines))
    for text in (
        f"{about}. Standard deviations over all methods: {parts.capture:.2g} between hands, {parts.interaction:.2g} of "
        "a method's own on a hand (with the scatter of its repeats, which a result does not have)",
        "hands: each imaged by both methods (paired t, 5 %, two-sided), in brackets for the ends of the spread's 95 % "
        "interval; all pairs: after Holm, at its hardest step; other hands: Welch; shown by now: the smallest effect "
        "that the hands at hand show. handbench tests 5 hands or more.",
    ):
        console.print(text, markup=False)
    if parts.captures < UNSURE:
        console.print(f"{parts.captures} hands: the spread itself is uncertain, see the brackets", markup=False)

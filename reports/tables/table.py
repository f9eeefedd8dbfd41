"""A table of texts, and the tables of a result: its figures beside the paper's, and its tests."""

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pandas as pd

from handbench.bench.evaluation.front import figures as front_figures
from handbench.bench.evaluation.front import front, ranked
from handbench.bench.evaluation.metrics import METRICS, chosen
from handbench.bench.evaluation.scoring_protocols import REFERENCES
from handbench.bench.evaluation.tables import LEVEL, each
from handbench.bench.results.about import TREATMENTS, on_common_pixels
from handbench.bench.results.derived import few_pixels
from handbench.bench.results.result_folder import Result, best
from handbench.reports.tables.rounding import NONE, figure, is_known, number, p_text, paper, stacked

AGAINST = {
    "photogrammetry": "against photogrammetry",
    "completed": "against photogrammetry, completed by the true surface",
    "truth": "against the true surface",
}
PAIRS = (
    ("3fsk", "2fsk"),
    ("3fsk", "broadband"),
    ("nfsk-plus", "broadband"),
    ("broadband", "narrowband"),
)


@dataclass(frozen=True)
class Table:
    """A table of texts, as every writer prints it.
    texts: formatted cells, with the titles of the rows in the index and the headings in the
    columns; the first line of a cell or title is the figure or name, further lines are small print.
    best: highlighted cells, bool, of the same shape (None: no cell). left: number of columns with
    text, aligned left, before those with numbers."""

    caption: str
    texts: pd.DataFrame
    best: pd.DataFrame | None = None
    left: int = 0

    @property
    def headings(self) -> list[str]:
        """The headings of the columns, that of the row titles first."""
        return [str(self.texts.index.name or ""), *map(str, self.texts.columns)]

    def rows(self) -> Iterator[list[tuple[str, bool]]]:
        """Yield the cells of each row, its title first, as pairs (text, is it highlighted)."""
        stars = np.zeros(self.texts.shape, bool) if self.best is None else self.best.to_numpy()
        for title, texts, highlighted in zip(
            self.texts.index, self.texts.to_numpy(), stars.tolist(), strict=True
        ):
            yield [(title, False), *zip(texts, highlighted, strict=True)]

    @property
    def turned(self) -> "Table":
        """The table with rows and columns exchanged."""
        return replace(self, texts=self.texts.T, best=None if self.best is None else self.best.T)


def main_reference(result: Result) -> str:
    """Return the reference of the main figures: the first of REFERENCES that the result has, or ""
    without one."""
    scored = set(result.table.reference)
    return next((reference for reference in REFERENCES if reference in scored), "")


def beside_paper(result: Result) -> bool:
    """Tell whether a result has the paper's figures next to its own."""
    return bool(result.table.paper.notna().any())


def figures(
    result: Result,
    metrics: Iterable[str],
    reference: str,
    treatment: str = "",
    methods: Iterable[str] | None = None,
    ratios: bool = False,
) -> Table:
    """Return the figures of methods (default: all): a row for each method, a column for each metric
    that has figures. Below a figure are its interval and the paper's figure; the methods with the
    best figure, by a test, are highlighted.
    treatment: an equal treatment, for which the reference is that of `Result.equal`, or "" for
    methods with their own settings; ratios: whether our figure divided by the paper's is added."""
    names = list(result.about.method_titles if methods is None else methods)
    table = result.equal if treatment else result.table
    chosen_lines = table[
        table.treatment == treatment if treatment else table.reference == reference
    ]
    texts, stars = {}, {}
    for metric in metrics:
        lines = chosen_lines[(chosen_lines.metric == metric) & chosen_lines.value.notna()]
        if lines.empty:
            continue
        first: Any = next(each(lines))
        words = f"{on_common_pixels(metric)}, {TREATMENTS[treatment]}" if treatment else ""
        heading = f"{result.title(metric)}{words} ({first.unit})"
        cells = {line.method: cell(line, ratios) for line in each(lines)}
        highlighted = outstanding(result, metric, first.reference, treatment)
        texts[heading] = [cells.get(name, NONE) for name in names]
        stars[heading] = [name in highlighted for name in names]
    titles = pd.Index([result.about.method_titles.get(name, name) for name in names], name="method")
    caption = (
        f"Under equal treatment {AGAINST[result.equal.reference.iloc[0]]}"
        if treatment
        else f"Scored {AGAINST[reference]}"
    )
    return Table(caption, pd.DataFrame(texts, titles), pd.DataFrame(stars, titles))


def cell(line: Any, ratios: bool = False) -> str:
    """Return a figure, in further lines its interval, the paper's figure and, if asked for, the
    ratio of both. A ratio of percentages near 100 says nothing and is left out.
    line: with value, low, high, unit and, except under equal treatment, paper."""
    lines = [stacked(line.value, line.low, line.high, line.unit)]
    if is_known(theirs := getattr(line, "paper", None)):
        lines.append(f"paper {paper(theirs, line.unit)}")
        if ratios and theirs and line.unit != "%":
            lines.append(f"ratio {number(line.value / theirs, 2)}")
    return "\n".join(lines)


def outstanding(result: Result, metric: str, reference: str, treatment: str = "") -> frozenset[str]:
    """Return the ids of the methods to highlight for a metric: the one with the best figure and all
    that are not significantly worse.
    Empty if nothing was tested, or if no method is significantly worse. treatment: an equal
    treatment (same smoothing for all methods), or "" for methods with their own settings."""
    lines = result.compared(metric, reference, treatment)
    names = best(lines)
    return frozenset() if lines.worse.isin(names).all() else frozenset(names)


def beside(*tables: Table) -> Table:
    """Return tables with the same rows as one, with the caption of the first."""
    texts, stars = (
        pd.concat([getattr(table, part) for table in tables], axis=1) for part in ("texts", "best")
    )
    return replace(tables[0], texts=texts, best=stars)


def note(result: Result) -> str:
    """Return how the figures of a result are formed, and warnings on disturbed times and refined
    transforms."""
    refined = result.about.facts.get("refined_transforms", {})
    warnings = [f"The transform of {name} was {reason}." for name, reason in refined.items()]
    if busy := result.busy():
        titles = ", ".join(result.about.method_titles[name] for name in busy)
        warnings.append(
            f"The machine was busy: other work took up to {max(busy.values()):.1f} cores while "
            f"{titles} were timed; their times are too long."
        )
    return " ".join(
        (
            "Each figure is formed for each capture and then averaged, but for the pooled ones. "
            "Small print: its 95 % confidence interval, the paper's figure, and the ratio of ours "
            "to it. Highlighted: the best figure and all that are not shown to be worse (paired "
            "test on the same captures, 5 % for all pairs together).",
            *warnings,
        )
    )


def every_figure(result: Result) -> list[Table]:
    """Return a table for each reference surface of the result, with a row for each metric and a
    column for each method. The first is followed by a table under equal treatment (all depth maps
    without smoothing, or all with the same smoothing), if the result has it."""
    scored = set(result.table.reference)
    tables = [
        figures(result, result.about.metrics, reference, ratios=True)
        for reference in REFERENCES
        if reference in scored
    ]
    if not result.equal.empty:
        metrics = dict.fromkeys(result.equal.metric)
        equal = beside(*(figures(result, metrics, "", treatment) for treatment in TREATMENTS))
        few = few_pixels(result.scores, result.scored())
        tables.insert(1, replace(equal, caption="; ".join(filter(None, (equal.caption, few)))))
    return [table.turned for table in tables]


def of_paper(result: Result) -> Table | None:
    """Return the table of the paper: for each method and main metric of which it has figures, ours
    and in brackets the paper's. None if it has none."""
    reference, titles = main_reference(result), result.about.method_titles
    lines = result.table[
        (result.table.reference == reference) & result.table.metric.isin(chosen("main"))
    ]
    known = lines[lines.paper.notna()]
    if known.empty:
        return None
    rows: dict[str, dict[str, str]] = {}
    for line in each(lines[lines.metric.isin(known.metric) & lines.method.isin(known.method)]):
        ours = cell(line).partition("\n")[0]
        theirs = f" ({paper(line.paper, line.unit)})" if is_known(line.paper) else ""
        row = rows.setdefault(f"{result.title(line.metric)} ({line.unit})", {})
        row[titles[line.method]] = ours + theirs
    caption = f"Scored {AGAINST[reference]}: ours (the paper's)"
    return Table(caption, pd.DataFrame.from_dict(rows, orient="index").fillna(NONE))


def best_of_ours(result: Result, count: int) -> Table | None:
    """Return the main figures of those methods without figures of the paper that no other method
    beats in error, time and share seen: at most `count`, the most accurate first. None if there are
    none."""
    reference = main_reference(result)
    lines = result.table[result.table.reference == reference]
    unbeaten = front(ranked(front_figures(lines)))
    of_paper = unbeaten.index.isin(lines.method[lines.paper.notna()])
    names = unbeaten[~of_paper].nsmallest(count, "error").index
    texts = figures(result, chosen("summary"), reference, methods=names).texts
    return Table("", texts.rename_axis("our best")) if len(names) else None


def differences(result: Result) -> Table:
    """Return the tested differences between methods in words, with p-value and effect size."""
    lines = result.comparisons
    texts = {
        "against": lines.reference,
        "p": lines.p_corrected.map(p_text),
        "effect": lines.effect.map(lambda effect: number(effect, 2)),
        "captures": lines.n_captures.map(str),
    }
    caption = (
        f"{result.about.name}: which method is better, with 95 % confidence intervals, p corrected "
        "for all pairs of a metric (Holm), and the difference over the standard deviation of the "
        "paired differences (effect)"
    )
    return Table(caption, pd.DataFrame(texts).set_axis(lines.sentence.tolist()), left=1)


def main_pairs(result: Result) -> Table:
    """Return for each of the main pairs of methods (PAIRS) which one is better and by how much.
    Their errors are compared on common pixels, with all depth maps unsmoothed and all with the same
    smoothing. A pair that was not compared has no row."""
    titles, of = result.about.method_titles, result.comparisons
    treated = of[of.treatment != ""]
    rows: dict[str, dict[str, str]] = {}
    for pair in PAIRS:
        for line in each(treated[treated.better.isin(pair) & treated.worse.isin(pair)]):
            row = rows.setdefault(" and ".join(titles[name] for name in pair), {})
            row[TREATMENTS[line.treatment]] = _ahead(line, titles)
    caption = "Main pairs of methods, on the pixels that all see"
    if rows and treated.p_corrected.isna().all():
        caption += f" ({treated.n_captures.iloc[0]} captures: too few for a test)"
    texts = pd.DataFrame.from_dict(rows, orient="index").fillna(NONE)
    return Table(caption, texts.rename_axis("methods"), left=len(texts.columns))


def _ahead(line: Any, titles: dict[str, str]) -> str:
    places = 1 if line.difference >= 1 else 2
    amount = f"{number(line.difference, places)} {line.unit}"
    if not is_known(line.p_corrected):
        return f"{titles[line.better]} ahead by {amount}"
    if line.p_corrected < 1 - LEVEL:
        ends = f"[{number(line.low, places)}, {number(line.high, places)}]"
        return f"{titles[line.better]} better by {amount} {ends}"
    return f"no difference shown ({amount})"


def settings(metric: str, lines: pd.DataFrame, titles: Mapping[str, str]) -> Table:
    """Return the ranked settings of methods or of the ground truth: first the front, numbered as in
    its picture, then the others, each with the number of the one that beats it in brackets.
    metric: that of the error; titles: name → title (missing: the name itself)."""
    best_settings = front(lines)
    numbers = {name: str(i) for i, name in enumerate(best_settings.index, 1)}
    lines = pd.concat([best_settings, lines[~lines.on_front]])
    unit = METRICS[metric].unit
    texts = [
        {
            "front": numbers.get(name) or f"({numbers[line.dominated_by]})",
            f"{METRICS[metric].title} ({unit})": stacked(line.error, line.low, line.high, unit),
            "observed (%)": figure(line.observed_percent, unit="%"),
            "time (s)": stacked(line.seconds, line.seconds_low, line.seconds_high, "s"),
        }
        for name, line in lines.iterrows()
    ]
    index = pd.Index([titles.get(name, name) for name in lines.index], name="setting")
    caption = f"{METRICS[metric].title} against time; (n): beaten by setting n of the front"
    return Table(caption, pd.DataFrame(texts, index))


def csv_text(result: Result) -> str:
    """Return the main table of a result as CSV, with the ratio of our figure to the paper's."""
    ratio = result.table.value / result.table.paper
    return result.table.assign(ratio=ratio).to_csv(index=False, lineterminator="\n")

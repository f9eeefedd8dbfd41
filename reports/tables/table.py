"""A table of texts, and the tables of a result: its figures beside the paper's, and its tests."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pandas as pd

from handbench.bench.evaluation.front import SHARE, front, ranked
from handbench.bench.evaluation.front import figures as front_figures
from handbench.bench.evaluation.intervals import counted
from handbench.bench.evaluation.metrics import METRICS, TREATMENTS, Values, chosen, on_common_pixels
from handbench.bench.evaluation.tables import each
from handbench.bench.results.result_folder import Result, best
from handbench.reports.tables.rounding import (
    NONE,
    figure,
    is_known,
    number,
    p_text,
    paper,
    paper_places,
    stacked,
)

AGAINST = {
    "photogrammetry": "against photogrammetry",
    "completed": "against photogrammetry, completed by the true surface",
    "truth": "against the true surface",
}
STARS = "; ★: best, or not shown to be worse"
INTERVALS = "; below a figure its 95 % interval"
PAIRS = (  # the main ones
    {"3fsk", "2fsk"},
    {"3fsk", "broadband"},
    {"nfsk-plus", "broadband"},
    {"broadband", "narrowband"},
)


def note(result: Result) -> str:
    """Return a note on how the figures of a result's tables are formed, and on their small
    print."""
    papers = " and the paper's figure" if result.table.paper.notna().any() else ""
    return (
        "Each figure is formed for each capture and then averaged, but for the pooled ones. Small "
        f"print: its 95 % confidence interval{papers}."
    )


def against(result: Result, reference: str) -> str:
    """Return against what the figures of a reference are, such as "against the true surface", and
    on how many captures the reference was fitted to depth maps; "" for no reference."""
    captures = [capture for capture in result.about.captures if reference in capture.references]
    own = reference == "photogrammetry" and any(capture.own_mesh for capture in captures)
    text = "against mesh.ply" if own else AGAINST.get(reference, "")
    fitted = result.about.facts.get("refined_transforms", ())
    if reference != "truth" and (count := sum(capture.name in fitted for capture in captures)):
        text += f", fitted to the depth maps of {counted(count)}"
    return text


@dataclass(frozen=True)
class Table:
    """A table of texts, as every writer prints it.
    texts: formatted cells, with the titles of the rows in the index and the headings in the
    columns; the first line of a cell or title is the figure or name, further lines are small print.
    left: number of columns with text, aligned left, before those with numbers."""

    caption: str
    texts: pd.DataFrame
    left: int = 0

    @property
    def headings(self) -> list[str]:
        """The headings of the columns, that of the row titles first."""
        return [str(self.texts.index.name or ""), *map(str, self.texts.columns)]

    @property
    def rows(self) -> list[tuple[str, ...]]:
        """The cells of each row, its title first."""
        return list(self.texts.itertuples(name=None))

    @property
    def turned(self) -> "Table":
        """The table with rows and columns exchanged."""
        return replace(self, texts=self.texts.T)


def main_lines(result: Result, metrics: Iterable[str] = METRICS) -> pd.DataFrame:
    """Return the lines of the result's table with figures of some metrics against the main
    reference, the first one."""
    reference = next(iter(result.table.reference), "")
    lines = result.table[result.table.reference == reference].dropna(subset="value")
    return lines[lines.metric.isin(list(metrics))]


def figures(result: Result, lines: pd.DataFrame, stars: bool = True) -> Table:
    """Return figures as a table with a row for each method and a column for each metric and
    treatment. Below a figure are its interval and the paper's figure. A star marks the best of
    the tested figures and all that are not shown to be worse, unless all are.
    lines: of the result's table or of `Result.equal`, each metric against one reference, which the
    heading says if it is not that of the first. stars: False for figures that were not tested."""
    main = next(iter(lines.reference), "")
    texts: dict[str, dict[str, str]] = {}
    starred: list[str] = []
    lines = lines.dropna(subset="value")
    treatments = lines.get("treatment", pd.Series("", lines.index)).fillna("")
    metrics = pd.Categorical(lines.metric, list(METRICS))
    groups: dict[Any, pd.DataFrame] = dict(
        iter(lines.groupby([metrics, treatments], observed=True))
    )
    for (metric, treatment), of_metric in groups.items():
        words = f"{on_common_pixels(metric)}, {TREATMENTS[treatment]}" if treatment else ""
        if (reference := of_metric.reference.iloc[0]) != main:
            words += f", {against(result, reference)}"
        heading = f"{result.title(metric)}{words} ({of_metric.unit.iloc[0]})"
        tests = result.compared(metric, reference, treatment)
        names = best(tests)
        if not stars or tests.worse.isin(names).all():
            names = []
        starred += names
        texts[heading] = {
            line.method: "★ " * (line.method in names) + _cell(line) for line in each(of_metric)
        }
    titles = pd.DataFrame(texts).fillna(NONE).rename(result.about.method_titles)
    caption = against(result, main).capitalize()
    caption += INTERVALS * bool(lines.low.notna().any()) + STARS * bool(starred)
    return Table(caption, titles.rename_axis("method"))


def _cell(line: Any) -> str:
    """Return a figure, in further lines its interval and the paper's figure.
    line: with value, low, high, unit and, except under equal treatment, paper."""
    theirs = getattr(line, "paper", None)
    # percentages are all as the paper's, of which one has two decimals
    places = paper_places(line.unit) if METRICS[line.metric].paper and line.unit == "%" else None
    text = stacked(line.value, line.low, line.high, line.unit, places)
    return f"{text}\npaper {paper(theirs, line.unit)}" if is_known(theirs) else text


def of_values(caption: str, values: Mapping[str, Values]) -> Table:
    """Return figures without intervals as a table with a row for each name, a method for instance,
    and a column for each metric.
    values: name → metric → figure."""
    texts = {
        name: {
            f"{METRICS[key].title} ({METRICS[key].unit})": figure(value, unit=METRICS[key].unit)
            for key, value in of_one.items()
        }
        for name, of_one in values.items()
    }
    return Table(caption, pd.DataFrame.from_dict(texts, orient="index"))


def every_figure(result: Result) -> list[Table]:
    """Return a table for each reference surface of the result, with a row for each metric and a
    column for each method, and one of the methods under equal treatment, if the result has it."""
    own = [lines for _, lines in result.table.groupby("reference", sort=False)]
    return [figures(result, lines).turned for lines in (*own, result.equal) if len(lines)]


def of_paper(result: Result) -> Table | None:
    """Return the table of the paper: for each main metric and method of which it has figures, ours
    and in brackets the paper's, with the paper's digits. None if it has none."""
    lines = main_lines(result, chosen("main"))
    known = lines[lines.paper.notna()]
    if known.empty:
        return None
    lines = lines[lines.metric.isin(known.metric) & lines.method.isin(known.method)]
    texts: dict[str, dict[str, str]] = {}
    for line in each(lines):
        theirs = f" ({paper(line.paper, line.unit)})" if is_known(line.paper) else ""
        row = texts.setdefault(f"{result.title(line.metric)} ({line.unit})", {})
        row[result.about.method_titles[line.method]] = paper(line.value, line.unit) + theirs
    caption = f"A{against(result, lines.reference.iloc[0])[1:]}: ours (paper)"
    table = pd.DataFrame.from_dict(texts, orient="index").fillna(NONE)
    return Table(caption, table)


def best_of_ours(result: Result, count: int) -> Table | None:
    """Return the main figures of those methods without figures of the paper that no other method
    beats in error, time and completeness: at most `count`, the most accurate. None if there are
    none."""
    lines = main_lines(result)
    measured = front_figures(lines)
    theirs = measured.index.isin(lines.method[lines.paper.notna()])
    if theirs.all():
        return None
    unbeaten = ranked(measured)[~theirs].query("on_front")
    names = unbeaten.nsmallest(count, "error").index
    shown = lines[lines.metric.isin(chosen("summary")) & lines.method.isin(names)]
    table = figures(result, shown, stars=False)
    return Table("", table.texts.rename_axis("our best")) if len(names) else None


def differences(result: Result, main: bool = False) -> Table:
    """Return the tested differences between methods in words, with p-value and effect size.
    main: only those between the main pairs under equal treatment, which are PAIRS and each method
    from outside handbench with 3-FSK; all if there are none."""
    lines = result.comparisons
    if main:
        foreign = [{"3fsk", of.name} for of in result.about.methods if of.foreign]
        of_pairs = [{line.better, line.worse} in (*PAIRS, *foreign) for line in each(lines)]
        shown = np.array(of_pairs) & (lines.treatment != "")
        lines = lines[shown] if shown.any() else lines
    texts = {
        "against": lines.reference,
        "p": lines.p_corrected.map(p_text),
        "effect": lines.effect.map(lambda effect: number(effect, 2)),
    }
    caption = (
        f"{'Main' if main else 'All'} pairs of methods on {counted(len(result.scored()))}; p is "
        "corrected for all pairs of a metric (Holm), effect: the difference over the standard "
        "deviation of the paired differences"
    )
    return Table(caption, pd.DataFrame(texts).set_axis(lines.sentence.tolist()), left=1)


def settings(result: Result, metric: str, lines: pd.DataFrame, titles: Mapping[str, str]) -> Table:
    """Return the ranked settings of methods or of the ground truth: first the front, numbered as in
    its picture, then the others, each with the number of the one that beats it in brackets.
    metric: that of the error; titles: name → title (missing: the name itself)."""
    unbeaten = front(lines)
    numbers = {name: str(number) for number, name in enumerate(unbeaten.index, 1)}
    unit, title = METRICS[metric].unit, METRICS[metric].title
    texts = {
        name: {
            "front": numbers.get(name) or f"({numbers[line.dominated_by]})",
            f"{title} ({unit})": stacked(line.error, line.low, line.high, unit),
            f"{METRICS[SHARE[metric]].title} (%)": figure(line.share_percent, unit="%"),
            "time (s)": stacked(line.seconds, line.seconds_low, line.seconds_high, "s"),
        }
        for name, line in pd.concat([unbeaten, lines[~lines.on_front]]).iterrows()
    }
    cells = pd.DataFrame.from_dict(texts, orient="index").rename(titles).rename_axis("setting")
    reference = against(result, next(iter(lines.reference)))
    return Table(f"{title} {reference} over time; (n): beaten by setting n of the front", cells)

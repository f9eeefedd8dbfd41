"""The top of a report: what the figures say in three lines, the table of the methods' main figures,
and a small table of each capture."""

from dataclasses import dataclass
from itertools import combinations
from typing import Any

import pandas as pd
from markupsafe import Markup

from handbench.bench.evaluation.metrics import HEADLINE, chosen
from handbench.bench.evaluation.scoring_protocols import REFERENCES
from handbench.bench.evaluation.tables import each
from handbench.bench.results.about import TREATMENTS, CaptureFacts, MethodFacts, on_common_pixels
from handbench.bench.results.derived import few_pixels
from handbench.bench.results.result_folder import Result, best
from handbench.reports.figures.references import drawn_references
from handbench.reports.page.sections import Grid
from handbench.reports.tables.blocks import interval, rounded
from handbench.reports.tables.rounding import NONE, decimals, figure, is_known, number, paper
from handbench.reports.tables.table import AGAINST, outstanding

SMOOTHED = "window"  # the equal treatment in the main table


@dataclass(frozen=True)
class Cell:
    """A figure of the main table: its text, small print below it (interval, paper, share), and
    whether it is highlighted."""

    text: str
    below: tuple[str, ...] = ()
    best: bool = False


@dataclass(frozen=True)
class MainTable:
    """The main figures of all methods against one reference: headings of the columns, and for each
    method its title, its tones and its cells."""

    headings: tuple[str, ...]
    rows: tuple[tuple[str, str, tuple[Cell, ...]], ...]
    note: str


def main_reference(result: Result) -> str:
    """Return the reference of the main table: the first of REFERENCES that the result has, or ""
    without one."""
    scored = set(result.table.reference)
    return next((reference for reference in REFERENCES if reference in scored), "")


def columns(result: Result) -> dict[tuple[str, str], pd.DataFrame]:
    """Return the figures of the main table: (metric, treatment) → lines with value, low, high, unit
    and paper, indexed by method. A column without figures is left out."""
    of_reference = result.table[result.table.reference == main_reference(result)]
    own = [(metric, "") for metric in chosen("summary")]
    found = {}
    for metric, treatment in (*own[:1], (HEADLINE, SMOOTHED), *own[1:]):
        lines = of_reference
        if treatment:
            lines = result.equal[result.equal.treatment == treatment].assign(paper=float("nan"))
        lines = lines[(lines.metric == metric) & lines.value.notna()]
        if len(lines):
            found[metric, treatment] = lines.drop_duplicates("method").set_index("method")
    return found


def main_table(result: Result) -> MainTable:
    """Return the main figures of all methods against the first reference, a line for each method,
    with their intervals and, where the paper reports one, its figure."""
    found, reference = columns(result), main_reference(result)
    headings = [f"{_title(result, *key)} ({lines.unit.iloc[0]})" for key, lines in found.items()]
    stars = {
        (metric, treatment): outstanding(
            result, metric, lines.reference.iloc[0] if treatment else reference, treatment
        )
        for (metric, treatment), lines in found.items()
    }
    rows = [
        (
            method.title,
            tones_text(method),
            tuple(
                _cell(lines, method.name, method.name in stars[key]) for key, lines in found.items()
            ),
        )
        for method in result.about.methods
    ]
    text = f"Scored {AGAINST.get(reference, '')}, each method on the pixels that it sees."
    if (HEADLINE, SMOOTHED) in found:
        text += f" On common pixels: those that all methods see, {TREATMENTS[SMOOTHED]}."
    if any(stars.values()):
        text += (
            " ★: no other method is shown to be better, and some are shown to be worse (paired "
            "test on the same captures, 5 % for all pairs together)."
        )
    return MainTable(tuple(headings), tuple(rows), text)


def tones_text(method: MethodFacts) -> str:
    """Return the tones of a method as text, such as "82, 79.5 GHz" or "128 tones, 72 to 82 GHz"; ""
    if its settings name none. Settings of captures that differ are all named."""
    texts = []
    for config in method.config.values():
        given = config.items() if isinstance(config, dict) else ()
        named = [value for key, value in given if key.endswith("_hz")]
        flat = [v for of in named for v in (of if isinstance(of, list) else [of])]
        hz = [v for v in flat if isinstance(v, int | float)]
        ghz = list(dict.fromkeys(f"{v / 1e9:g}" for v in sorted(hz, reverse=True)))
        if ghz and "count" in config:
            texts.append(f"{config['count']} tones, {ghz[-1]} to {ghz[0]} GHz")
        elif ghz:
            texts.append(f"{', '.join(ghz)} GHz")
    return "; ".join(dict.fromkeys(texts))


def _title(result: Result, metric: str, treatment: str) -> str:
    return result.title(metric) + (on_common_pixels(metric) if treatment else "")


def _cell(lines: pd.DataFrame, method: str, best: bool) -> Cell:
    if method not in lines.index:
        return Cell(NONE)
    line: Any = lines.loc[method]
    places = decimals(line.value, line.low, line.high, line.unit)
    below = [interval(line.low, line.high, places)]
    if is_known(line.paper):
        below.append(f"paper {paper(line.paper, line.unit)}")
    return Cell(number(line.value, places), tuple(filter(None, below)), best)


def leads(result: Result) -> list[tuple[str, str]]:
    """Return the lines on top of a report, as pairs (heading, text): which method is best at what,
    and what limits the figures. Without figures there is none."""
    lines = (
        ("Best", _best(result)),
        ("Limits", _limits(result)),
        ("Paper", _order_of_paper(result)),
    )
    return [(heading, text) for heading, text in lines if text]


def _best(result: Result) -> str:
    """Say which method has the best figure of each column of the main table, and whether a test
    shows it."""
    titles = result.about.method_titles
    reference, texts = main_reference(result), []
    for (metric, treatment), lines in columns(result).items():
        higher = result.about.metrics[metric].better == "higher"
        first = str(lines.value.idxmax() if higher else lines.value.idxmin())
        line: Any = lines.loc[first]
        value = figure(line.value, line.low, line.high, line.unit)
        amount = value.replace(" [", f" {line.unit} [") if "[" in value else f"{value} {line.unit}"
        tested = best(result.compared(metric, line.reference or reference, treatment))
        equals = [titles[name] for name in tested if name != first]
        more = f", not shown to be better than {', '.join(equals)}" if equals else ""
        who = Markup("<b>{}</b>, ").format(titles[first]) if len(titles) > 1 else Markup()
        title = _title(result, metric, treatment)
        texts.append(Markup("{}: {}{}{}").format(title, who, amount, more))
    count = len(result.scored())
    captures = "1 capture" if count == 1 else f"{count} captures"
    few = f" {captures}: no test." if result.comparisons.p_corrected.isna().all() else ""
    return Markup("; ").join(texts) + f".{few}" if texts else ""


def _limits(result: Result) -> str:
    """Say how large the reference's own error is beside the smallest MAE, how much of the surface
    is seen, how far noise moves a depth, and which times are disturbed."""
    reference, found = main_reference(result), columns(result)
    table = result.table[result.table.reference == reference]
    floors, seen = (
        table.value[table.metric == metric].dropna() for metric in ("floor_mm", "observed_percent")
    )
    texts = []
    if len(floors) and (HEADLINE, "") in found:
        share = 100 * floors.max() / found[HEADLINE, ""].value.min()
        texts.append(
            f"{reference} itself errs by {floors.max():.2g} mm, "
            f"{share:.0f} % of the smallest MAE (floor)"
            if floors.max() > 0
            else "the reference is the exact surface (no floor)"
        )
    if len(seen):
        texts.append(f"of the surface {_range(seen, '%')} is seen, and only that is scored")
    if ("precision_mm", "") in found:
        spread = _range(found["precision_mm", ""].value, "mm")
        texts.append(f"noise moves a depth by {spread} from repeat to repeat")
    if few := few_pixels(result.scores, result.scored()):
        texts.append(few)
    if result.busy():
        texts.append("the machine was busy, so times are uncertain")
    text = "; ".join(texts)
    return f"{text[0].upper()}{text[1:]}." if text else ""


def _range(values: pd.Series, unit: str) -> str:
    low, high = (number(v, 1) if unit == "%" else rounded(v) for v in (min(values), max(values)))
    return f"{low} {unit}" if low == high else f"{low} to {high} {unit}"


def _order_of_paper(result: Result) -> str:
    """Say whether the methods have the order of the paper by MAE; "" without two of its figures."""
    found = columns(result).get((HEADLINE, ""), pd.DataFrame(columns=["value", "paper"]))
    known = found[found.paper.notna()].sort_values("value")
    if len(known) < 2:
        return ""
    titles = result.about.method_titles
    reversed_ = [
        f"{titles[a.method]} before {titles[b.method]} (here {a.value:.2f} and {b.value:.2f} mm, "
        f"in the paper {paper(a.paper, 'mm')} and {paper(b.paper, 'mm')} mm)"
        for a, b in combinations(each(known.reset_index()), 2)
        if a.paper > b.paper
    ]
    if not reversed_:
        return "By MAE, the methods are in the order of the paper."
    return f"By MAE, the methods are in the order of the paper but for {'; '.join(reversed_)}."


def front(result: Result) -> list[str]:
    """Return the titles of the methods that no other beats in both MAE and time, the fastest
    first."""
    found = columns(result)
    if not {(HEADLINE, ""), ("seconds", "")} <= set(found):
        return []
    titles = result.about.method_titles
    both = pd.DataFrame(
        {"mm": found[HEADLINE, ""].value, "seconds": found["seconds", ""].value}
    ).dropna()
    both = both.sort_values(["seconds", "mm"])
    return [
        titles[str(name)] for name in both.index[both.mm < both.mm.cummin().shift(fill_value=1e9)]
    ]


def hardest(result: Result) -> tuple[str, str] | None:
    """Return the capture with the largest MAE, averaged over the methods, and this MAE as text;
    None if there are fewer than two captures."""
    reference = main_reference(result)
    lines = _of_first_frame(result.scores)
    lines = lines[(lines.metric == HEADLINE) & (lines.reference == reference)]
    means = lines.groupby("capture").value.mean().dropna()
    if len(means) < 2:
        return None
    return str(means.idxmax()), f"{rounded(means.max())} mm"


def capture_grid(result: Result, capture: CaptureFacts) -> Grid | None:
    """Return the table of one capture: those of the main metrics that it has, of every method. None
    if it has no figures."""
    reference = next(iter(drawn_references([capture])), "")
    lines = _of_first_frame(result.scores)
    lines = lines[(lines.capture == capture.name) & (lines.reference == reference)]
    metrics = [metric for metric in chosen("summary") if metric in set(lines.metric)]
    if not metrics:
        return None
    values = lines.pivot(index="method", columns="metric", values="value")
    rows = [
        (method.title, *(_score(result, metric, values[metric][method.name]) for metric in metrics))
        for method in result.about.methods
        if method.name in values.index
    ]
    heads = (f"{result.title(metric)} ({_unit(result, metric)})" for metric in metrics)
    return Grid(f"{AGAINST[reference].capitalize()}", ("method", *heads), tuple(rows))


def _of_first_frame(scores: pd.DataFrame) -> pd.DataFrame:
    return scores[(scores.treatment == "") & (scores.frame == 0)]


def _unit(result: Result, metric: str) -> str:
    return result.about.metrics[metric].unit


def _score(result: Result, metric: str, value: float) -> str:
    return number(value, 1) if _unit(result, metric) == "%" else rounded(value)

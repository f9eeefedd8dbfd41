"""What every table is made of: the figures of a result in blocks of lines, ready to read."""

from __future__ import annotations

import math
from dataclasses import dataclass

from bench.results import REFERENCES, Result, Row

HEADINGS = {
    "photogrammetry": "Scored against photogrammetry, as the paper does",
    "truth": "Scored against the true surface (the paper's figures are against photogrammetry)",
}
NAMED = 12  # captures; more are counted
NONE = "–"


@dataclass(frozen=True)
class Line:
    """One line of a block. title: with the unit, empty where the metric goes on; source: whose figures; cells: one a
    method; best: whether a cell stands out, one a method (empty: none does); unit: the metric's."""

    metric: str
    title: str
    source: str
    cells: tuple[str, ...]
    best: tuple[bool, ...] = ()
    unit: str = ""


@dataclass(frozen=True)
class Block:
    """The figures against one reference; methods: the titles of the columns."""

    reference: str
    heading: str
    methods: tuple[str, ...]
    lines: tuple[Line, ...]


def blocks(result: Result) -> list[Block]:
    """One block for each reference that the result was scored against."""
    scored = {row.reference for row in result.rows}
    return [_block(result, reference) for reference in REFERENCES if reference in scored]


def _block(result: Result, reference: str) -> Block:
    lines: list[Line] = []
    for metric, facts in result.about.metrics.items():
        rows = [result.row(metric, method.name, reference) for method in result.about.methods]
        if any(rows):
            lines += _lines(metric, f"{facts.title} ({facts.unit})", rows, outstanding(result, metric, reference))
    titles = tuple(method.title for method in result.about.methods)
    return Block(reference, HEADINGS[reference], titles, tuple(lines))


def _lines(metric: str, title: str, rows: list[Row | None], stars: frozenset[str]) -> list[Line]:
    unit = next(row.unit for row in rows if row)
    best = tuple(row is not None and row.method in stars for row in rows) if stars else ()
    lines = [Line(metric, title, "ours", tuple(map(ours, rows)), best, unit)]
    published = [row for row in rows if row and row.paper is not None]
    if published:
        lines.append(Line(metric, "", "paper", tuple(map(paper, rows)), unit=unit))
    if published and unit != "%":  # a ratio of percentages near 100 says nothing
        lines.append(Line(metric, "", "ours / paper", tuple(number(ratio(row), 2) for row in rows)))
    return lines


def outstanding(result: Result, metric: str, reference: str) -> frozenset[str]:
    """The methods that no other is shown to beat, if any of those compared is beaten: no figure stands out without a
    test."""
    best = frozenset(result.best(metric, reference))
    lines = (c for c in result.comparisons if (c.metric, c.reference) == (metric, reference))
    return best if any(c.worse not in best for c in lines) else frozenset()


def ratio(row: Row | None) -> float | None:
    """Ours over the paper's; None without either."""
    if row is None or row.value is None or not row.paper:
        return None
    return row.value / row.paper


def ours(row: Row | None) -> str:
    """Our figure."""
    return NONE if row is None else figure(row.value, row.low, row.high, row.unit)


def figure(value: float | None, low: float | None, high: float | None, unit: str) -> str:
    """A figure with its interval in brackets."""
    if value is None:
        return NONE
    places = decimals(value, low, high, unit)
    return " ".join(filter(None, (number(value, places), interval(low, high, places))))


def paper(row: Row | None) -> str:
    """The paper's figure, as it prints it."""
    return NONE if row is None or row.paper is None else number(row.paper, 1 if row.unit == "mm" else 2)


def interval(low: float | None, high: float | None, places: int) -> str:
    """[low, high]; empty where an end is not known."""
    return "" if low is None or high is None else f"[{number(low, places)}, {number(high, places)}]"


def number(value: float | None, places: int) -> str:
    """A number with so many decimals and a true minus sign; a dash for None."""
    return NONE if value is None else f"{value:.{places}f}".replace("-", "−")


def decimals(value: float, low: float | None, high: float | None, unit: str) -> int:
    """Decimals worth showing: two digits of half the interval, three of the value at most; of millimetres one at least,
    as the paper prints; of percentages always two, for they crowd below 100."""
    if unit in ("%", "pixels"):
        return 2 if unit == "%" else 0
    places = three_digits(value)
    if low is not None and high is not None and high > low:
        places = min(places, _digits((high - low) / 2, 2))
    return max(places, 1) if unit == "mm" and value else places


def three_digits(value: float | None) -> int:
    """Decimals that show three significant digits, six at most."""
    return _digits(value, 3) if value else 0


def _digits(value: float, digits: int) -> int:
    return min(max(digits - 1 - math.floor(math.log10(abs(value))), 0), 6)


def p_text(p: float | None) -> str:
    """A p-value with two digits; what is smaller than 0.001 is said to be."""
    if p is None:
        return NONE
    return "< 0.001" if p < 0.001 else f"{p:.3f}" if p < 0.1 else f"{p:.2f}"


def caption(result: Result) -> str:
    """What the figures stand on, in one sentence."""
    names = [capture.name for capture in result.scored()]
    captures = ", ".join(names) if len(names) <= NAMED else f"{names[0]} to {names[-1]}, {len(names)} in all"
    floor = ""
    if any(row.metric == "floor_mm" for row in result.rows):  # results of earlier versions have none
        floor = (
            "ground-truth floor: the MAE that a perfect radar would show, because the reference errs itself, and where "
            "it would lie in 95 % of all draws of that error; "
        )
    refined = result.about.facts.get("refined_transforms", {})
    warning = "".join(f" The transform of {name} was {reason}." for name, reason in refined.items())
    return (
        f"Pixels pooled over the captures {captures}; in brackets the 95 % confidence interval; {floor}"
        f"time per frame on the machine named in the result.{warning}"
    )


def best_note(found: list[Block]) -> str:
    """What bold figures mean, with a blank before it; empty where none is bold."""
    if not any(any(line.best) for block in found for line in block.lines):
        return ""
    return (
        " Bold: the best figure and all that are not shown to be worse than it (paired test on the same captures, 5 % "
        "for all pairs together)."
    )


def floor_note(result: Result) -> str:
    """A sentence for the captions of pictures that show an MAE, with a blank before it: the floors that are known and
    not zero, the largest of the methods'. Empty without one."""
    floors = dict.fromkeys(REFERENCES, 0.0)
    for row in result.rows:
        if row.metric == "floor_mm" and row.reference in floors:
            floors[row.reference] = max(floors[row.reference], row.value or 0.0)
    known = ", ".join(f"{number(v, three_digits(v))} mm against {reference}" for reference, v in floors.items() if v)
    return f" Ground-truth floor, the MAE of a perfect radar: {known}." if known else ""

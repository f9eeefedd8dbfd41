"""One sentence for each claim that a reader of the table needs: two methods under equal treatment."""

from itertools import groupby
from typing import Any

from bench.results import HEADLINE, Result
from bench.results.about import TREATMENTS
from bench.results.tables import LEVEL, each
from reports.tables.blocks import known, number

PAIRS = (("3fsk", "2fsk"), ("3fsk", "broadband"), ("nfsk-plus", "broadband"), ("broadband", "narrowband"))
OVER = "aurc_mm"


def findings(result: Result) -> list[str]:
    """A sentence for each of PAIRS that the result compares under equal treatment."""
    return [sentence for pair in PAIRS if (sentence := _claim(result, *pair))]


def _claim(result: Result, first: str, second: str) -> str:
    lines = result.comparisons
    lines = lines[(lines.treatment != "") & (lines.better.isin((first, second)) & lines.worse.isin((first, second)))]
    if lines.empty:
        return ""
    titles = {method.name: method.title for method in result.about.methods}
    told = {(line.metric, line.treatment): _ahead(line, titles) for line in each(lines)}
    common = [told[key] for treatment in TREATMENTS if (key := (HEADLINE, treatment)) in told]
    over = [told[key] for treatment in TREATMENTS if (key := (OVER, treatment)) in told]
    untested = lines.p_corrected.isna().all()
    few = f" (on these {lines.n_captures.iloc[0]} captures, too few to tell of others)" if untested else ""
    said = [_joined(told) or "not compared" for told in (common, over)]
    between = f"{titles[first]} and {titles[second]}"
    return f"{between}, on the pixels that all see: {said[0]}; over completeness: {said[1]}{few}"


def _joined(told: list[tuple[str, str]]) -> str:
    """Findings (who, by how much) in words; who is ahead twice is named once."""
    groups = groupby(told, key=lambda finding: finding[0])
    return ", ".join(f"{who} {' and '.join(amount for _, amount in of)}" for who, of in groups)


def _ahead(line: Any, titles: dict[str, str]) -> tuple[str, str]:
    places = 1 if line.difference >= 1 else 2
    amount, how = f"{number(line.difference, places)} mm", TREATMENTS[line.treatment]
    if not known(line.p_corrected):
        return f"{titles[line.better]} ahead by", f"{amount} {how}"
    if line.p_corrected < 1 - LEVEL:
        ends = f"[{number(line.low, places)}, {number(line.high, places)}]"
        return f"{titles[line.better]} better by", f"{amount} {how} {ends}"
    return "no difference shown", f"{how} ({amount})"

"""Write the tables of README.md and docs/results.md from a result of paper_table, or compare them
with one.

    python -m docs.readme [RESULT] --check   do the pages agree with RESULT (default runs/table)?
    python -m docs.readme [RESULT] --write   write the tables, and the README's figure

Figures agree if they differ by at most one unit of the last printed digit. Times are not compared,
because they depend on the machine.
"""

import argparse
import re
import sys
from collections.abc import Callable, Iterator
from dataclasses import replace
from itertools import zip_longest
from pathlib import Path
from typing import Any

import matplotlib
from matplotlib.figure import Figure

from handbench.bench.evaluation.metrics import HEADLINE, chosen
from handbench.bench.evaluation.tables import each
from handbench.bench.results.about import TREATMENTS, on_common_pixels
from handbench.bench.results.result_folder import Result, load
from handbench.reports.figures.depth_maps import depth_maps
from handbench.reports.figures.style import STYLE, save
from handbench.reports.tables.blocks import interval
from handbench.reports.tables.result_tables import escaped, findings, table
from handbench.reports.tables.rounding import NONE, decimals, is_known, number, paper
from handbench.support.errors import HandbenchError
from handbench.support.files import write_text

ROOT = Path(__file__).parents[1]
REFERENCE = "photogrammetry"
SPREAD = {"max_mm": "frames_max_deviation_mm"}  # the deviation between frames of a figure
EQUAL = (("common_percent", "none"), (HEADLINE, "none"), (HEADLINE, "window"))
METHODS = ("2fsk", "3fsk", "broadband", "narrowband", "nfsk-plus", "joint", "broadband-aligned")
WITH_INTERVAL = (HEADLINE, "precision_mm")
FITTED = ("precision_mm", "2fsk")  # the figure to which the benchmark's phase noise was fitted
FIGURE, POSE, SHOWN = "docs/depth_F.png", "F", ("2fsk", "3fsk", "broadband")
BLOCK = re.compile(r"(?<=<!-- table: begin -->\n)(.*)(?=<!-- table: end -->)", re.DOTALL)
NUMBER = re.compile(r"\d+(?:\.(\d+))?")


def own_table(result: Result) -> str:
    """Return the README's table: the methods with their own settings, next to the paper's
    figures."""
    lines = []
    for metric in chosen("readme"):
        cells = []
        for method in METHODS:
            spread = result.row(SPREAD.get(metric, ""), method, REFERENCE)
            more = f" ± {number(spread.value, 1)}" if spread and is_known(spread.value) else ""
            cells.append(_cell(result.row(metric, method, REFERENCE)) + more)
        lines.append((f"{result.title(metric)} ({result.about.metrics[metric].unit})", *cells))
    caption = (
        "\nAgainst photogrammetry; each figure is formed for each pose and averaged. In italics "
        "the paper's figure; ± the deviation between frames; in brackets a 95 % interval. "
        "{cores} cores of {processor}, imaged on {imaging_device}.\n"
    )
    return table(_headings(result), lines) + caption.format(**result.about.machine)


def equal_table(result: Result) -> str:
    """Return the table of docs/results.md: the methods under equal treatment (same smoothing,
    common pixels), and its findings."""
    rows = {(row.metric, row.treatment, row.method): row for row in each(result.equal)}
    lines = []
    for metric, treatment in EQUAL:
        facts = result.about.metrics[metric]
        how = "" if facts.unit == "%" else f", {TREATMENTS[treatment]}"
        title = f"{facts.title}{on_common_pixels(metric)}{how} ({facts.unit})"
        lines.append((title, *(_cell(rows.get((metric, treatment, m))) for m in METHODS)))
    sentences = "".join(f"- {escaped(sentence)}.\n" for sentence in findings(result))
    return f"{table(_headings(result), lines)}\n{sentences}"


PAGES: dict[str, Callable[[Result], str]] = {"README.md": own_table, "docs/results.md": equal_table}


def _headings(result: Result) -> tuple[str, ...]:
    return ("", *(result.about.method_titles.get(method, method) for method in METHODS))


def _cell(row: Any) -> str:
    if row is None or not is_known(row.value):
        return NONE
    places = decimals(row.value, row.low, row.high, row.unit)
    parts = [number(row.value, places)]
    if (row.metric, row.method) == FITTED:
        parts.append("(fitted)")
    elif row.metric in WITH_INTERVAL:
        parts.append(escaped(interval(row.low, row.high, places)))
    if is_known(getattr(row, "paper", None)):
        parts.append(f"*{paper(row.paper, row.unit)}*")
    return " ".join(filter(None, parts))


def write(result: Result, root: Path = ROOT) -> None:
    """Write the tables in the pages below `root`, and the figure."""
    for page, made in PAGES.items():
        before, _, after = BLOCK.split((root / page).read_text("utf-8"))
        write_text(root / page, before + made(result) + after)
    save(draw(result), root / FIGURE)


def draw(result: Result) -> Figure:
    """Draw photograph, ground truth, and the depths and errors of the methods SHOWN, of the capture
    POSE. Raises HandbenchError if the result lacks this capture."""
    found = [capture for capture in result.about.captures if capture.name == POSE]
    if not found:
        raise HandbenchError(
            f"{result.folder}: lacks capture {POSE}; expected a run of paper_table"
        )
    methods = tuple(method for method in result.about.methods if method.name in SHOWN)
    shown = replace(result, about=result.about.model_copy(update={"methods": methods}))
    with matplotlib.rc_context(STYLE):
        return depth_maps(shown, found[0], REFERENCE).figure


def differences(result: Result, root: Path = ROOT) -> Iterator[str]:
    """Yield a text for each line of a table whose figures are not those of the result."""
    for page, made in PAGES.items():
        _, recorded, _ = BLOCK.split((root / page).read_text("utf-8"))
        lines = zip_longest(recorded.splitlines(), made(result).splitlines(), fillvalue="")
        for old, new in lines:
            compared = old.startswith(("|", "- ")) and "time per frame" not in old
            if compared and not agree(old, new):
                yield f"{page}: {old}\n  the result has: {new}"


def agree(old: str, new: str) -> bool:
    """Tell whether two texts differ only in numbers, and these by at most one unit of the last
    digit of the old ones."""
    pairs = zip(NUMBER.finditer(old), NUMBER.finditer(new), strict=False)
    return NUMBER.sub("", old) == NUMBER.sub("", new) and all(
        abs(float(a[0]) - float(b[0])) < 1.5 * 10.0 ** -len(a[1] or "") for a, b in pairs
    )


def main() -> int:
    """Compare or write the tables, as the command line asks. Returns the exit code: 1 for a
    difference, 2 for an error."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n\n")[0])
    parser.add_argument("result", type=Path, nargs="?", default=Path("runs/table"))
    what = parser.add_mutually_exclusive_group(required=True)
    what.add_argument("--check", action="store_true", help="compare the pages with RESULT")
    what.add_argument("--write", action="store_true", help="write the tables and the figure")
    options = parser.parse_args()
    try:
        result = load(options.result)
        if options.write:
            write(result)
        found = list(differences(result))
    except HandbenchError as error:
        print(f"docs.readme: {error}", file=sys.stderr)
        return 2
    print("\n".join(found) or f"README.md and docs/results.md agree with {options.result}")
    return 1 if found else 0


if __name__ == "__main__":
    sys.exit(main())

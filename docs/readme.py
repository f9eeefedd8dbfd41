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

import matplotlib
import pandas as pd
from matplotlib.figure import Figure

from handbench.bench.evaluation.metrics import COMMON, HEADLINE, chosen
from handbench.bench.results.result_folder import Result, load
from handbench.reports.figures.depth_maps import depth_maps
from handbench.reports.figures.style import STYLE, save
from handbench.reports.tables.rounding import NONE, figure, is_known, number, paper
from handbench.reports.tables.table import Table, figures
from handbench.reports.tables.table import differences as tested_differences
from handbench.reports.tables.writers import escaped, markdown
from handbench.support.errors import HandbenchError
from handbench.support.files import write_text

ROOT = Path(__file__).parents[1]
REFERENCE = "photogrammetry"
SPREAD = {"max_mm": "frames_max_deviation_mm"}  # the deviation between frames of a figure
METHODS = ("2fsk", "3fsk", "broadband", "narrowband", "nfsk-plus", "joint", "broadband-aligned")
WITH_INTERVAL = (HEADLINE, "precision_mm")
FITTED = ("precision_mm", "2fsk")  # the figure to which the benchmark's phase noise was fitted
FIGURE, POSE, SHOWN = "docs/depth_F.png", "F", ("2fsk", "3fsk", "broadband")
BLOCK = re.compile(r"(?<=<!-- table: begin -->\n)(.*)(?=<!-- table: end -->)", re.DOTALL)
NUMBER = re.compile(r"\d+(?:\.(\d+))?")


def own_table(result: Result) -> str:
    """Return the README's table: the methods with their own settings, next to the paper's
    figures."""
    titles = [result.about.method_titles.get(method, method) for method in METHODS]
    rows = {
        f"{result.title(metric)} ({result.about.metrics[metric].unit})": [
            _cell(result, metric, method) for method in METHODS
        ]
        for metric in chosen("readme")
    }
    caption = (
        "\nAgainst photogrammetry; each figure is formed for each pose and averaged. In italics "
        "the paper's figure; ± the deviation between frames; in brackets a 95 % interval. "
        "{cores} cores of {processor}, imaged on {imaging_device}.\n"
    )
    texts = pd.DataFrame.from_dict(rows, orient="index", columns=titles)
    return markdown(Table("", texts)) + caption.format(**result.about.machine)


def _cell(result: Result, metric: str, method: str) -> str:
    """Return a figure, perhaps with its interval or its deviation between frames, and in a further
    line the paper's."""
    row = result.row(metric, method, REFERENCE)
    if row is None or not is_known(row.value):
        return NONE
    text = figure(row.value, row.low, row.high, row.unit)
    if metric not in WITH_INTERVAL or (metric, method) == FITTED:
        text = text.split(" ")[0]
    if (metric, method) == FITTED:
        text += " (fitted)"
    if spread := result.row(SPREAD.get(metric, ""), method, REFERENCE):
        text += f" ± {number(spread.value, 1)}"
    return f"{text}\n{paper(row.paper, row.unit)}" if is_known(row.paper) else text


def equal_table(result: Result) -> str:
    """Return the tables of docs/results.md: the methods under equal treatment (same smoothing,
    common pixels), and its main pairs."""
    unsmoothed = result.equal.treatment == "none"
    shown = (result.equal.metric == HEADLINE) | (unsmoothed & (result.equal.metric == COMMON))
    equal = result.equal[shown].set_index("method")
    lines = equal.loc[[method for method in METHODS if method in equal.index]].reset_index()
    table = markdown(replace(figures(result, lines).turned, caption=""))
    sentences = tested_differences(result, main=True).texts.index
    return "\n".join((table, *(f"- {escaped(sentence)}." for sentence in sentences), ""))


PAGES: dict[str, Callable[[Result], str]] = {"README.md": own_table, "docs/results.md": equal_table}


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
            compared = old.startswith("|") and "time per frame" not in old
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

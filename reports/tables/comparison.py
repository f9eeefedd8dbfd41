"""Output of `handbench compare`, the comparison of two results: on the terminal and as files."""

from collections.abc import Collection, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import pandas as pd

from handbench.bench.evaluation.metrics import METRICS, chosen
from handbench.bench.evaluation.tables import DIFFERENCES, each
from handbench.bench.evaluation.tables import write as write_csv
from handbench.bench.results.compare_results import Compared
from handbench.reports.tables.rounding import NONE, figure, p_text
from handbench.reports.tables.table import Table, against
from handbench.reports.tables.writers import escaped, latex, markdown, terminal
from handbench.support.config import suggest
from handbench.support.errors import HandbenchError
from handbench.support.files import atomic_folder, write_json, write_text
from handbench.support.progress import print_lines, print_wrapped

WRITTEN = tuple(f"compare.{kind}" for kind in ("json", "csv", "md", "tex"))
NOTE = (
    "Small print: the difference B − A, its 95 % confidence interval, and p, corrected for all "
    "tests (Holm). Precisions are compared by the F test, as if all repeats were independent. "
    "Errors are tested only if the protocol compares methods by them: A and B may have them on "
    "different pixels. Times are not tested, because repeats within a run do not show the "
    "difference between two runs."
)


def show(compared: Compared, metrics: Sequence[str] = (), methods: Sequence[str] = ()) -> None:
    """Print the comparison of two results A and B on stdout: how many differences are shown, and
    the figures of some metrics (none: those that every comparison begins with) and methods (none:
    all) against the first reference. Raises HandbenchError for a metric or a method that was not
    compared."""
    differences = compared.differences
    tested = differences.metric_title[differences.p_corrected.notna()]
    of_metrics = f", of {', '.join(tested.unique())}" if len(tested) else ""
    print_lines(f"A: {compared.a.folder}", f"B: {compared.b.folder}")
    print_wrapped(compared.basis, "")
    print_lines(
        f"tested differences: {len(tested)}{of_metrics}",
        f"shown differences (*): {(differences.better != '').sum()}",
        f"other settings, versions and inputs: {len(compared.changes)}",
        "",
    )
    for kind, asked in (("metric", metrics), ("method", methods)):
        names = list(differences[kind].unique())
        if unknown := [name for name in asked if name not in names]:
            raise HandbenchError(
                f"--{kind}: '{unknown[0]}' was not compared; {suggest(unknown[0], names)}"
            )
    shown = differences[differences.method.isin(methods or differences.method)]
    of_first = tables(replace(compared, differences=shown), metrics or chosen("compare"))[0]
    terminal(of_first, "compare.json")


def write(compared: Compared, folder: Path) -> None:
    """Write the comparison of two results as a folder of compare.csv (the differences),
    compare.json (everything), compare.md and compare.tex, which replaces an earlier one when it is
    complete."""
    changes = Table("What else differs", compared.changes.set_index("what"), left=3)
    every = [*tables(compared), changes]
    head = f"A: {compared.a.folder}. B: {compared.b.folder}. {compared.basis} {NOTE}"
    with atomic_folder(folder) as temporary:
        write_csv(temporary / "compare.csv", compared.differences, DIFFERENCES)
        write_json(temporary / "compare.json", compared.content())
        text = "\n".join((f"{escaped(head)}\n", *map(markdown, every)))
        write_text(temporary / "compare.md", text)
        write_text(temporary / "compare.tex", latex("tab:compare", *every))


def tables(compared: Compared, metrics: Collection[str] = METRICS) -> list[Table]:
    """Return a table for each reference of two results A and B, with a row for each method and a
    column for each of the metrics."""
    lines = compared.differences[compared.differences.metric.isin(list(metrics))]
    means = lines[lines.capture == ""]
    of_references = []
    for reference in filter(None, compared.differences.reference.unique()):
        cells: dict[str, dict[str, str]] = {}
        for line in each(means[means.reference.isin((reference, ""))]):
            cells.setdefault(f"{line.metric_title} ({line.unit})", {})[line.method] = _cell(line)
        texts = pd.DataFrame(cells).fillna(NONE).rename(compared.a.about.method_titles)
        caption = f"A → B {against(compared.a, reference)} (*: shown to differ)"
        of_references.append(Table(caption, texts.rename_axis("method")))
    return of_references


def _cell(line: Any) -> str:
    """Return the figures of A and B, and in further lines their difference with its interval, and
    p. line: of the table DIFFERENCES."""
    a = figure(line.a, line.a_low, line.a_high, line.unit).split(" ")[0]
    b = figure(line.b, line.b_low, line.b_high, line.unit).split(" ")[0]
    star = "*" if line.better else ""
    difference = figure(line.difference, line.low, line.high, line.unit)
    return f"{a}→{b}{star}\n{difference}\np {p_text(line.p_corrected)} {line.untested}"

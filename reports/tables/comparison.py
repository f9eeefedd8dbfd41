"""Output of `handbench compare`, the comparison of two results: on the terminal and as files."""

from collections.abc import Iterable
from pathlib import Path
from typing import Any

import pandas as pd

from handbench.bench.evaluation.metrics import METRICS, chosen
from handbench.bench.evaluation.tables import DIFFERENCES, each
from handbench.bench.evaluation.tables import write as write_csv
from handbench.bench.results.compare_results import Compared
from handbench.reports.tables.rounding import NONE, figure, p_text
from handbench.reports.tables.table import AGAINST, Table
from handbench.reports.tables.writers import escaped, latex, markdown, terminal
from handbench.support.files import write_json, write_text

NOTE = (
    "Small print: the difference B − A, its 95 % confidence interval, and p, corrected for all "
    "tests (Holm). Precisions are compared by the F test, as if all repeats were independent. "
    "Errors are tested only if the protocol compares methods by them: A and B may have them on "
    "different pixels. Times are not tested, because repeats within a run do not show the "
    "difference between two runs."
)


def show(compared: Compared) -> None:
    """Print the comparison of two results A and B on stdout: the metrics that every comparison
    begins with, against the first reference."""
    print(f"A: {compared.a.folder}\nB: {compared.b.folder}\n")
    terminal(tables(compared, chosen("compare"))[0], "compare.json")
    tested, better = compared.differences.p_corrected.count(), compared.differences.better
    print(f"tested differences: {tested}, shown (*): {(better != '').sum()}")
    print(f"other settings, versions and inputs: {len(compared.changes)}")


def write(compared: Compared, folder: Path) -> None:
    """Write the comparison of two results into a folder as compare.csv (the differences),
    compare.json (everything), compare.md and compare.tex; existing files are replaced."""
    write_csv(folder / "compare.csv", compared.differences, DIFFERENCES)
    write_json(folder / "compare.json", compared.content())
    changes = Table("What else differs", compared.changes.set_index("what"), left=3)
    every = [*tables(compared), changes]
    head = f"A: {compared.a.folder}. B: {compared.b.folder}. {compared.basis} {NOTE}"
    write_text(folder / "compare.md", "\n".join((f"{escaped(head)}\n", *map(markdown, every))))
    write_text(folder / "compare.tex", "\n".join(map(latex, every)))


def tables(compared: Compared, metrics: Iterable[str] = METRICS) -> list[Table]:
    """Return a table for each reference of two results A and B, with a row for each method and a
    column for each of the metrics."""
    lines = compared.differences[compared.differences.metric.isin(list(metrics))]
    means = lines[lines.capture == ""]
    of_references = []
    for reference in filter(None, means.reference.unique()):
        cells: dict[str, dict[str, str]] = {}
        for line in each(means[means.reference.isin((reference, ""))]):
            cells.setdefault(f"{line.metric_title} ({line.unit})", {})[line.method] = _cell(line)
        texts = pd.DataFrame(cells).fillna(NONE).rename(compared.a.about.method_titles)
        caption = f"A → B {AGAINST[reference]} (*: shown to differ)"
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

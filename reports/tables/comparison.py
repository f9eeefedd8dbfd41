"""Output of `handbench compare`, the comparison of two results: on the terminal and as files."""

from collections.abc import Container
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
    p = compared.differences.p_corrected
    print(f"A: {compared.a.folder}\nB: {compared.b.folder}\n")
    terminal(tables(compared, chosen("compare"))[0], "compare.json")
    print(f"tested differences: {p.count()}, shown (*): {len(_shown(compared))}")
    print(f"other settings, versions and inputs: {len(compared.changes)}")


def write(compared: Compared, folder: Path) -> None:
    """Write the comparison of two results into a folder as compare.csv (the differences),
    compare.json (everything), compare.md and compare.tex; existing files are replaced."""
    write_csv(folder / "compare.csv", compared.differences, DIFFERENCES)
    write_json(folder / "compare.json", compared.content())
    write_text(folder / "compare.md", text(compared))
    write_text(folder / "compare.tex", "\n".join(map(latex, tables(compared))))


def text(compared: Compared) -> str:
    """Return the comparison of two results A and B as Markdown: tables, the differences that are
    shown in words, and what else differs."""
    sides = {"A": compared.a, "B": compared.b}
    names = (f"{side}: {of.folder} ({of.about.name})." for side, of in sides.items())
    shown = "".join(f"- {escaped(sentence)}\n" for sentence in _shown(compared))
    changes = compared.changes.set_index("what")
    return "\n\n".join(
        (
            "# A and B side by side",
            *map(escaped, (*names, compared.basis, NOTE)),
            *map(markdown, tables(compared)),
            shown or "No difference is shown.",
            markdown(Table("What else differs", changes, left=changes.shape[1])),
        )
    )


def _shown(compared: Compared) -> list[str]:
    return compared.differences.sentence[compared.differences.better != ""].tolist()


def tables(compared: Compared, metrics: Container[str] = METRICS) -> list[Table]:
    """Return a table for each reference of two results A and B, with a row for each method and a
    column for each of the metrics."""
    means = compared.differences[compared.differences.capture == ""]
    found = []
    for reference in means.reference[means.reference != ""].unique():
        cells: dict[str, dict[str, str]] = {}
        for line in each(means[means.reference.isin((reference, ""))]):
            if line.metric in metrics:
                heading = f"{line.metric_title} ({line.unit})"
                cells.setdefault(heading, {})[line.method] = _cell(line)
        texts = pd.DataFrame(cells, means.method.unique()).fillna(NONE)
        titles = texts.rename(compared.a.about.method_titles).rename_axis("method")
        found.append(Table(f"A → B {AGAINST[reference]} (*: shown to differ)", titles))
    return found


def _cell(line: Any) -> str:
    """Return the figures of A and B, and in further lines their difference, its interval and p.
    line: of the table DIFFERENCES."""
    a, b = (
        figure(value, low, high, line.unit).split(" ")[0]
        for value, low, high in (
            (line.a, line.a_low, line.a_high),
            (line.b, line.b_low, line.b_high),
        )
    )
    p = f"p {p_text(line.p_corrected)}" if not line.untested else f"no test: {line.untested}"
    change = figure(line.difference, line.low, line.high, line.unit)
    return f"{a}→{b}{'*' if line.better else ''}\n{change}\n{p}"

"""Output of `handbench compare`, the comparison of two results: on the terminal, as Markdown and as
LaTeX."""

from pathlib import Path
from typing import Any

from handbench.bench.results import each
from handbench.bench.results.compare_results import Compared
from handbench.reports.tables import latex
from handbench.reports.tables.blocks import NONE, figure, number, p_text
from handbench.reports.tables.result_tables import (
    bold,
    escaped,
    print_table,
    table,
    terminal_table,
    wide_console,
)
from handbench.support.files import write_text

CHANGES = 12  # of one kind are shown; compare.json has all
HEAD = ("A", "B", "B − A", "p")
NOTE = (
    "In brackets 95 % confidence intervals; p corrected for all lines (Holm); precisions by the "
    "F test, as if all "
    "repeats were independent."
)
TIMES = (
    "Times are not tested, for the repeats of one run do not know how two runs differ. GFLOP/s: "
    "what the machine "
    "reaches in products of matrices."
)


def show(compared: Compared) -> None:
    """Print the comparison of two results A and B on stdout: tables of the differences in accuracy
    and of the times, other changes (such as versions or settings), and a sentence for each
    significant difference."""
    console = wide_console()
    for text in _head(compared):
        console.print(text, markup=False)
    lines = [
        (line.title, _metric(line), *_cells(line), line.better, _needed(line))
        for line in each(compared.differences)
    ]
    print_table(terminal_table("Differences", ("", "", *HEAD, "better", "needs hands"), lines))
    if len(compared.times):
        lines = [_time(time) for time in each(compared.times)]
        heads = ("", *_machines(compared), "B / A")
        print_table(terminal_table("Time per frame (s)", heads, lines))
        console.print(TIMES, markup=False)
    for text in _changes(compared):
        console.print(text, markup=False)
    for text in _shown(compared) or ["no difference shown between A and B"]:
        console.print(text, markup=False)


def write(compared: Compared, folder: Path) -> None:
    """Write the comparison of two results into a folder as compare.md and compare.tex; existing
    files are replaced."""
    write_text(folder / "compare.md", markdown(compared))
    write_text(folder / "compare.tex", tex(compared))


def markdown(compared: Compared) -> str:
    """Return the comparison of two results A and B as Markdown.
    It has the significant differences in words, a table of all differences with significantly
    better figures in bold, the times, and what else differs."""
    shown = [f"- {escaped(text)}" for text in _shown(compared)]
    differences = []
    for line in each(compared.differences):
        a, b, difference, _ = map(escaped, _cells(line))
        a, b = bold(a) if line.better == "A" else a, bold(b) if line.better == "B" else b
        differences.append(
            (
                escaped(line.title),
                escaped(_metric(line)),
                a,
                b,
                difference,
                p_text(line.p_corrected),
            )
        )
    parts = [
        "# A and B side by side\n",
        *(f"{escaped(text)}\n" for text in _head(compared)),
        "\n".join(shown or ["No difference shown."]) + "\n",
        table(("method", "metric", *HEAD), differences, texts=2),
    ]
    if len(compared.times):
        lines = (tuple(map(escaped, _time(time))) for time in each(compared.times))
        parts += [table(("time per frame (s)", *_machines(compared), "B / A"), lines), f"{TIMES}\n"]
    changes = [f"- {escaped(text)}" for text in _changes(compared)]
    parts += ["## What else differs\n", "\n".join(changes or ["Nothing."]) + "\n"]
    return "\n".join(parts)


def tex(compared: Compared) -> str:
    """Return the differences between two results A and B as LaTeX tables, one for each reference
    surface. A figure that is significantly better is bold."""
    texts = []
    for reference, lines in compared.differences.groupby("reference", sort=False):
        body = []
        for line in each(lines):
            a = latex.num_figure(
                line.a, line.a_low, line.a_high, line.unit, bold=line.better == "A"
            )
            b = latex.num_figure(
                line.b, line.b_low, line.b_high, line.unit, bold=line.better == "B"
            )
            difference = latex.num_figure(line.difference, line.low, line.high, line.unit)
            names = latex.escaped(line.title), latex.title_with_unit(line.metric_title, line.unit)
            body.append(latex.row([*names, a, b, difference, latex.p_value(line.p_corrected)]))
        basis = (
            text
            for text in _basis(compared)
            if reference and text.startswith(f"Against {reference}:")
        )
        text = (
            f"{'; '.join(_sides(compared))}. {' '.join((*basis, NOTE))} Bold: shown to be better."
        )
        texts.append(
            latex.float_table(text, "llrrrr", ("Method", "Metric", "A", "B", "B - A", "p"), body)
        )
    return "\n".join(texts)


def _head(compared: Compared) -> list[str]:
    """Return the sentences above the comparison: names and captures of A and B, which captures are
    compared, and how intervals and p-values are computed."""
    return [*_sides(compared), *_basis(compared), NOTE]


def _shown(compared: Compared) -> list[str]:
    """Return a sentence for each significant difference between A and B."""
    return compared.differences.sentence[compared.differences.better != ""].tolist()


def _sides(compared: Compared) -> list[str]:
    sides = (("A", compared.a), ("B", compared.b))
    return [f"{side}: {of.folder} ({of.name}; {', '.join(of.captures)})" for side, of in sides]


def _basis(compared: Compared) -> list[str]:
    return [f"{text[0].upper()}{text[1:]}." for text in compared.basis]


def _metric(line: Any) -> str:
    return " ".join(
        filter(
            None,
            (line.metric_title, f"({line.unit})", line.reference and f"against {line.reference}"),
        )
    )


def _cells(line: Any) -> tuple[str, str, str, str]:
    return (
        figure(line.a, line.a_low, line.a_high, line.unit),
        figure(line.b, line.b_low, line.b_high, line.unit),
        figure(line.difference, line.low, line.high, line.unit),
        p_text(line.p_corrected),
    )


def _needed(line: Any) -> str:
    """Return the number of hands that a comparison would need to show this difference, as text; ""
    if it is unknown or the difference is significant already.
    line: a row of the table of differences."""
    return f"{line.needed:.0f}" if line.needed > 0 else ""


def _time(time: Any) -> tuple[str, str, str, str]:
    a, b = (
        figure(time.a, time.a_low, time.a_high, "s"),
        figure(time.b, time.b_low, time.b_high, "s"),
    )
    return time.title, a, b, number(time.ratio, 2)


def _machines(compared: Compared) -> list[str]:
    """Return the headings of A and B in the table of times, each with the machine's rate of matrix
    products in GFLOP/s, by which the times can be judged."""
    rates = (("A", compared.a.gemm_gflops), ("B", compared.b.gemm_gflops))
    return [
        f"{side} (rate unknown)" if rate is None else f"{side} ({rate:.0f} GFLOP/s)"
        for side, rate in rates
    ]


def _changes(compared: Compared) -> list[str]:
    """Return a line for each fact that differs between A and B, such as a version or an input. Of
    each sort, the first 12 (CHANGES) are listed and the others counted."""
    texts = []
    for what, changes in compared.changes.groupby("what", sort=False):
        first = each(changes[:CHANGES])
        texts += [f"{what} {c.key}: {c.a or NONE} in A, {c.b or NONE} in B" for c in first]
        if len(changes) > CHANGES:
            texts.append(f"{what}: {len(changes) - CHANGES} more, see compare.json")
    return texts

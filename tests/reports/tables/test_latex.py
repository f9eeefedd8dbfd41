"""LaTeX: every table compiles whatever the names, fits its column, and has the figures of
table.csv."""

from __future__ import annotations

import csv
import re
import shutil
import subprocess
from dataclasses import replace
from itertools import pairwise

import pytest
from hypothesis import given
from hypothesis import strategies as st

from handbench.bench.results.compare_results import compare_results
from handbench.bench.results.result_folder import Result, load
from handbench.reports.tables import comparison, table, writers
from tests.reports.synthetic_result import ELEVEN, compared, write_synthetic

HOSTILE = (
    "\\input{/etc/passwd}",
    "$x^2$ \\end{tabular}",
    '50 % & {y} #1 ~ ^ _ | <b> "q" [z]',
    "\\catcode`\\%=0",
    "手 🖐 é ß Łódź naïve ǽ σ ≤ 5 µm − ½",
    "\x00\x07\u200e\u0301 a\nb\\\\",
)
with_latex = pytest.mark.skipif(
    shutil.which("pdflatex") is None,
    reason="no LaTeX: no table was compiled (Debian's package: texlive-latex-base)",
)


@pytest.fixture(scope="module")
def result(tmp_path_factory):
    """A result of eleven methods, with figures under equal treatment."""
    folder = tmp_path_factory.mktemp("latex") / "result"
    return load(write_synthetic(folder, ("B", "F"), ELEVEN, step_m=8e-3, equal=True))


def named(result: Result, names: tuple[str, ...]) -> Result:
    """The result with these method titles and benchmark name, and a comparison of every pair of
    neighbours."""
    titled = zip(result.about.methods, 2 * names, strict=False)
    methods = tuple(method.model_copy(update={"title": name}) for method, name in titled)
    figures = (1.0, 0.5, 1.5, "mm", 1e-4, 2.0, "truth", 3, "", "")
    lines = [("mae_mm", a.name, b.name, *figures) for a, b in pairwise(methods)]
    about = result.about.model_copy(update={"methods": methods, "name": names[-1]})
    return compared(replace(result, about=about), lines)


def tables(result: Result) -> list[table.Table]:
    of_all = [table.of_paper(result), table.differences(result)]
    return [*table.every_figure(result), *of_all]


def compiled(folder, texts: list[str]) -> tuple[str, str]:
    """Compile tables for a paper in two columns of 252 pt: LaTeX's log, and the list of the files
    that it opened."""
    ieee = subprocess.run(["kpsewhich", "IEEEtran.cls"], capture_output=True).stdout
    start = r"\documentclass[twocolumn]{article}\textwidth516pt\columnsep12pt"
    start = r"\documentclass[journal]{IEEEtran}" if ieee else start
    body = "\n\\clearpage\n".join(texts)
    document = f"{start}\n\\begin{{document}}\n{body}\n\\end{{document}}\n"
    (folder / "paper.tex").write_text(document, encoding="utf-8")
    options = ("-no-shell-escape", "-interaction=nonstopmode", "-halt-on-error", "-recorder")
    command = ["pdflatex", *options, "paper.tex"]
    done = subprocess.run(command, cwd=folder, capture_output=True, timeout=600)
    assert done.returncode == 0, done.stdout.decode("latin-1")[-1500:]
    return (folder / "paper.log").read_text("latin-1"), (folder / "paper.fls").read_text("utf-8")


@with_latex
def test_every_table_compiles_whatever_the_names(result, tmp_path):
    """Titles that would read files, end the table or need another font."""
    evil = named(result, HOSTILE)
    texts = [writers.latex(each) for each in tables(evil)]
    texts += map(writers.latex, comparison.tables(compare_results(evil, evil)))
    _, opened = compiled(tmp_path, texts)
    assert "/etc/passwd" not in opened


@with_latex
def test_tables_fit_the_page_and_one_column_of_it(result, tmp_path):
    widths = (writers.PAGE_PT, writers.COLUMN_PT)
    texts = [writers.latex(each, width) for each in tables(result) for width in widths]
    log, _ = compiled(tmp_path, texts)
    assert "Overfull" not in log


def cells(line: str) -> list[str]:
    """The cells of a line of a table in LaTeX, without their small print."""
    return re.findall(r"\\hspace\{0pt\}(?:\\textbf\{)?(.*?)\}?(?:\\\\.*?)?\\strut", line)


def test_the_figures_of_table_csv_are_in_the_latex(result):
    """Each to half a unit of its last digit."""
    printed = {}
    for each in table.every_figure(result):
        for part in writers.latex(each).split("\\toprule\n")[1:]:
            head, *rows = map(cells, re.findall(r".* & .*", part))
            for title, *figures in rows:
                for method, figure in zip(head[1:], figures, strict=True):
                    printed[each.caption, title, method] = figure
    with (result.folder / "table.csv").open(encoding="utf-8") as stream:
        lines = [line for line in csv.DictReader(stream) if line["value"]]
    for line in lines:
        caption = table.AGAINST[line["reference"]].capitalize()
        title = writers.tex(f"{result.title(line['metric'])} ({line['unit']})")
        figure = printed[caption, title, result.about.method_titles[line["method"]]]
        half = 0.5 * 10.0 ** -len(figure.partition(".")[2])
        value = float(figure.replace("$-$", "-"))
        assert value == pytest.approx(float(line["value"]), abs=half * 1.001)


@given(st.text())
def test_any_text_becomes_plain_ascii_without_commands(text):
    ours = writers.tex(text)
    assert ours.isascii() and "\n" not in ours
    known = sorted(map(re.escape, writers.CHARACTERS.values()), key=len, reverse=True)
    accents = r"\\[`'^~=u.\"rHvdc]\{[A-Za-z]\}"
    rest = re.sub("|".join((*known, accents)), "", ours)
    assert not re.search(r"[\\{}&%$#_^~<>|\"\[\]]", rest)


def test_characters_become_commands_or_numbers():
    assert writers.tex("e\u0301 手 ≤ σ") == r"\'{e} U+624B $\leq$ $\sigma$"

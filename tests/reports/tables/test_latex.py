"""LaTeX: every table compiles, whatever the names; numbers, units and bold figures are what they
should be."""

from __future__ import annotations

import re
import shutil
import subprocess
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from handbench.bench.results.compare_results import compare_results
from handbench.bench.results.result_folder import Result, load
from handbench.reports.tables import comparison, latex
from tests.reports.synthetic_result import compared

HOSTILE = (
    "\\input{/etc/passwd}",
    "$x^2$ \\end{tabular}",
    '50 % & {y} #1 ~ ^ _ | <b> "q" [z]',
    "\\catcode`\\%=0",
    "手 🖐 é ß Łódź naïve ǽ σ ≤ 5 µm − ½",
    "\x00\x07\u200e\u0301 a\nb\\\\",
)


@pytest.fixture(scope="module")
def result(result_folder):
    return load(result_folder)


def named(result: Result, names: tuple[str, ...]) -> Result:
    """The result with these method titles and benchmark name, and a comparison of every pair of
    neighbours."""
    methods = [
        m.model_copy(update={"title": name})
        for m, name in zip(result.about.methods, names, strict=False)
    ]
    figures = (1.0, 0.5, 1.5, "mm", 1e-4, 2.0, "truth", 3, "", "")
    lines = [("mae_mm", a.name, b.name, *figures) for a, b in pairwise(methods)]
    about = result.about.model_copy(update={"methods": tuple(methods), "name": names[-1]})
    return compared(replace(result, about=about), lines)


def files_read(folder: Path, texts: dict[str, str], paper: bool = False) -> str:
    """Compile the texts, of a paper in IEEEtran; LaTeX's record of the files that it opened."""
    for name, text in texts.items():
        (folder / name).write_text(text, encoding="utf-8")
    margins = r"\usepackage[margin=18mm]{geometry}"
    start = (
        r"\documentclass[journal]{IEEEtran}"
        if paper
        else r"\documentclass[10pt,a4paper]{article}" + margins
    )
    inputs = "\n".join(rf"\input{{{name}}}" for name in texts)
    packages = r"\usepackage{booktabs}\usepackage{siunitx}"
    whole = f"{start}{packages}\n\\begin{{document}}\n{inputs}\n\\end{{document}}\n"
    (folder / "document.tex").write_text(whole, encoding="utf-8")
    options = ("-no-shell-escape", "-interaction=nonstopmode", "-halt-on-error", "-recorder")
    command = ["pdflatex", *options, "document.tex"]
    done = subprocess.run(command, cwd=folder, capture_output=True, timeout=600)
    assert done.returncode == 0, done.stdout.decode("latin-1")[-1500:]
    return (folder / "document.fls").read_text("utf-8")


@pytest.mark.skipif(
    shutil.which("pdflatex") is None, reason="pdflatex is not installed: no table was compiled"
)
def test_every_table_compiles_whatever_the_names(result, tmp_path):
    """Titles that would read files, end the table or need another font; nine methods make two
    parts."""
    if not subprocess.run(["kpsewhich", "siunitx.sty"], capture_output=True).stdout:
        pytest.skip("LaTeX has no siunitx (Debian: texlive-science): no table was compiled")
    evil = named(result, HOSTILE)
    many = replace(evil, about=evil.about.model_copy(update={"methods": evil.about.methods * 3}))
    texts = {
        "table.tex": latex.latex(many),
        "comparisons.tex": latex.comparisons(evil),
        "compare.tex": comparison.tex(compare_results(evil, named(result, HOSTILE[::-1]))),
    }
    assert "/etc/passwd" not in files_read(tmp_path, texts)


@pytest.mark.skipif(
    shutil.which("pdflatex") is None, reason="pdflatex is not installed: no table was compiled"
)
def test_the_papers_table_fits_one_column_of_ieeetran(result, tmp_path):
    """No box is wider than its column of 252 pt, with titles as long as ours and intervals of
    sixteen characters."""
    if any(
        not subprocess.run(["kpsewhich", f], capture_output=True).stdout
        for f in ("siunitx.sty", "IEEEtran.cls")
    ):
        pytest.skip(
            "LaTeX has no siunitx or IEEEtran (Debian: texlive-science, texlive-publishers)"
        )
    titles = ("3-FSK weighted", "broadband sub-voxel", "broadband aligned", "narrowband")
    long = named(result, titles)
    lines = long.table.assign(low=-0.4021, high=-0.3411, value=-0.3719).where(
        long.table.metric == "bias_mm", long.table
    )
    many = replace(
        long, about=long.about.model_copy(update={"methods": long.about.methods * 2}), table=lines
    )
    assert latex.column(many).count(r"\begin{table}") == 2
    files_read(
        tmp_path, {"column.tex": latex.column(many), "table.tex": latex.latex(many)}, paper=True
    )
    assert "Overfull" not in (tmp_path / "document.log").read_text("latin-1")


@given(st.text())
def test_any_text_becomes_plain_ascii_without_commands(text):
    found = latex.escaped(text)
    assert found.isascii() and "\n" not in found
    known = [re.escape(v) for v in (*latex.CHARACTERS.values(),)] + [
        r"\\[`'^~=u.\"rHvdc]\{[A-Za-z]\}"
    ]
    assert not re.search(
        r"[\\{}&%$#_^~<>|\"\[\]]", re.sub("|".join(sorted(known, key=len, reverse=True)), "", found)
    )


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("e\u0301", r"\'{e}"),
        ("手", "U+624B"),
        ("50 % of $x", r"50 \% of \$x"),
        ("5 µm ≤ σ", r"5 $\mu$m $\leq$ $\sigma$"),
    ],
)
def test_characters_become_commands_or_numbers(text, expected):
    assert latex.escaped(text) == expected


def test_the_table_has_our_figure_its_interval_and_the_papers(result):
    text = latex.latex(result)
    row = result.row("mae_mm", "2fsk", "truth")
    assert rf"{{\scriptsize {{[}}{row.low:.2f}, {row.high:.2f}{{]}}}}" in text
    assert rf" & {row.value:.2f} & " in text and r"MAE /~\unit{\milli\metre}" in text
    assert r" & paper & 3.6 & 0.3 & {--} & {--} \\" in text
    widths = {
        line.count("&") for line in text.replace(r"\&", "").splitlines() if line.endswith(r"\\")
    }
    assert widths == {5} and text.count(r"\midrule") == 2

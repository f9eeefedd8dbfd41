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

from handbench.bench import results
from handbench.bench.evaluation.tables import CHANGES, COMPARISONS, DIFFERENCES, TIMES, frame
from handbench.bench.results import Claim, Section, Setting, Tradeoff, TradeoffFacts
from handbench.bench.results.compare_results import Compared, ComparedResult
from handbench.reports.tables import comparison, latex

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
    return results.load(result_folder)


def named(result: results.Result, names: tuple[str, ...]) -> results.Result:
    """The result with these method titles and benchmark name, and a comparison of every pair of
    neighbours."""
    methods = [
        m.model_copy(update={"title": name})
        for m, name in zip(result.about.methods, names, strict=False)
    ]
    figures = (1.0, 0.5, 1.5, "mm", 1e-4, 2.0, "truth", 3, 30, "", "")
    lines = [("mae_mm", a.name, b.name, *figures) for a, b in pairwise(methods)]
    about = result.about.model_copy(update={"methods": tuple(methods), "name": names[-1]})
    files = {**result.files, "comparisons": frame(COMPARISONS, lines)}
    return replace(result, about=about, files=files)


def tradeoff(name: str) -> Tradeoff:
    words = dict.fromkeys(("title", "metric", "definition", "seconds", "reference"), name)
    section = Section(name="imaging", unit="mm", **words)
    claims = (Claim(text=name, paper=40),)
    facts = TradeoffFacts(name="sweep", scored_against="truth", sections=(section,), claims=claims)
    figures = (0.5, 0.4, 0.61, "mm", 0.031, 0.03, 0.04, 1.0)
    known = Setting("imaging", "a", name, "{}", name, *figures, *(None,) * 6, True, "")
    beaten = replace(known, title="beaten", error=None, on_front=False, dominated_by="a")
    bare = replace(known, low=None, high=None, seconds=None, ratio=None)
    return Tradeoff(Path(), facts, (known, beaten, bare))


def compared(name: str) -> Compared:
    side = ComparedResult(f"runs/{name}", name, (name, "F"), None)
    figures = (1.0, 0.9, 1.1, 2.0, 1.9, 2.1, 1.0, 0.8, 1.2, 1e-6)
    line = ("3fsk", name, "mae_mm", "MAE", "mm", "truth", *figures, True, 3, 3, "A", f"{name}: A")
    missing = ("b", "b_low", "b_high", "difference", "low", "high", "p_corrected")
    differences = frame(DIFFERENCES, [line, line])
    differences.loc[1, [*missing]] = float("nan")
    differences.loc[1, ["reference", "better"]] = ""
    times = frame(TIMES, [("3fsk", name, 0.1, None, None, 0.2, None, None, 2.0, "")])
    changes = frame(CHANGES, [("version", name, name, "")])
    return Compared(side, side, (f"against truth: {name}",), differences, times, changes)


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
    texts = {"table.tex": latex.latex(many), "comparisons.tex": latex.comparisons(evil)}
    for i, name in enumerate(HOSTILE):
        texts |= {
            f"front{i}.tex": latex.tradeoff(tradeoff(name)),
            f"compare{i}.tex": comparison.tex(compared(name)),
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
        ("é Ångström", r"\'{e} \r{A}ngstr\"{o}m"),
        ("e\u0301", r"\'{e}"),
        ("手", "U+624B"),
        ("\x07", "U+0007"),
        ("50 % of $x", r"50 \% of \$x"),
        ("a\n b", "a b"),
        ("5 µm ≤ σ", r"5 $\mu$m $\leq$ $\sigma$"),
        ("ǿ", "U+01FF"),
    ],
)
def test_characters_become_commands_or_numbers(text, expected):
    assert latex.escaped(text) == expected


def test_the_table_has_our_figure_its_interval_and_the_papers(result):
    text = latex.latex(result)
    row = result.row("mae_mm", "2fsk", "truth")
    assert (
        rf"{{\scriptsize {{[}}{row.low:.2f}, {row.high:.2f}{{]}}}}" in text
        and rf" & {row.value:.2f} & " in text
    )
    assert r" & paper & 6.6 & 1.7 & 1.0 & 13.4 \\" in text
    assert r" & paper & 3.6 & 0.3 & {--} & {--} \\" in text
    assert r"MAE /~\unit{\milli\metre}" in text and r"time per frame /~\unit{\second}" in text
    assert r"observed pixels\strut} & ours" in text
    widths = {
        line.count("&") for line in text.replace(r"\&", "").splitlines() if line.endswith(r"\\")
    }
    assert widths == {5} and text.count(r"\midrule") == 2

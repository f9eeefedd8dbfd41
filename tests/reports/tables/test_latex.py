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
    lines = [
        ("mae_mm", a.name, b.name, 1.0, 0.5, 1.5, "mm", 1e-4, 2.0, "truth", 3, 30, "", "")
        for a, b in pairwise(methods)
    ]
    about = result.about.model_copy(update={"methods": tuple(methods), "name": names[-1]})
    return replace(
        result, about=about, files={**result.files, "comparisons": frame(COMPARISONS, lines)}
    )


def tradeoff(name: str) -> Tradeoff:
    section = Section(
        name="imaging",
        title=name,
        metric=name,
        unit="mm",
        definition=name,
        seconds=name,
        reference=name,
    )
    facts = TradeoffFacts(
        name="sweep",
        scored_against="truth",
        sections=(section,),
        claims=(Claim(text=name, paper=40),),
    )
    known = Setting(
        "imaging",
        "a",
        name,
        "{}",
        name,
        0.5,
        0.4,
        0.61,
        "mm",
        0.031,
        0.03,
        0.04,
        1.0,
        *(None,) * 6,
        True,
        "",
    )
    unknown = replace(known, title="beaten", error=None, on_front=False, dominated_by="a")
    return Tradeoff(
        Path(),
        facts,
        (known, unknown, replace(known, low=None, high=None, seconds=None, ratio=None)),
    )


def compared(name: str) -> Compared:
    side = ComparedResult(f"runs/{name}", name, (name, "F"), None)
    figures = (
        1.0,
        0.9,
        1.1,
        2.0,
        1.9,
        2.1,
        1.0,
        0.8,
        1.2,
        1e-6,
        True,
        3,
        3,
        "A",
        f"{name}: A is better",
    )
    line = dict(
        zip(
            DIFFERENCES.names, ("3fsk", name, "mae_mm", "MAE", "mm", "truth", *figures), strict=True
        )
    )
    missing = dict.fromkeys(("b", "b_low", "b_high", "difference", "low", "high", "p_corrected"))
    blank = {**line, **missing, "reference": "", "better": ""}
    times = frame(TIMES, [("3fsk", name, 0.1, None, None, 0.2, None, None, 2.0, "")])
    changes = frame(CHANGES, [("version", name, name, "")])
    return Compared(
        side, side, (f"against truth: {name}",), frame(DIFFERENCES, [line, blank]), times, changes
    )


def document(*files: str) -> str:
    r"""A document of its own that \inputs `files`, which lie beside it: for pdflatex, lualatex or
    xelatex."""
    packages = (
        r"\usepackage[margin=18mm]{geometry}",
        r"\usepackage{booktabs}",
        r"\usepackage{siunitx}",
    )
    inputs = (rf"\input{{{file}}}" for file in files)
    start = (r"\documentclass[10pt,a4paper]{article}", *packages, r"\begin{document}")
    return "\n".join([*start, *inputs, r"\end{document}", ""])


def files_read(folder: Path, texts: dict[str, str], paper: bool = False) -> str:
    """Compile the texts, of a paper in IEEEtran; LaTeX's record of the files that it opened."""
    for name, text in texts.items():
        (folder / name).write_text(text, encoding="utf-8")
    whole = document(*texts)
    if paper:
        whole = whole.replace("[10pt,a4paper]{article}", "[journal]{IEEEtran}")
        whole = whole.replace(r"\usepackage[margin=18mm]{geometry}", "")
    (folder / "document.tex").write_text(whole, encoding="utf-8")
    options = ("-no-shell-escape", "-interaction=nonstopmode", "-halt-on-error", "-recorder")
    done = subprocess.run(
        ["pdflatex", *options, "document.tex"], cwd=folder, capture_output=True, timeout=600
    )
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


def test_the_papers_table_has_what_the_paper_prints(result):
    """Its metrics and no others, ours above its, in one column; a result without methods has
    none."""
    text = latex.column(result)
    assert r"\quad paper & 6.6 & 1.7 & 1.0 & 13.4 \\" in text and "table*" not in text
    assert "RMSE" not in text and "ours / paper" not in text
    mae = result.row("mae_mm", "2fsk", "photogrammetry").value
    assert re.search(rf"MAE /~\\unit{{\\milli\\metre}}\\strut}}+ & {mae:.2f} & ", text)


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


def test_columns_have_room_for_every_number(result):
    """A number wider than its table-format would shift the column."""
    text = latex.latex(result)
    for table in text.split(r"\begin{table*}")[1:]:
        formats = re.findall(r"table-format=(-?)(\d)\.(\d)", table)
        assert len(formats) == 4
        for line in table.splitlines():
            for cell, (sign, before, after) in zip(
                line.removesuffix(r" \\").split(" & ")[2:], formats, strict=False
            ):
                if found := re.fullmatch(r"(-?)(\d+)\.?(\d*)", cell):
                    assert (
                        len(found[1]) <= len(sign)
                        and len(found[2]) <= int(before)
                        and len(found[3]) <= int(after)
                    )


def test_many_methods_go_on_in_another_table(result):
    nine = result.about.model_copy(
        update={"methods": (*result.about.methods * 2, result.about.methods[0])}
    )
    tables = latex.latex(replace(result, about=nine)).split(r"\begin{table*}")[1:]
    assert [table.count("S[") for table in tables] == [4, 5, 4, 5]
    assert ["(continued)" in table for table in tables] == [False, True, False, True]


def test_a_result_without_methods_has_an_empty_table(result):
    text = latex.latex(replace(result, about=result.about.model_copy(update={"methods": ()})))
    assert text.count(r"\bottomrule") == 2 and r"\midrule" in text


def test_only_what_a_test_stands_behind_is_bold(result):
    assert r"\bfseries" not in latex.latex(result)
    pairs = [
        ("mae_mm", "broadband", worse, 1.0, 0.5, 1.5, "mm", p, 2.0, "truth", 3, 30, "", "")
        for worse, p in (("2fsk", 1e-4), ("3fsk", 0.3), ("narrowband", 1e-4))
    ]
    lines = frame(COMPARISONS, pairs)
    text = latex.latex(replace(result, files={"comparisons": lines}))
    values = [result.row("mae_mm", method, "truth").value for method in ("3fsk", "broadband")]
    assert [float(v) for v in re.findall(r"\\bfseries ([\d.]+)", text)] == pytest.approx(
        values, abs=0.006
    )
    unbeaten = replace(result, files={"comparisons": lines.assign(p_corrected=0.3)})
    assert r"\bfseries" not in latex.latex(unbeaten)


def test_the_front_alone_is_tabulated():
    text = latex.tradeoff(tradeoff("exact"))
    assert (
        "beaten" not in text
        and r"exact & \num{0.50} {[}\num{0.40}, \num{0.61}{]} & \num{0.0310}" in text
    )
    assert r"exact & \num{0.500} & -- & -- \\" in text

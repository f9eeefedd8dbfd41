"""LaTeX: every table compiles whatever the names, and fits its column."""

from __future__ import annotations

import re
import shutil
import subprocess
from dataclasses import replace
from itertools import product

import pytest
from hypothesis import given
from hypothesis import strategies as st

from handbench.bench.results.compare_results import compare_results
from handbench.bench.results.result_folder import load
from handbench.reports.tables import comparison, table, writers
from tests.golden_files import RESULT
from tests.strategies import examples

PLAIN = ("2-FSK", "3-FSK weighted", "broadband aligned", "broadband sub-voxel")
HOSTILE = (  # would read files, end the table or need another font
    "\\input{/etc/passwd} $x^2$ \\end{tabular}",
    '50 % & {y} #1 ~ ^ _ | <b> "q" [z]',
    "\\catcode`\\%=0",
    "手 🖐 é ß Łódź naïve ǽ σ ≤ 5 µm − ½ \x00\x07\u200e\u0301 a\nb\\\\",
)


@pytest.mark.skipif(
    shutil.which("pdflatex") is None,
    reason="no LaTeX: no table was compiled (Debian's package: texlive-latex-base)",
)
@pytest.mark.parametrize("titles", [PLAIN, HOSTILE], ids=["plain", "hostile"])
def test_every_table_compiles_and_fits_the_page_and_one_column(titles, tmp_path):
    """A word of a hostile title may be wider than its column."""
    result = load(RESULT)
    named = zip(result.about.methods, titles, strict=True)
    methods = tuple(method.model_copy(update={"title": title}) for method, title in named)
    result = replace(result, about=result.about.model_copy(update={"methods": methods}))
    shown = [*table.every_figure(result), table.of_paper(result), table.differences(result)]
    texts = [
        writers.latex(f"tab:{number}", each, width_pt=width_pt)
        for number, (each, width_pt) in enumerate(
            product(shown, (writers.PAGE_PT, writers.COLUMN_PT))
        )
    ]
    texts.append(writers.latex("tab:b", *comparison.tables(compare_results(result, result))))
    ieee = subprocess.run(["kpsewhich", "IEEEtran.cls"], capture_output=True).stdout
    start = r"\documentclass[twocolumn]{article}\textwidth516pt\columnsep12pt"
    start = r"\documentclass[journal]{IEEEtran}" if ieee else start
    body = "\n\\clearpage\n".join(texts)
    document = f"{start}\n\\begin{{document}}\n{body}\n\\end{{document}}\n"
    (tmp_path / "paper.tex").write_text(document, encoding="utf-8")
    options = ("-no-shell-escape", "-interaction=nonstopmode", "-halt-on-error", "-recorder")
    command = ["pdflatex", *options, "paper.tex"]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, timeout=600)
    assert done.returncode == 0, done.stdout.decode("latin-1")[-1500:]
    assert titles is HOSTILE or "Overfull" not in (tmp_path / "paper.log").read_text("latin-1")
    assert "multiply" not in (tmp_path / "paper.log").read_text("latin-1")  # defined labels
    assert "/etc/passwd" not in (tmp_path / "paper.fls").read_text("utf-8")


@given(st.text())
@examples(30)
def test_any_text_becomes_plain_ascii_without_commands(text):
    ours = writers.tex(text)
    assert ours.isascii() and "\n" not in ours
    replacements = sorted(map(re.escape, writers.CHARACTERS.values()), key=len, reverse=True)
    accents = r"\\[`'^~=u.\"rHvdc]\{[A-Za-z]\}"
    rest = re.sub("|".join((*replacements, accents)), "", ours)
    assert not re.search(r"[\\{}&%$#_^~<>|\"\[\]]", rest)


def test_characters_become_commands_or_numbers():
    assert writers.tex("e\u0301 手 ≤ σ") == r"\'{e} U+624B $\leq$ $\sigma$"

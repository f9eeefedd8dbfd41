r"""LaTeX tables for papers, with booktabs rules and siunitx numbers and units.

The text of each function is a sequence of floats for \input. The document needs
\usepackage{booktabs} and \usepackage{siunitx} (version 3). The encoding does not matter, because
characters outside ASCII are written as commands. The tables of `column` fit one column of IEEEtran
(252 pt), the others the width of a page.
"""

import unicodedata
from collections.abc import Iterable
from itertools import groupby, pairwise

from handbench.bench.evaluation.tables import each
from handbench.bench.results.result_folder import Result
from handbench.reports.tables.blocks import Block, Line, best_note, blocks, caption, paper_block
from handbench.reports.tables.rounding import NONE, figure, number, p_text
from handbench.reports.tables.table import AGAINST

COLUMNS, ABREAST = 5, 4  # methods that fit next to each other on a page and in one of its columns
TITLE = "30mm"  # width of the column of metrics, whose titles are long
# of a table in a column: its width, its titles', half the gap
COLUMN_PT, TITLE_PT, SEP_PT = (251, 62, 2)
UNITS = {
    "mm": r"\unit{\milli\metre}",
    "s": r"\unit{\second}",
    "%": r"\unit{\percent}",
    "m": r"\unit{\metre}",
}


def _pairs(text: str) -> dict[str, str]:
    """Return a dictionary from a text of words, which are keys and values in turn."""
    words = text.split()
    return dict(zip(words[::2], words[1::2], strict=True))


CHARACTERS = {"\N{NO-BREAK SPACE}": "~"} | _pairs(r"""
    \ \textbackslash{}   { \{   } \}   & \&   % \%   $ \$   # \#   _ \_   ~ \textasciitilde{}
    ^ \textasciicircum{}   < \textless{}   > \textgreater{}   | \textbar{}
    " ''   [ {[}   ] {]}   − $-$   – --
    — ---   … \ldots{}   ‘ `   ’ '   “ ``   ” ''   ß \ss{}   æ \ae{}
    Æ \AE{}   ø \o{}   Ø \O{}   ł \l{}
    Ł \L{}   ı \i{}   § \S{}   ° $^\circ$   ± $\pm$   × $\times$   · $\cdot$
    ≤ $\leq$   ≥ $\geq$   ≈ $\approx$
    → $\rightarrow$   ∞ $\infty$   √ $\surd$   ² $^2$   ³ $^3$   µ $\mu$
    α $\alpha$   β $\beta$   γ $\gamma$
    δ $\delta$   Δ $\Delta$   θ $\theta$   λ $\lambda$   μ $\mu$   π $\pi$
    σ $\sigma$   Σ $\Sigma$   τ $\tau$
    φ $\varphi$   χ $\chi$   ω $\omega$   Ω $\Omega$
""")
_MARKS = "\u0300\u0301\u0302\u0303\u0304\u0306\u0307\u0308\u030a\u030b\u030c\u0323\u0327"
ACCENTS = dict(zip(_MARKS, "`'^~=u.\"rHvdc", strict=True))


def escaped(text: str) -> str:
    """Return `text` as one line of ASCII that LaTeX prints literally, so that no character acts as
    a command.
    Letters with accents become LaTeX's accents; a character that fonts may not have becomes its
    code point, such as U+624B."""
    return "".join(map(_character, " ".join(unicodedata.normalize("NFC", text).split())))


def _character(character: str) -> str:
    if character in CHARACTERS:
        return CHARACTERS[character]
    if character.isascii() and character.isprintable():
        return character
    letter, *marks = unicodedata.normalize("NFD", character)
    if len(marks) == 1 and marks[0] in ACCENTS and letter.isascii() and letter.isalpha():
        return rf"\{ACCENTS[marks[0]]}{{{letter}}}"
    return f"U+{ord(character):04X}"


def latex(result: Result) -> str:
    """Return all figures of a result as LaTeX tables: one for each reference surface, and one for
    the methods under equal treatment (same smoothing, common pixels).
    A table with more than five methods (COLUMNS) is split into several. Below each figure are its
    95 % interval and the paper's figure."""
    found = blocks(result)
    facts = caption(result) + best_note(found)
    return "\n".join(
        _block_table(result.about.name, block, part, facts)
        for block in found
        for part in _parts(block)
    )


def column(result: Result) -> str:
    """Return the metrics of the paper's table and the main ones, against the result's first
    reference surface, as LaTeX tables that fit one column of IEEEtran.
    Our figures are above the paper's. A table has at most four methods (ABREAST). The text is empty
    if the result has no figures."""
    found = blocks(result)[:1]
    return "\n".join(
        _narrow(result.about.name, paper_block(block), part)
        for block in found
        for part in _parts(block, ABREAST)
    )


def _narrow(name: str, block: Block, part: slice) -> str:
    lines = [line for line in block.lines if line.source in ("ours", "paper")]
    body = _body(lines, part, rf"{TITLE_PT}pt", False)
    wide_pt = (COLUMN_PT - TITLE_PT) / len(block.methods[part]) - 2 * SEP_PT
    heads = (
        rf"\parbox[b]{{{wide_pt:.1f}pt}}{{\centering\hspace{{0pt}}{escaped(m)}}}"
        for m in block.methods[part]
    )
    interval = any(" [" in cell for line in lines for cell in line.cells[part])
    text = (
        f"{name} {AGAINST[block.reference]}, ours and the "
        f"paper's{' (continued)' if part.start else ''}"
    )
    text += ". In brackets the 95 % confidence interval" * interval + f".{best_note([block])}"
    columns = rf"@{{}}p{{{TITLE_PT}pt}}{_s_columns(lines, part)}@{{}}"
    return float_table(text, columns, ("", *heads), body, "table", SEP_PT)


def _parts(block: Block, abreast: int = COLUMNS) -> list[slice]:
    """Divide the methods of a table into as few parts of at most `abreast` methods as possible,
    with sizes that differ by at most one. Returns a slice of the methods for each part."""
    count = len(block.methods)
    parts = max(-(-count // abreast), 1)
    edges = [count * i // parts for i in range(parts + 1)]
    return [slice(*pair) for pair in pairwise(edges)]


def _block_table(name: str, block: Block, part: slice, facts: str) -> str:
    body = _body(block.lines, part, TITLE, True)
    text = f"{name}. {block.heading}{' (continued)' if part.start else ''}. {facts}"
    head = ("Metric", "", *map(escaped, block.methods[part]))
    return float_table(text, f"p{{{TITLE}}}l{_s_columns(block.lines, part)}", head, body)


def _body(lines: Iterable[Line], part: slice, wide: str, sources: bool) -> list[str]:
    """Return the LaTeX rows of several lines of a table, with a gap between metrics.
    part: the methods shown; wide: width of the column with the titles, as a LaTeX length; sources:
    whether a column names the source of the figures (ours or the paper's)."""
    body: list[str] = []
    for _, group in groupby(lines, key=lambda line: line.metric):
        rows = [row for line in group for row in _line_rows(line, part, wide, sources)]
        body += ([r"\addlinespace"] if body else []) + rows
    return body


def _line_rows(line: Line, part: slice, wide: str, sources: bool) -> list[str]:
    """Return the LaTeX row of one line's figures and, if any figure has an interval, a row with the
    intervals below it; no rows if all figures are missing.
    part: the methods shown; wide: width of the column with the titles, as a LaTeX length; sources:
    whether a column names the source of the figures; otherwise the source replaces an empty
    title."""
    if not set(line.cells[part]) - {NONE}:
        return []
    cells = [cell.partition(" ")[::2] for cell in line.cells[part]]
    stars = line.best[part] or (False,) * len(cells)
    title = (
        title_with_unit(line.title.removesuffix(f" ({line.unit})"), line.unit) if line.title else ""
    )
    known = any(interval for _, interval in cells)
    title = rf"\parbox[t]{{{wide}}}{{\raggedright {title}\strut}}" if title else ""
    if known and title:  # reaches down next to the intervals, if it takes two lines
        title = rf"\raisebox{{0pt}}[0pt][0pt]{{{title}}}"
    shown = [
        rf"\bfseries {value}" if star else value
        for (value, _), star in zip(cells, stars, strict=True)
    ]
    values = ["{--}" if value.endswith(NONE) else value.replace("−", "-") for value in shown]
    source = escaped(line.source)
    rows = [row([*([title, source] if sources else [title or rf"\quad {source}"]), *values])]
    if known:
        size = r"\scriptsize" if sources else r"\fontsize{6}{7}\selectfont"
        rows.append(
            row(
                [
                    *([""] * (1 + sources)),
                    *(f"{{{size} {escaped(interval)}}}" for _, interval in cells),
                ]
            )
        )
    return rows


def _s_columns(lines: Iterable[Line], part: slice) -> str:
    """Return LaTeX's column specification for the figures of several lines: one siunitx column for
    each method in `part`."""
    return "".join(
        _s_column(cells) for cells in zip(*(line.cells[part] for line in lines), strict=True)
    )


def _s_column(cells: Iterable[str]) -> str:
    """Return the specification of a siunitx column that has room for the widest of these numbers,
    on both sides of the decimal point."""
    numbers = [cell.partition(" ")[0].partition(".") for cell in cells if cell != NONE]
    sign = "-" if any(whole.startswith("−") for whole, _, _ in numbers) else ""
    before = max((len(whole.lstrip("−")) for whole, _, _ in numbers), default=1)
    after = max((len(fraction) for _, _, fraction in numbers), default=0)
    return f"S[table-format={sign}{before}.{after},detect-weight]"


def comparisons(result: Result) -> str:
    """Return LaTeX tables of all tested differences between methods, one for each metric and
    reference surface.
    A row has the better and the worse method, the difference with its interval, p-value and effect
    size. The text is empty if nothing was compared."""
    titles = result.about.method_titles
    texts = []
    defined = result.comparisons[result.comparisons.metric.isin(result.about.metrics)]
    for (reference, metric), group in defined.groupby(["reference", "metric"], sort=False):
        facts = result.about.metrics[metric]
        body = []
        for c in each(group):
            names = [titles.get(name, name) for name in (c.better, c.worse)]
            difference = figure(c.difference, c.low, c.high, c.unit)
            cells = (*names, difference, p_text(c.p_corrected), number(c.effect, 2))
            body.append(row(map(escaped, cells)))
        text = (
            f"{result.about.name}. {facts.title} against {reference}: differences with their 95 "
            "% confidence "
            "intervals, p corrected for all pairs (Holm), and the difference over the standard "
            "deviation of the "
            "paired differences (effect)."
        )
        head = ("Ahead", "Behind", title_with_unit("Difference", facts.unit), "p", "Effect")
        texts.append(float_table(text, "llrrr", head, body))
    return "\n".join(texts)


def float_table(
    text: str,
    columns: str,
    head: Iterable[str],
    body: Iterable[str],
    kind: str = "table*",
    gap_pt: float = 3.5,
) -> str:
    """Return a LaTeX float with a booktabs table, as wide as the page or, with kind "table", as a
    column.
    text: caption, as plain text; columns: LaTeX's column specification; head: cells of the first
    row, as LaTeX; body: rows, as LaTeX; gap_pt: half the distance between two columns, points."""
    rows = "\n".join(body)
    return rf"""% needs \usepackage{{booktabs}} and \usepackage{{siunitx}}
\begin{{{kind}}}[{"p" if kind == "table*" else "t"}]
\centering\footnotesize
\caption{{{escaped(text)}}}\smallskip
\setlength{{\tabcolsep}}{{{gap_pt}pt}}
\begin{{tabular}}{{{columns}}}
\toprule
{row(f"{{{title}}}" for title in head)}
\midrule
{rows}
\bottomrule
\end{{tabular}}
\end{{{kind}}}
"""


def title_with_unit(title: str, unit: str) -> str:
    """Return a title for LaTeX followed by its unit, such as "error / mm". The unit is left out if
    the title itself ends with it, as for a number of pixels."""
    return escaped(title) + (
        "" if unit == title.partition(" ")[2] else f" /~{UNITS.get(unit, escaped(unit))}"
    )


def row(cells: Iterable[str]) -> str:
    """Return a row of a LaTeX table. cells: their text, already in LaTeX."""
    return " & ".join(cells) + r" \\"

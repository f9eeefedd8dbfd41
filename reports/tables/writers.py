"""The four writers of a table: Markdown, LaTeX, HTML, and the terminal."""

import html as standard
import re
import unicodedata
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from textwrap import fill

import jinja2
import numpy as np
from markupsafe import Markup
from rich import box
from rich.console import Console
from rich.table import Table as Grid
from rich.text import Text

from handbench.reports.tables.table import Table
from handbench.support.errors import printable
from handbench.support.progress import print_lines

ROWS = 20  # that a terminal shows
HEADING = 12  # characters after which the heading of a number is broken there
PAGE_PT = 495  # width of a LaTeX table on a page
COLUMN_PT = 252  # and in one of the two columns of IEEEtran
NUMBER_PT = 44  # width of a column of numbers
TEXT_PT = 56  # least width of a column of text
GAP_PT = 4  # between two columns
FLOAT_ROWS = 25  # of sentences that take two lines, on a page
HTML = jinja2.Environment(autoescape=True, trim_blocks=True, lstrip_blocks=True).from_string("""\
<div class="scroll" role="region" aria-label="{{ table.caption }}" tabindex="0">
<table>
{% if table.caption %}
<caption>{{ table.caption }}</caption>
{% endif %}
<thead><tr>{% for heading in table.headings %}
<th scope="col" class="{{ 'text' if loop.index0 <= table.left else 'number' }}">{{ heading }}</th>
{%- endfor %}</tr></thead>
<tbody>
{% for row in table.rows %}
<tr>
{% for text in row %}
{% set lines, tag = text.split("\n"), "th" if loop.first else "td" %}
<{{ tag }}{{ ' scope="row"' | safe if loop.first }} class="
{{- 'text' if loop.index0 <= table.left else 'number' }}">
{{- lines[0] }}
{%- for line in lines[1:] %} <small>{{ line }}</small>{% endfor %}</{{ tag }}>
{% endfor %}
</tr>
{% endfor %}
</tbody>
</table>
</div>
""")
# characters and what LaTeX prints as them, in turn; accents by their combining characters
PAIRS = re.findall(
    r"\S+",
    r"""
    \ \textbackslash{}   { \{   } \}   & \&   % \%   $ \$   # \#   _ \_   ~ \textasciitilde{}
    ^ \textasciicircum{}   < \textless{}   > \textgreater{}   | \textbar{}   " ''   [ {[}   ] {]}
    − $-$   – --   — ---   … \ldots{}   ’ '   “ ``   ” ''   ß \ss{}   æ \ae{}   ø \o{}   Ø \O{}
    ł \l{}   Ł \L{}   ° $^\circ$   ± $\pm$   × $\times$   → $\to$\allowbreak{}   · $\cdot$
    ≤ $\leq$   ≥ $\geq$   ² $^2$   ★ $\star$   µ $\mu$   μ $\mu$   λ $\lambda$   π $\pi$
    σ $\sigma$   Δ $\Delta$
""",
)
CHARACTERS = dict(zip(PAIRS[::2], PAIRS[1::2], strict=True))
MARKS = "\u0300\u0301\u0302\u0303\u0304\u0306\u0307\u0308\u030a\u030b\u030c\u0323\u0327"
ACCENTS = dict(zip(MARKS, "`'^~=u.\"rHvdc", strict=True))


def markdown(table: Table) -> str:
    """Return a table as Markdown, with its caption as a heading and small print in italics."""
    numbers = table.texts.shape[1] - table.left
    head = " | ".join(map(escaped, table.headings))
    lines = [f"| {head} |", "|" + "---|" * (1 + table.left) + "--:|" * numbers]
    for row in table.rows:
        cells = (_cell(text, escaped, "*%s*", " ") for text in row)
        lines.append(f"| {' | '.join(cells)} |")
    heading = f"## {escaped(table.caption)}\n\n" if table.caption else ""
    return heading + "\n".join(lines) + "\n"


def escaped(text: str) -> str:
    """Return `text` on one line for a cell of a Markdown table, escaped so that Markdown and HTML
    show it literally."""
    return re.sub(
        r"([\\`*_\[\]|#~$])", r"\\\1", standard.escape(" ".join(text.split()), quote=False)
    )


def _cell(text: str, escape: Callable[[str], str], small: str, between: str) -> str:
    """Return a cell in Markdown or LaTeX, whose characters `escape` escapes. small: form of small
    print; between: what joins its lines."""
    first, *further = map(escape, text.split("\n"))
    return between.join((first, *(small % line for line in further)))


def html(table: Table) -> Markup:
    """Return a table as HTML, in a region that scrolls where the table is wider than the page."""
    return Markup(HTML.render(table=table))


def latex(label: str, *tables: Table, width_pt: float = PAGE_PT) -> str:
    """Return tables as LaTeX floats, as many as are needed for their columns and rows.
    label: of the float, "tab:column" for instance; several are numbered, "tab:table-1". width_pt:
    at most COLUMN_PT for one column of a page with two. The document needs no package and any
    encoding: characters outside ASCII are written as commands."""
    parts = [part for table in tables for part in _parts(table, width_pt)]
    labels = [f"{label}-{number}" for number in range(1, len(parts) + 1)] if parts[1:] else [label]
    return "\n".join(map(partial(_float, width_pt), labels, parts))


def _parts(table: Table, width_pt: float) -> list[Table]:
    """Return a table as several that are each narrow and short enough for a float."""
    texts, numbers = range(table.left), range(table.left, table.texts.shape[1])
    texts_pt = (1 + table.left) * (TEXT_PT + GAP_PT)
    abreast = int((width_pt - texts_pt) // (NUMBER_PT + GAP_PT))
    parts = np.array_split(numbers, max(-(-len(numbers) // abreast), 1))
    starts = range(0, max(len(table.texts), 1), FLOAT_ROWS)
    return [
        _part(table, [*texts, *part], slice(start, start + FLOAT_ROWS))
        for start in starts
        for part in parts
    ]


def _part(table: Table, columns: list[int], rows: slice = slice(None)) -> Table:
    """Return a table with some of its columns and rows."""
    return replace(table, texts=table.texts.iloc[rows, columns])


def _float(width_pt: float, label: str, table: Table) -> str:
    """Return a table as one LaTeX float."""
    texts, numbers = 1 + table.left, table.texts.shape[1] - table.left
    text_pt = (width_pt - numbers * (NUMBER_PT + GAP_PT)) / texts - GAP_PT
    columns = f"p{{{text_pt:.1f}pt}}" * texts + f"p{{{NUMBER_PT}pt}}" * numbers
    sides = [r"\raggedright"] * texts + [r"\raggedleft"] * numbers
    kind = "table*" if width_pt > COLUMN_PT else "table"
    rows = [
        " & ".join(
            rf"{side}\hspace{{0pt}}" + _cell(cell, tex, r"{\scriptsize %s}", r"\\") + r"\strut"
            for side, cell in zip(sides, row, strict=True)
        )
        for row in (table.headings, *table.rows)
    ]
    head, *body = (rf"{row} \tabularnewline" for row in rows)
    body_text = "\n".join(body)
    return rf"""\begin{{{kind}}}[tp]
\providecommand{{\toprule}}{{\hline}}\providecommand{{\midrule}}{{\hline}}
\providecommand{{\bottomrule}}{{\hline}}
\centering\footnotesize\setlength{{\tabcolsep}}{{{GAP_PT / 2}pt}}
\caption{{{tex(table.caption)}}}\label{{{label}}}\smallskip
\begin{{tabular}}{{@{{}}{columns}@{{}}}}
\toprule
{head}
\midrule
{body_text}
\bottomrule
\end{{tabular}}
\end{{{kind}}}
"""


def tex(text: str) -> str:
    """Return `text` as one line of ASCII that LaTeX prints literally, so that no character acts as
    a command.
    Letters with accents become LaTeX's accents; a character that fonts may not have becomes its
    code point, such as U+624B."""
    return "".join(map(_tex_character, " ".join(unicodedata.normalize("NFC", text).split())))


def _tex_character(character: str) -> str:
    if character in CHARACTERS:
        return CHARACTERS[character]
    if character.isascii() and character.isprintable():
        return character
    decomposed = unicodedata.normalize("NFD", character)
    letter, mark = decomposed[0], decomposed[1:]
    if mark in ACCENTS and letter.isascii() and letter.isalpha():
        return rf"\{ACCENTS[mark]}{{{letter}}}"
    return f"U+{ord(character):04X}"


def terminal(table: Table, rest: str = "") -> None:
    """Print a table on stdout, without small print and never wider than the terminal (80 characters
    in a pipe). Columns that do not fit beside the others follow below; no number is broken.
    Nothing is printed for a table without figures. rest: where the rows after the first 20 (ROWS)
    are."""
    if table.texts.empty:
        return
    console, texts = Console(highlight=False), [*range(table.left)]
    unlimited = console.options.update(width=10_000)
    parts = [texts]
    for column in range(table.left, table.texts.shape[1]):
        part = [*parts[-1], column]
        wide = console.measure(_grid(_part(table, part)), options=unlimited).maximum > console.width
        if wide and parts[-1] != texts:
            parts.append([*texts, column])
        else:
            parts[-1] = part
    if table.caption:
        console.print(Text(printable(table.caption)))
    for part in parts:
        console.print(_grid(_part(table, part)), "")
    if (more := len(table.texts) - ROWS) > 0:
        print_lines(f"… {more} more in {rest}")


def _grid(table: Table) -> Grid:
    """Return a table for the terminal. Text may be broken between words, headings of numbers after
    about 12 characters (HEADING), numbers nowhere."""
    grid = Grid(box=box.SIMPLE_HEAD, show_edge=False, pad_edge=False, padding=(0, 1, 0, 0))
    for column, heading in enumerate(table.headings):
        if column <= table.left:
            grid.add_column(_first_line(heading), overflow="fold")
        else:
            heading = fill(printable(heading), HEADING, break_long_words=False)
            grid.add_column(Text(heading), justify="right", no_wrap=True)
    for row in table.rows[:ROWS]:
        grid.add_row(*map(_first_line, row))
    return grid


def _first_line(text: str) -> Text:
    return Text(printable(text.split("\n")[0]))


def notes(*texts: str) -> None:
    """Print texts on stdout, as many on a line as fit on it; none is broken."""
    width = Console().width
    lines = [""]
    for text in texts:
        joined = "; ".join(filter(None, (lines[-1], text)))
        if not lines[-1] or len(joined) <= width:
            lines[-1] = joined
        else:
            lines.append(text)
    print_lines(*lines)

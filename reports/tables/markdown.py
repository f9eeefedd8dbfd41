"""Markdown: tables, and text in which nothing of a stranger's is markup."""

import html
import re
from collections.abc import Iterable, Sequence


def table(headings: Sequence[str], lines: Iterable[Sequence[str]], texts: int = 1) -> str:
    """A table of cells that are Markdown already; the first `texts` columns to the left, the others to the right."""
    rule = "|" + "---|" * texts + "--:|" * (len(headings) - texts)
    return "\n".join([_line(headings), rule, *map(_line, lines)]) + "\n"


def _line(cells: Sequence[str]) -> str:
    return "| " + " | ".join(cells) + " |"


def escaped(text: str) -> str:
    """`text` as it is, on one line."""
    return re.sub(r"([\\`*_\[\]|#~$])", r"\\\1", html.escape(" ".join(text.split()), quote=False))


def bold(text: str) -> str:
    """Markdown `text` in bold."""
    return f"**{text}**"

"""The report of a trade-off (accuracy against time of many settings): its tables and pictures, in
the page of a result or on a separate page."""

from pathlib import Path
from typing import Any

from handbench.bench.results import Section, Setting, Tradeoff, load_tradeoff
from handbench.reports.figures.fronts import is_plottable, metric_words, pictures
from handbench.reports.page import rendering
from handbench.reports.page.sections import Grid
from handbench.reports.tables import latex, result_tables
from handbench.reports.tables.blocks import (
    NONE,
    error_text,
    figure,
    is_known,
    number,
    rounded,
    seconds_text,
)
from handbench.support.errors import HandbenchError
from handbench.support.files import write_text


def build(folder: str | Path, out: str | Path) -> Path:
    """Write the report of the trade-off in `folder` to `out`, which may be the same folder:
    front.md, front.tex, index.html and pictures in figures/.
    Returns the path of index.html. Raises HandbenchError if the trade-off has no setting."""
    found, out = load_tradeoff(folder), Path(out)
    if not found.settings:
        raise HandbenchError(
            f"{found.folder / 'tradeoff.csv'}: has no settings; run `handbench tradeoff` again"
        )
    rendering.begin(out)
    page = rendering.render("tradeoff.html", facts=found.facts, up="", tradeoff=section(found, out))
    write_text(out / "index.html", page)
    return out / "index.html"


def section(found: Tradeoff, out: Path) -> dict[str, Any]:
    """Write the tables and pictures of a trade-off to `out`, and return the content of its section
    in a page.
    It has "parts", the pictures and the table of settings of each stage, and "claims", a table of
    the paper's statements about time."""
    write_text(out / "front.md", result_tables.tradeoff_markdown(found))
    write_text(out / "front.tex", latex.tradeoff(found))
    saved = {
        image.stem: image for image in rendering.images(lambda: pictures(found), out / "figures")
    }
    parts = []
    for about in found.facts.sections:
        shown = [saved[stem] for stem in (f"front_{about.name}",) if stem in saved]
        parts.append((about, shown, settings_grid(about, found.section(about.name))))
    return {"parts": parts, "claims": claims_grid(found)}


def settings_grid(about: Section, settings: tuple[Setting, ...]) -> Grid:
    """Return a table of all settings of one section of a trade-off, first those that no other beats
    (the front).
    A row has the setting's number in the picture or the setting that beats it, and error, share of
    the surface that was observed, time, operations and memory."""
    best = sorted((s for s in settings if s.on_front), key=lambda s: s.seconds or 0)
    rest = [s for s in settings if not s.on_front]
    titles = {s.name: s.title for s in settings}
    numbers = {s.name: str(i) for i, s in enumerate((s for s in best if is_plottable(s)), 1)}
    error = f"{metric_words(about)} ({about.unit})"
    rest_of = ("seen (%)", "time (s)", "÷ reference", "operations", "memory (MB)")
    rows = tuple(
        (
            s.title,
            # On the front, where no number can say so, or by what it is beaten.
            numbers.get(s.name)
            or ("front" if s.on_front else titles.get(s.dominated_by, s.dominated_by) or NONE),
            error_text(s),
            figure(s.seen_percent, None, None, "%"),
            seconds_text(s),
            rounded(s.ratio),
            f"{s.operations:.2g}" if is_known(s.operations) else NONE,
            number(s.peak_memory_mb, 0),
        )
        for s in (*best, *rest)
    )
    caption = f"{about.title}: {len(best)} settings on the front, {len(rest)} beaten"
    return Grid(caption, ("setting", "number, or beaten by", error, *rest_of), rows, texts=2)


def claims_grid(found: Tradeoff) -> Grid | None:
    """Return a table of the paper's statements about time: the factor by which one method is faster
    than another, as stated in the paper, by counted operations, and as measured here. None if there
    is no statement."""
    rows = tuple(
        (
            claim.text,
            claim.note,
            *(_factor(value) for value in (claim.paper, claim.counted, claim.measured)),
        )
        for claim in found.facts.claims
    )
    headings = ("claim", "how", "paper", "operations, counted", "time, measured")
    return Grid("The paper's factors next to ours", headings, rows, texts=2) if rows else None


def _factor(value: float | None) -> str:
    return (f"× {value:.3g}" if value < 1000 else f"× {value:.0f}") if is_known(value) else NONE

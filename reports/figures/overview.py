"""The pictures of a report, as PNG and PDF."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from pathlib import Path

import matplotlib

from bench.results import HEADLINE, CaptureFacts, Result
from radar.support.files import atomic_path
from reports.figures.charts import accuracy_against_time, error_distributions, repeats
from reports.figures.depth_maps import depth_maps, error_maps
from reports.figures.style import AGAINST, STYLE, Picture, Saved


def overview(result: Result) -> Iterator[Picture]:
    """The pictures of all captures together that the result has the data for."""
    if (result.table.metric == HEADLINE).any():
        yield accuracy_against_time(result)
    if result.about.methods and any(capture.references for capture in result.scored()):
        yield error_distributions(result)
    if len(result.repeats):
        yield repeats(result)


def panels(result: Result, capture: CaptureFacts) -> Iterator[Picture]:
    """One capture's pictures."""
    if result.about.methods:
        yield depth_maps(result, capture)
        for reference in AGAINST:
            if reference in capture.references:
                yield error_maps(result, capture, reference)


def save(pictures: Iterable[Picture], folder: Path) -> list[Saved]:
    """Write STEM.png and STEM.pdf of every picture into `folder`; each figure is let go before the next is drawn."""
    saved = []
    with matplotlib.rc_context(STYLE):
        for picture in pictures:
            for suffix, metadata in ((".png", {}), (".pdf", {"CreationDate": None})):  # same data, same bytes
                with atomic_path(folder / f"{picture.stem}{suffix}") as temporary:
                    picture.figure.savefig(temporary, metadata=metadata)
            saved.append(Saved(picture.stem, picture.caption, picture.alt, folder / f"{picture.stem}.png"))
    return saved

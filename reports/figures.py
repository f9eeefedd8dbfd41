"""The pictures of a report, as PNG and PDF."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import matplotlib

from bench.results import Result, atomic_path
from reports.charts import accuracy_against_time, error_distributions, repeats
from reports.maps import depth_maps, error_maps
from reports.style import STYLE, Picture


def pictures(result: Result) -> Iterator[Picture]:
    """Every picture that the result has the data for."""
    scored = [capture for capture in result.scored() if result.about.methods]
    if any(row.metric == "mae_mm" for row in result.rows):
        yield accuracy_against_time(result)
    for capture in scored:
        yield depth_maps(result, capture)
        if capture.references:
            yield error_maps(result, capture)
    if any(capture.references for capture in scored):
        yield error_distributions(result)
    if result.repeats:
        yield repeats(result)


def save(result: Result, folder: Path) -> list[Picture]:
    """Write STEM.png and STEM.pdf of every picture into `folder`."""
    saved = []
    with matplotlib.rc_context(STYLE):
        for picture in pictures(result):
            for suffix, metadata in ((".png", {}), (".pdf", {"CreationDate": None})):  # same data, same bytes
                with atomic_path(folder / f"{picture.stem}{suffix}") as temporary:
                    picture.figure.savefig(temporary, metadata=metadata)
            saved.append(picture)
    return saved

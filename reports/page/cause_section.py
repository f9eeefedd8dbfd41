"""The section on where the errors come from: pictures and tables of causes and reliability."""

from pathlib import Path
from typing import Any

from handbench.bench.results import Result, each
from handbench.reports.figures.charts import CAUSES, bin_label, explained
from handbench.reports.figures.style import methods
from handbench.reports.page import rendering
from handbench.reports.page.sections import Grid
from handbench.reports.tables.blocks import AGAINST, NONE, number


def section(result: Result, folder: Path) -> dict[str, Any] | None:
    """Its pictures, written into `folder`, and tables; None where the result tells neither causes nor reliability."""
    grids = [*by_cause(result), *reliability(result)]
    return {"pictures": rendering.images(lambda: explained(result), folder), "grids": grids} if grids else None


def by_cause(result: Result) -> list[Grid]:
    """One table for each reference: a line a bin, a column a method."""
    grids, shown = [], methods(result)
    for reference, lines in result.causes.groupby("reference", sort=False):
        rows: dict[tuple[str, str], dict[str, str]] = {}
        known = lines[lines.cause.isin(CAUSES)]
        for line in sorted(each(known), key=lambda x: (list(CAUSES).index(x.cause), x.part, x.low)):
            cell = f"{number(line.absolute_mm, 2)} [{number(line.mean_mm, 2)}] {line.n_pixels}/{line.n_captures}"
            rows.setdefault((CAUSES[line.cause], bin_label(line)), {})[line.method] = cell
        caption = (
            f"Errors by cause, {AGAINST.get(str(reference), str(reference))}: mean |z − z_ref| [mean z − z_ref] in mm, "
            "pixels / captures"
        )
        cells = tuple((*place, *(found.get(m.name, NONE) for m in shown)) for place, found in rows.items())
        grids.append(Grid(caption, ("cause", "bin", *(m.title for m in shown)), cells, texts=2))
    return grids


def reliability(result: Result) -> list[Grid]:
    """One table for each reference: a line a method, a column a nominal coverage."""
    grids, titles = [], {m.name: m.title for m in result.about.methods}
    for reference, lines in result.reliability.groupby("reference", sort=False):
        nominal = sorted(set(lines.nominal_percent))
        rows = []
        for _, mine in lines.groupby(["method", "pixels"], sort=False):
            shares = mine.set_index("nominal_percent").observed_percent.reindex(nominal)
            first = next(each(mine))
            figures = (*(number(share, 1) for share in shares), number(first.nll, 2), f"{first.n_pixels}")
            rows.append((titles.get(first.method, first.method), first.pixels, *figures))
        known = "with" if lines.reference_sigma.all() else "without a known"
        caption = (
            f"Reliability of σ {AGAINST.get(str(reference), str(reference))}, {known} σ of the reference: observed "
            "coverage in % under the nominal one, mean negative log-likelihood in mm"
        )
        headings = ("method", "pixels", *(f"{percent:g} %" for percent in nominal), "NLL", "count")
        grids.append(Grid(caption, headings, tuple(rows), texts=2))
    return grids

"""Doubts about a mesh and a result folder by themselves."""

from collections.abc import Iterator

import numpy as np

from handbench.bench.results import HEADLINE, Result
from handbench.bench.results.tables import each
from handbench.groundtruth.mesh.surface import Surface

OPEN = 0.1  # share of a surface's edges at its rim, where it is no surface any more
FARTHEST_MM = 50.0  # mean error of what may still be an image


def of_mesh(surface: Surface) -> Iterator[str]:
    """Doubts about a surface: inside out, if it is closed; full of holes, if it is not."""
    edges = np.sort(surface.faces[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)
    rim = float((np.unique(edges, axis=0, return_counts=True)[1] == 1).mean())
    a, b, c = np.moveaxis(surface.vertices_m[surface.faces], 1, 0)
    if rim == 0 and np.einsum("ij,ij->", a, np.cross(b, c)) < 0:  # six times its volume
        yield "its triangles are inside out: reverse the order of each one's vertices"
    if rim > OPEN:
        yield f"{100 * rim:.0f} % of its edges belong to one triangle alone: fill its holes, or merge equal vertices"


def of_result(result: Result) -> Iterator[str]:
    """Doubts that a run has recorded, what failed, and figures that no image has."""
    for capture, texts in result.about.facts.get("doubts", {}).items():
        yield from (f"{capture}: {text}" for text in texts)
    yield from (failure.line for failure in result.about.failures)
    for row in each(result.table):
        share = row.metric in ("relative_accuracy_percent", "relative_precision_percent")
        if (share and not 0 <= row.value <= 100) or (row.metric == HEADLINE and row.value > FARTHEST_MM):
            figure = f"{result.title(row.metric)} is {row.value:.4g} {row.unit}"
            yield f"{row.method}: {figure}: `handbench inspect` the captures"

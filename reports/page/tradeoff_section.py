"""The report's section "Accuracy against time": the settings of methods and of the ground truth,
and those that no other beats."""

from pathlib import Path

from handbench.bench.results.result_folder import Result
from handbench.reports.figures.fronts import is_swept, pictures, ranked_methods
from handbench.reports.page import rendering
from handbench.reports.page.rendering import Image
from handbench.reports.tables.table import Table, settings


def section(result: Result, folder: Path) -> list[tuple[Image, Table]]:
    """Draw the pictures of the section into `folder`. Returns a picture and a table for each error
    (of depth maps, of reconstructed surfaces); nothing for a result without several settings."""
    if not is_swept(result):
        return []
    titles = result.about.method_titles
    tables = [settings(*item, titles) for item in ranked_methods(result).items()]
    images = rendering.images(lambda: pictures(result), folder)
    return list(zip(images, tables, strict=True))

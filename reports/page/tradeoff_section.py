"""The report's section "Accuracy against time": the settings of methods and of the ground truth,
and those that no other beats."""

from collections.abc import Mapping
from pathlib import Path

import pandas as pd

from handbench.bench.evaluation.front import front
from handbench.bench.evaluation.metrics import METRICS
from handbench.bench.results.result_folder import Result
from handbench.reports.figures.fronts import is_swept, pictures, ranked_methods
from handbench.reports.page import rendering
from handbench.reports.page.rendering import Image
from handbench.reports.page.sections import Grid
from handbench.reports.tables.blocks import rounded
from handbench.reports.tables.rounding import figure


def section(result: Result, folder: Path) -> list[tuple[Image, Grid]]:
    """Draw the pictures of the section into `folder`. Returns a picture and a table for each error
    (of depth maps, of reconstructed surfaces); nothing for a result without several settings."""
    if not is_swept(result):
        return []
    titles = result.about.method_titles
    grids = [settings_grid(*item, titles) for item in ranked_methods(result).items()]
    images = rendering.images(lambda: pictures(result), folder)
    return list(zip(images, grids, strict=True))


def settings_grid(metric: str, settings: pd.DataFrame, titles: Mapping[str, str]) -> Grid:
    """Return a table of ranked settings: first the front, numbered as in the picture, then the
    others, each with the setting that beats it.
    metric: that of the error; titles: name → title (missing: the name itself)."""
    best = front(settings)
    numbers = {name: str(number) for number, name in enumerate(best.index, 1)}
    lines = pd.concat([best, settings[~settings.on_front]])
    rows = tuple(
        (
            titles.get(name, name),
            numbers.get(name) or titles.get(line.dominated_by, line.dominated_by),
            figure(line.error, line.low, line.high, METRICS[metric].unit),
            figure(line.observed_percent, None, None, "%"),
            figure(line.seconds, line.seconds_low, line.seconds_high, "s"),
            rounded(line.ratio),
        )
        for name, line in ((str(name), line) for name, line in lines.iterrows())
    )
    error = f"{METRICS[metric].title} ({METRICS[metric].unit})"
    headings = ("setting", "number, or beaten by", error, "observed (%)", "time (s)", "÷ best")
    caption = f"{METRICS[metric].title} against time: {len(best)} settings that no other beats"
    return Grid(caption, headings, rows, texts=2)

"""Pictures of accuracy against time."""

from __future__ import annotations

from dataclasses import replace

import pandas as pd

from handbench.bench.evaluation.tables import SCORES, frame
from handbench.bench.results.result_folder import load
from handbench.reports.figures import fronts
from tests.golden_files import RESULT


def test_depths_and_surfaces_have_a_picture_each():
    """Of two settings of a mesh, each is the better in one of error and time."""
    lines = [
        ("B", f"{views:g}-views", "truth", "", 0, metric, value)
        for views in (5.0, 8.0)
        for metric, value in (
            ("surface_rms_mm", 1 / views),
            ("observed_percent", 80.0),
            ("seconds", views),
        )
    ]
    result = load(RESULT)
    result = replace(result, scores=pd.concat([result.scores, frame(SCORES, lines)]))
    depths, surfaces = fronts.pictures(result)
    assert (depths.stem, surfaces.stem) == ("front_mae_mm", "front_surface_rms_mm")
    [axis] = surfaces.figure.axes
    [front] = [line for line in axis.lines if line.get_label() == "front"]
    assert front.get_xydata().tolist() == [[5.0, 0.2], [8.0, 0.125]]

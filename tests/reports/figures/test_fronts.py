"""Pictures and tables of accuracy against time."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from handbench.bench.results.result_folder import load
from handbench.reports.figures import fronts
from handbench.reports.tables.table import settings
from tests.reports.synthetic_result import METHODS, write_synthetic

MESHES = {
    f"{views}-views": {"surface_rms_mm": 1 / views, "observed_percent": 80.0, "seconds": views}
    for views in (5.0, 8.0)
}


def test_each_error_has_a_picture_and_a_table(tmp_path):
    methods = {"3fsk": METHODS["3fsk"], "3fsk-slow": ("3-FSK, slow", 2.0, 1.0)}
    folder = write_synthetic(tmp_path / "r", ("B",), methods, ("truth",), 6e-3, meshes=MESHES)
    result = load(folder)
    stems = [picture.stem for picture in fronts.pictures(result)]
    assert stems == ["front_mae_mm", "front_surface_rms_mm"]
    ranked = fronts.ranked_methods(result).items()
    depths, surfaces = (settings(*item, result.about.method_titles).texts for item in ranked)
    assert depths.index.tolist() == ["3-FSK", "3-FSK, slow"]
    assert surfaces.iloc[:, 0].to_dict() == {"5.0-views": "1", "8.0-views": "2"}


def test_points_that_lie_together_share_a_label():
    """One point per decade would have its own; the second, third and fifth lie together."""
    axis = Figure().subplots()
    axis.set(xscale="log", yscale="log", xlim=(1e-3, 1), ylim=(0.1, 10))
    places = np.array([(2e-3, 5.0), (0.1, 1.0), (0.101, 1.0), (0.1015, 3.0), (0.102, 1.01)])
    expected = [("1", (2e-3, 5.0)), ("2, 3, 5", (0.1, 1.0)), ("4", (0.1015, 3.0))]
    assert list(fronts._labels(axis, places)) == expected

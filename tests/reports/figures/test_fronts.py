"""The section "Accuracy against time" of a report, and its pictures."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from handbench.bench.results.result_folder import load
from handbench.reports.figures import fronts
from handbench.reports.page import html, rendering
from tests.reports.synthetic_result import METHODS, write_synthetic

MESHES = {
    f"{views}-views": {"surface_rms_mm": 1 / views, "observed_percent": 80.0, "seconds": views}
    for views in (5.0, 8.0)
}


def test_several_settings_of_a_method_have_a_section(tmp_path):
    methods = {"3fsk": METHODS["3fsk"], "3fsk-slow": ("3-FSK, slow", 2.0, 1.0)}
    folder = write_synthetic(tmp_path / "r", ("B",), methods, ("truth",), 6e-3, meshes=MESHES)
    result, out = load(folder), tmp_path / "out"
    rendering.begin(out)
    (image, settings), (_, surfaces) = html.tradeoff(result, out / "figures")
    assert image.stem == "front_mae_mm" and (out / "figures" / "front_mae_mm.png").is_file()
    assert settings.texts.index.tolist() == ["3-FSK", "3-FSK, slow"]
    assert surfaces.texts.iloc[:, 0].to_dict() == {"5.0-views": "1", "8.0-views": "2"}


def test_different_methods_alone_have_none(tmp_path):
    folder = write_synthetic(tmp_path / "r", ("B",), METHODS, ("truth",), 6e-3)
    assert html.tradeoff(load(folder), tmp_path) == []


def test_points_that_lie_together_share_a_label():
    """One point per decade would have its own; the second, third and fifth lie together."""
    axis = Figure().subplots()
    axis.set(xscale="log", yscale="log", xlim=(1e-3, 1), ylim=(0.1, 10))
    places = np.array([(2e-3, 5.0), (0.1, 1.0), (0.101, 1.0), (0.1015, 3.0), (0.102, 1.01)])
    expected = [("1", (2e-3, 5.0)), ("2, 3, 5", (0.1, 1.0)), ("4", (0.1015, 3.0))]
    assert list(fronts._labels(axis, places)) == expected

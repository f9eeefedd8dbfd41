"""The target's drawing: true scale, the right way round."""

import re

import numpy as np
import pytest
from matplotlib import rcParams
from matplotlib.figure import Figure
from matplotlib.patches import Circle

from handbench.calibration.spheres.description import default_target
from handbench.reports.drawings.sheets import BAR_MM, INCH_MM, save
from handbench.reports.drawings.target_drawing import target_sheet


def on_page_mm(figure: Figure, patch: Circle):
    """Centre and radius of a circle on the page, millimetres."""
    scale = INCH_MM / figure.dpi
    x, y = (
        patch.axes.transData.transform([patch.center, np.add(patch.center, (patch.radius, 0))])
        * scale
    )
    return x, np.linalg.norm(y - x)


def test_the_views_are_at_true_scale_and_not_mirrored():
    target = default_target()
    figure = target_sheet(target, "")
    circles = [patch for axes in figure.axes for patch in axes.patches if isinstance(patch, Circle)]
    assert len(circles) == 4 * len(target.element)  # foam and ball, front and side
    for view, columns in ((0, [-1, 2]), (2, [3, 2])):
        foam, balls = circles[view::4], circles[view + 1 :: 4]
        seen = np.array([on_page_mm(figure, patch)[0] for patch in balls])
        wanted = 1000 * np.stack(
            [np.sign(c) * target.centres_m[:, abs(c) - 1] for c in columns], axis=1
        )
        # Floating point: the page is 500 mm, and figures count in pixels.
        assert np.abs((seen - seen[0]) - (wanted - wanted[0])).max() < 1e-6
        for patches, radius in ((balls, "ball_radius_m"), (foam, "sphere_radius_m")):
            wanted = [1000 * getattr(element, radius) for element in target.element]
            found = [on_page_mm(figure, patch)[1] for patch in patches]
            assert found == pytest.approx(wanted, abs=1e-6)


def test_the_scale_bar_and_the_page_of_the_pdf_are_true_to_scale(tmp_path, monkeypatch):
    figure = target_sheet(default_target(), "$\\frac{1}$")
    [bar] = figure.findobj(lambda artist: artist.get_gid() == "scale-bar")
    ends = bar.get_transform().transform(bar.get_xydata()) * INCH_MM / figure.dpi
    assert ends[1] - ends[0] == pytest.approx([BAR_MM, 0], abs=1e-6)
    monkeypatch.setitem(rcParams, "savefig.bbox", "tight")  # as a user may have it
    save(tmp_path / "target.pdf", figure)
    [page] = re.findall(rb"/MediaBox \[([^]]*)\]", (tmp_path / "target.pdf").read_bytes())
    size_mm = figure.get_size_inches() * INCH_MM
    assert np.array(page.split(), float)[2:] == pytest.approx(size_mm * 72 / INCH_MM)

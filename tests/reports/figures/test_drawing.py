"""The target's drawing: true scale, the right way round."""

import re

import numpy as np
import pytest
from matplotlib.patches import Circle

from handbench.calibration.target import default_target
from handbench.reports.figures.inputs import BAR_MM, INCH_MM, PRINTED, target_sheet
from handbench.reports.figures.style import save


def test_the_views_are_at_true_scale_and_not_mirrored():
    target = default_target()
    figure = target_sheet(target, "")
    circles = [patch for axes in figure.axes for patch in axes.patches if isinstance(patch, Circle)]
    centres, edges = np.moveaxis(
        [c.axes.transData.transform([c.center, np.add(c.center, (c.radius, 0))]) for c in circles],
        1,
        0,
    )
    scale = INCH_MM / figure.dpi
    radii_mm = scale * np.linalg.norm(edges - centres, axis=1)
    assert len(circles) == 4 * len(target.element)  # foam and ball, front and side
    for view, (right, up) in ((0, (-1, 2)), (2, (3, 2))):  # signed numbers of axes
        seen_mm = scale * centres[view + 1 :: 4]
        wanted_mm = 1000 * target.centres_m[:, [abs(right) - 1, up - 1]] * (np.sign(right), 1)
        # floating point: the page is 500 mm, and figures count in pixels
        np.testing.assert_allclose(
            seen_mm - seen_mm[0], wanted_mm - wanted_mm[0], rtol=0, atol=1e-6
        )
        for first, radius in ((view, "sphere_radius_m"), (view + 1, "ball_radius_m")):
            wanted_mm = [1000 * getattr(element, radius) for element in target.element]
            np.testing.assert_allclose(radii_mm[first::4], wanted_mm, rtol=0, atol=1e-6)


def test_the_scale_bar_and_the_page_of_the_pdf_are_true_to_scale(tmp_path):
    figure = target_sheet(default_target(), "$\\frac{1}$")
    [bar] = figure.findobj(lambda artist: artist.get_gid() == "scale-bar")
    ends = bar.get_transform().transform(bar.get_xydata()) * INCH_MM / figure.dpi
    assert ends[1] - ends[0] == pytest.approx([BAR_MM, 0], abs=1e-6)
    save(figure, tmp_path / "target.pdf", PRINTED)
    [page] = re.findall(rb"/MediaBox \[([^]]*)\]", (tmp_path / "target.pdf").read_bytes())
    size_mm = figure.get_size_inches() * INCH_MM
    assert np.array(page.split(), float)[2:] == pytest.approx(size_mm * 72 / INCH_MM)

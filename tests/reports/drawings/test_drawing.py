"""The target's drawing: true scale on every page, the right way round, legible, and the same bytes
every time."""

import re
from xml.etree import ElementTree

import numpy as np
import pytest
from matplotlib.figure import Figure
from matplotlib.patches import Circle

from handbench.calibration.spheres.description import default_target
from handbench.reports.drawings.sheets import (
    BAR_MM,
    INCH_MM,
    OVERLAP_MM,
    PAPERS_MM,
    Drawing,
    save,
    tiles,
)
from handbench.reports.drawings.target_drawing import target_sheets

HOSTILE = 'a<script>alert("1")</script>&--> $\\frac{1}$ \u4e2d \x1b.toml'
POINTS_PER_MM = 72 / INCH_MM


def on_page_mm(figure: Figure, patch: Circle):
    """Centre and radius of a circle on the page, millimetres."""
    scale = INCH_MM / figure.dpi
    x, y = (
        patch.axes.transData.transform([patch.center, np.add(patch.center, (patch.radius, 0))])
        * scale
    )
    return x, np.linalg.norm(y - x)


@pytest.mark.parametrize("paper", ["A4", "letter", "fit"])
def test_the_views_are_at_true_scale_and_not_mirrored(paper):
    target, count = default_target(), len(default_target().element)
    figure = target_sheets(target, "", paper)[0]
    circles = [patch for axes in figure.axes for patch in axes.patches if isinstance(patch, Circle)]
    assert len(circles) == 4 * count  # foam and ball, front and side
    for view, columns in ((circles[: 2 * count], [-1, 2]), (circles[2 * count :], [3, 2])):
        foam, balls = view[::2], view[1::2]
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


def test_an_svg_is_true_to_scale_harmless_and_the_same_every_time(tmp_path):
    save(tmp_path / "target.svg", target_sheets(default_target(), HOSTILE, "A4"))
    root = ElementTree.parse(tmp_path / "target.svg").getroot()  # well-formed, whatever the title
    assert (root.get("width"), root.get("height")) == ("297mm", "210mm")
    box = [float(v) for v in root.get("viewBox").split()]
    assert box == pytest.approx([0, 0, 297 * POINTS_PER_MM, 210 * POINTS_PER_MM], abs=1e-5)
    [bar] = [node for node in root.iter() if node.get("id") == "scale-bar"]
    [path] = [node for node in bar.iter() if node.tag.endswith("path")]
    x0, y0, x1, y1 = (float(v) for v in re.findall(r"[-\d.]+", path.get("d")))
    assert (x1 - x0) / POINTS_PER_MM == pytest.approx(
        BAR_MM, abs=1e-5
    ) and y0 == y1  # six decimals of a point
    assert [node for node in root.iter() if "script" in str(node.tag).lower()] == []
    text = (tmp_path / "target.svg").read_text("utf-8")
    assert "<script" not in text.lower() and "dc:date" not in text
    save(tmp_path / "again.svg", target_sheets(default_target(), HOSTILE, "A4"))
    assert (tmp_path / "again.svg").read_text("utf-8") == text


@pytest.mark.parametrize(
    "size_mm", [(150.0, 40.0), (283.0, 182.0), (284.0, 100.0), (396.0, 294.0), (90.0, 900.0)]
)
@pytest.mark.parametrize("paper", ["A4", "A3", "letter"])
def test_tiles_cover_the_drawing_and_overlap(size_mm, paper):
    page, windows = tiles(Drawing(*size_mm, "", "", lambda axes: None), paper)
    assert sorted(page) == sorted(PAPERS_MM[paper])
    for axis in (0, 1):
        starts = np.unique([w[axis] for w in windows])
        ends = starts + windows[0][2 + axis]
        assert starts[0] == 0 and ends[-1] == pytest.approx(size_mm[axis])
        assert (ends[:-1] - starts[1:] >= OVERLAP_MM - 1e-9).all()
    assert len({tuple(w) for w in windows}) == len(windows)

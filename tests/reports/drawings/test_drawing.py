"""The target's drawing: true scale on every page, the right way round, legible, and the same bytes
every time."""

import re
import zlib
from itertools import combinations
from xml.etree import ElementTree

import numpy as np
import pytest
from matplotlib.figure import Figure
from matplotlib.patches import Circle
from matplotlib.text import Text

from handbench.calibration.spheres.description import (
    Element,
    Target,
    default_target,
    load_target,
    save_target,
)
from handbench.reports.drawings.sheets import (
    BAR_MM,
    INCH_MM,
    OVERLAP_MM,
    PAPERS_MM,
    Drawing,
    save,
    sheets,
    tiles,
)
from handbench.reports.drawings.target_drawing import target_sheets
from handbench.support.errors import HandbenchError

HOSTILE = 'a<script>alert("1")</script>&--> $\\frac{1}$ \u4e2d \x1b.toml'
POINTS_PER_MM = 72 / INCH_MM


def crowded():
    """Eight spheres of three sizes, some with nearly the same coordinates."""
    places = [
        (0, 0, 0),
        (70, 1, 5),
        (69, 75, -8),
        (-2, 71, 4),
        (30, 36, 33),
        (-60, 2, 1),
        (-61, 73, 2),
        (-30, -50, -6.25),
    ]
    return Target(
        element=tuple(
            Element(
                centre_m=tuple(v / 1000 for v in place),
                sphere_radius_m=0.015 + 0.003 * (i % 3),
                ball_radius_m=0.003,
            )
            for i, place in enumerate(places)
        )
    )


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
    target = crowded()
    figure = target_sheets(target, "crowded", paper)[0]
    circles = [patch for axes in figure.axes for patch in axes.patches if isinstance(patch, Circle)]
    assert len(circles) == 4 * len(target.element)  # foam and ball, front and side
    for view, columns in ((circles[:16], [-1, 2]), (circles[16:], [3, 2])):
        foam, balls = view[::2], view[1::2]
        seen = np.array([on_page_mm(figure, patch)[0] for patch in balls])
        wanted = 1000 * np.stack(
            [np.sign(c) * target.centres_m[:, abs(c) - 1] for c in columns], axis=1
        )
        # Floating point: the page is 500 mm, and figures count in pixels.
        assert np.abs((seen - seen[0]) - (wanted - wanted[0])).max() < 1e-6
        assert [on_page_mm(figure, patch)[1] for patch in balls] == pytest.approx(
            [3.0] * 8, abs=1e-6
        )
        radii = [1000 * e.sphere_radius_m for e in target.element]
        assert [on_page_mm(figure, patch)[1] for patch in foam] == pytest.approx(radii, abs=1e-6)


@pytest.mark.parametrize(
    ("target", "paper"),
    [(default_target(), "A4"), (crowded(), "letter")],
    ids=["default", "crowded"],
)
def test_no_two_texts_overlap_and_none_leaves_the_page(target, paper):
    for figure in target_sheets(target, f"Calibration target, {'long ' * 40}", paper):
        boxes = [
            text.get_window_extent()
            for text in figure.findobj(Text)
            if text.get_text() and text.get_visible()
        ]
        assert len(boxes) > 3
        for a, b in combinations(boxes, 2):
            assert not a.overlaps(b)
        for box in boxes:
            assert (
                box.x0 >= 0
                and box.y0 >= 0
                and box.x1 <= figure.bbox.x1
                and box.y1 <= figure.bbox.y1
            )


def test_the_default_target_fits_one_a4_sheet():
    [figure] = target_sheets(default_target(), "default", "A4")
    assert figure.get_size_inches() * INCH_MM == pytest.approx(PAPERS_MM["A4"])
    texts = {text.get_text() for text in figure.findobj(Text)}
    assert {"1", "2", "3", "4", "5", "1, 2", "3, 4", "18.0", "−10.0", "50.0", "30.0"} <= texts
    assert any("1.03" in text for text in texts)


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


def test_every_page_of_a_pdf_has_the_papers_size_and_two_writings_the_same_bytes(tmp_path):
    for name in ("a.pdf", "b.pdf"):
        save(tmp_path / name, target_sheets(default_target(), HOSTILE, "letter"))
    content = (tmp_path / "a.pdf").read_bytes()
    boxes = re.findall(rb"/MediaBox \[ 0 0 ([\d.]+) ([\d.]+) \]", content)
    assert len(boxes) == 2
    for box in boxes:
        assert [float(v) / POINTS_PER_MM for v in box] == pytest.approx(
            PAPERS_MM["letter"], abs=1e-5
        )
    streams = re.findall(rb"stream\n(\x78.*?)\nendstream", content, re.DOTALL)
    pages = [zlib.decompress(stream) for stream in streams]
    strokes = [
        re.findall(rb"([-\d.]+) ([-\d.]+) m\s+([-\d.]+) ([-\d.]+) l", page) for page in pages
    ]
    bars = [[float(c) - float(a) for a, b, c, d in page if b == d] for page in strokes if page]
    assert len(bars) == 2 and all(
        any(abs(bar / POINTS_PER_MM - BAR_MM) < 1e-5 for bar in page) for page in bars
    )
    assert content == (tmp_path / "b.pdf").read_bytes() and b"CreationDate" not in content


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


def test_what_cannot_be_drawn_is_refused(tmp_path):
    drawing = Drawing(400.0, 300.0, "", "", lambda axes: None)
    with pytest.raises(
        HandbenchError, match=r"paper: is 'A9'; expected one of A4, A3, letter, fit"
    ):
        sheets([drawing], "A9")
    with pytest.raises(HandbenchError, match=r"one page, the drawing 4 sheets; write a PDF"):
        save(tmp_path / "a.svg", sheets([drawing], "A4"))
    with pytest.raises(HandbenchError, match=r"a\.png: ends in '\.png'; expected \.pdf, \.svg"):
        save(tmp_path / "a.png", sheets([drawing], "fit"))
    with pytest.raises(HandbenchError, match=r"400000 × 300 mm.*all lengths metres\?"):
        sheets([Drawing(4e5, 300.0, "", "", lambda axes: None)], "A4")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("target", [default_target(), crowded()], ids=["default", "crowded"])
def test_a_description_survives_its_file(tmp_path, target):
    save_target(tmp_path / "target.toml", target)
    assert load_target(tmp_path / "target.toml") == target

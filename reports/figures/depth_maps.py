"""Figures of depth maps and error maps, as seen from the array, so that x grows to the left."""

import math
from collections.abc import Iterator, Sequence
from itertools import zip_longest
from textwrap import fill
from typing import Any, Literal

import matplotlib
import numpy as np
from matplotlib import rcParams
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.markers import TICKDOWN, TICKLEFT
from matplotlib.ticker import MaxNLocator
from PIL import Image

from handbench.bench.evaluation.depth_errors import ErrorMap
from handbench.bench.results.about import CaptureFacts
from handbench.bench.results.maps import SurfaceMap
from handbench.bench.results.result_folder import Result
from handbench.reports.figures.layers import (
    SIGNED,
    Box,
    Layer,
    box_of,
    depth_layer,
    depth_scale,
    error_layer,
    mean_text,
)
from handbench.reports.figures.motion import error_over_frames, sequences
from handbench.reports.figures.references import drawn_references, floor_note
from handbench.reports.figures.style import (
    COLUMN_IN,
    STYLE,
    DrawnMethod,
    Picture,
    methods,
    narrow,
    time_text,
)
from handbench.reports.tables.table import AGAINST

X_LABEL, X_SHORT = (
    "x in mm, growing to the left (as seen from the array)",
    "x in mm (as seen from the array)",
)
# Of a page and of a paper's column: panels in a row at most; in inches the width of one (0: what
# the column leaves), the gap, the margins at the left and the right, the width of a colour bar.
PAGE, COLUMN = (6, 1.9, 0.14, 0.8, 0.75, 0.14), (4, 0.0, 0.05, 0.48, 0.74, 0.08)
LINE_IN, BOTTOM_IN = 0.155, 0.45  # of a title's line, and below the lowest panels
COLOURS = f"{SIGNED}. Grey: not observed; line: outline of the reference."

# maps of one colour scale, a photograph's pixels, or nothing
Row = Sequence[Layer | np.ndarray | None]


def panels(result: Result, capture: CaptureFacts) -> Iterator[Picture]:
    """Yield the pictures of one capture: the depth maps of all methods with their errors against
    the first reference surface, a picture of the errors for each further reference, and the errors
    over the frames if it is one of several captures with several frames."""
    if result.about.methods:
        references = drawn_references([capture])
        yield depth_maps(result, capture, *references[:1])
        for reference in references[1:]:
            yield error_maps(result, capture, reference)
        if len(names := sequences(result)) > 1 and capture.name in names:
            yield error_over_frames(result, capture)


def depth_maps(result: Result, capture: CaptureFacts, reference: str = "") -> Picture:
    """Draw the depth maps of all methods next to the reference surface, on one colour scale as in
    the paper's Fig. 3 and 4.
    Below them are the photograph, if there is one, and the methods' signed errors. Without a
    reference, only the photograph and the depth maps are drawn."""
    found = [result.surface(capture.name, method.name) for method in methods(result)]
    surfaces = ([result.surface(capture.name, reference)] if reference else []) + found
    norm, photo = depth_scale(surfaces[0]), result.photo(capture.name)
    maps = [
        depth_layer(_title(result, m), s, norm) for m, s in zip(methods(result), found, strict=True)
    ]
    before: list[Layer | np.ndarray | None] = (
        [np.asarray(Image.open(photo).convert("RGB"))] if photo else []
    )
    errors: list[Row] = []
    against, alt = "; grey: not observed.", ""
    if reference:
        name = {"truth": "true surface", "photogrammetry": "photogrammetry"}[reference]
        below, alt = _errors(result, capture, reference, timed=False)
        errors = [[*(before or [None]), *below]]
        before = [
            depth_layer(
                "ground\ntruth" if narrow() else f"ground truth\n({name})", surfaces[0], norm
            )
        ]
        against = f", below them their errors {AGAINST[reference]}; {COLOURS}{floor_note(result)}"
    names = ", ".join(_title_of(panel).replace("\n", " ") for panel in (*before, *maps))
    return Picture(
        f"depth_{capture.name}",
        f"Capture {capture.name}: depth maps on one colour scale{against}",
        f"Depth maps of capture {capture.name}, side by side: "
        f"{names}{', and the photograph' * bool(photo)}. {alt}",
        sheet([[*before, *maps], *errors], box_of(surfaces)),
    )


def error_maps(result: Result, capture: CaptureFacts, reference: str) -> Picture:
    """Draw the signed errors of every method against one reference surface, as in the paper's Fig.
    4. The colour scale is the same for all captures."""
    shown, alt = _errors(result, capture, reference, timed=True)
    return Picture(
        f"error_{capture.name}__{reference}",
        f"Capture {capture.name}: signed errors {AGAINST[reference]}; {COLOURS}"
        f"{floor_note(result)}",
        alt,
        sheet([shown], box_of([result.surface(capture.name, reference)])),
    )


def methods_figure(shown: Sequence[tuple[str, np.ndarray, ErrorMap]]) -> Figure:
    """Draw a true surface and the depth maps of several methods in a row, with their signed errors
    below.
    shown: for each method, its title, its depths z_m [ny, nx] in metres (NaN where not observed),
    and its error map, whose reference depths are the true surface."""
    maps = [errors for *_, errors in shown]
    truth = SurfaceMap(maps[0].x_m, maps[0].y_m, maps[0].reference_z_m)
    norm = depth_scale(truth)
    depths = [
        depth_layer(title, SurfaceMap(errors.x_m, errors.y_m, z_m), norm)
        for title, z_m, errors in shown
    ]
    below = [None, *(error_layer(errors, "") for errors in maps)]
    with matplotlib.rc_context(STYLE):
        return sheet(
            [[depth_layer("true surface\n", truth, norm), *depths], below], box_of([truth])
        )


def _errors(
    result: Result, capture: CaptureFacts, reference: str, timed: bool
) -> tuple[list[Layer], str]:
    """Return the panels of all methods' signed errors for one capture, and a description of them
    for screen readers.
    The title of a panel is the method's mean error; with `timed` also the method's name and
    time."""
    shown, words = [], []
    for m in methods(result):
        errors = result.errors(capture.name, m.name, reference)
        mean = mean_text(errors.error_m)
        words.append(f"{m.title}: {mean}")
        mean = mean.removeprefix("MAE ") if narrow() else mean
        shown.append(error_layer(errors, _title(result, m, mean) if timed else mean))
    return shown, f"Error maps of capture {capture.name} {AGAINST[reference]}. {'; '.join(words)}."


def _title(result: Result, method: DrawnMethod, mean: str = "") -> str:
    """Return the title of a panel: the method's name, its mean error if given, and its time per
    frame."""
    time = time_text(result, method)
    if narrow():
        return "\n".join(filter(None, (fill(method.title, 11), mean, time)))
    return f"{method.title}\n{mean}, {time}" if mean else f"{method.title}\n{time} per frame"


def _title_of(panel: Layer | np.ndarray | None) -> str:
    return panel.title if isinstance(panel, Layer) else "" if panel is None else "photograph"


def sheet(rows: Sequence[Row], box: Box) -> Figure:
    """Draw rows of panels, each a map or a photograph, as one figure.
    box: the visible part of every map (left, right, bottom, top in mm). A row that is too long is
    broken into several; each row has a colour bar at its right. Only outer axes have numbers and
    labels. The place of a panel that is None stays blank."""
    count = max(map(len, rows))
    abreast, wide, gap, left, right, bar_wide = COLUMN if narrow() else PAGE
    columns = math.ceil(count / math.ceil(count / abreast))
    wide = wide or (COLUMN_IN - left - right) / columns - gap
    high = wide * min(max((box[3] - box[2]) / (box[0] - box[1]), 0.5), 2.2)
    turns = [
        row[i : i + columns]
        for i in range(0, count, columns)
        for row in rows
        if row[i : i + columns]
    ]
    tops = [
        0.1 + LINE_IN * (1 + max(_title_of(panel).count("\n") for panel in turn)) for turn in turns
    ]
    width, height = left + columns * (wide + gap) + right, BOTTOM_IN + sum(tops) + len(turns) * high
    lowers = height - np.cumsum(np.array(tops) + high)
    lefts = [left + column * (wide + gap) for column in range(columns)]
    figure, axes = Figure(figsize=(width, height)), []

    def place(x: float, y: float, wide: float) -> Axes:
        return figure.add_axes((x / width, y / height, wide / width, high / height))

    for turn, y in zip(turns, lowers.tolist(), strict=True):
        axes.append([place(x, y, wide) for x in lefts[: len(turn)]])
        for axis, panel in zip(axes[-1], turn, strict=True):
            _draw(axis, panel, box)
        _number(axes[-1][0], "y", box)
        axes[-1][0].set_ylabel("y in mm", labelpad=1)
        coloured = next(panel for panel in turn if isinstance(panel, Layer))
        coloured.draw_bar(place(width - right, y, bar_wide))
    for below in zip_longest(*axes):  # a photograph has no numbers
        _number(next(axis for axis in reversed(below) if axis), "x", box)
    middle = (lefts[0] + lefts[-1] + wide) / 2 / width
    figure.text(middle, 0.06 / height, X_SHORT if narrow() else X_LABEL, ha="center")
    return figure


def _draw(axis: Axes, panel: Layer | np.ndarray | None, box: Box) -> None:
    """Draw a panel on an axis: a map in mm or a photograph; None draws nothing.
    box: the visible part of a map (left, right, bottom, top in mm). A map has ticks but no
    numbers."""
    # given, because finding it takes as long as drawing the axes
    axis.set_title(_title_of(panel), y=1.0)
    if not isinstance(panel, Layer):
        axis.set_axis_off()
        if panel is not None:
            axis.set_anchor("N")
            axis.imshow(panel)
        return
    panel.draw(axis)
    axis.set(xlim=box[:2], ylim=box[2:], xticks=(), yticks=(), aspect="equal")
    style: dict[str, Any] = {
        "ls": "none",
        "markeredgecolor": rcParams["xtick.color"],
        "markersize": 2.5,
        "markeredgewidth": 0.6,
    }
    # as one line each: separate ticks are five objects each
    for side, marker in (("x", TICKDOWN), ("y", TICKLEFT)):
        at_mm = ticks_mm(side, box)
        places = (at_mm, 0 * at_mm) if side == "x" else (0 * at_mm, at_mm)
        along = axis.get_xaxis_transform() if side == "x" else axis.get_yaxis_transform()
        axis.add_artist(
            Line2D(*places, transform=along, clip_on=False, **style | {"marker": marker})
        )


def ticks_mm(side: str, box: Box) -> np.ndarray:
    """Return the positions in mm of the ticks along one side of a box (left, right, bottom, top in
    mm).
    On an HTML page, the x axis has none at its ends, where numbers would touch those of the next
    panel."""
    low, high = sorted(box[:2] if side == "x" else box[2:])
    most, pruned = (
        {"x": 2 if narrow() else 4, "y": 4 if narrow() else 5}[side],
        side == "x" and not narrow(),
    )
    ticks_mm = np.asarray(
        MaxNLocator(most, prune="both" if pruned else None).tick_values(low, high)
    )
    return ticks_mm[(ticks_mm >= low) & (ticks_mm <= high)]


def _number(axis: Axes, side: Literal["x", "y"], box: Box) -> None:
    """Write the numbers at the ticks along one side of an outer axis. The axis of a photograph has
    none."""
    if axis.axison:
        axis.set(**{f"{side}ticks": ticks_mm(side, box)})
        axis.tick_params(length=2.5, width=0.6)

"""Write the tables of README.md and docs/results.md from a result of paper_table, or compare them
with one.

    python -m docs.readme [RESULT]           do the pages agree with RESULT (default runs/table)?
    python -m docs.readme [RESULT] --write   write the tables, and the README's figure

Figures agree if they differ by at most one unit of the last printed digit. Not compared are times,
which depend on the machine, and the MAX, which one pixel decides.
"""

import argparse
import re
from collections.abc import Callable, Iterator
from dataclasses import replace
from itertools import zip_longest
from pathlib import Path

import matplotlib
import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from handbench.bench.evaluation.metrics import COMMON, HEADLINE, chosen
from handbench.bench.results.result_folder import Result, load
from handbench.radar.data.arrays import SPEED_OF_LIGHT_M_S
from handbench.radar.methods.fsk import Fsk
from handbench.radar.methods.pixels import masked_mean
from handbench.reports.figures.depth_maps import depth_maps
from handbench.reports.figures.style import STYLE, save
from handbench.reports.tables.rounding import NONE, figure, is_known, number, paper
from handbench.reports.tables.table import Table, figures
from handbench.reports.tables.table import differences as tested_differences
from handbench.reports.tables.writers import escaped, markdown
from handbench.support.files import write_text

ROOT = Path(__file__).parents[1]
REFERENCE = "photogrammetry"
LARGEST, SPREAD = "max_mm", "frames_max_deviation_mm"  # and its deviation between frames
METHODS = ("2fsk", "3fsk", "broadband", "narrowband", "nfsk-plus", "joint", "broadband-aligned")
WITH_INTERVAL = (HEADLINE, "precision_mm")
FITTED = ("precision_mm", "2fsk")  # the figure to which the benchmark's phase noise was fitted
FIGURE, POSE, SHOWN = "docs/depth_F.png", "F", ("2fsk", "3fsk", "broadband")
FILTER_PX, LEFT_RAD = 15, 0.15  # which turn the order of 3-FSK and broadband round
NOT_COMPARED = ("time per frame", "MAX of AE")
NUMBER = re.compile(r"\d+(?:\.(\d+))?")


def own_table(result: Result) -> str:
    """Return the README's table: the methods with their own settings, next to the paper's
    figures."""
    titles = [result.about.method_titles.get(method, method) for method in METHODS]
    rows = {
        f"{result.title(metric)} ({result.about.metrics[metric].unit})": [
            _cell(result, metric, method) for method in METHODS
        ]
        for metric in chosen("readme")
    }
    caption = (
        "\nAgainst photogrammetry; each figure is formed for each pose and averaged. In italics "
        "the paper's figure; the MAX is of the first frame, ± the deviation of five; in brackets a "
        "95 % interval. "
        "{cores} cores of {processor}, imaged on {imaging_device}.\n"
    )
    texts = pd.DataFrame.from_dict(rows, orient="index", columns=titles)
    return markdown(Table("", texts)) + caption.format(**result.about.machine)


def _cell(result: Result, metric: str, method: str) -> str:
    """Return a figure, perhaps with its interval or its deviation between frames, and in a further
    line the paper's."""
    row = result.row(metric, method, REFERENCE)
    if row is None or not is_known(row.value):
        return NONE
    fitted = (metric, method) == FITTED
    text = figure(row.value, row.low, row.high, row.unit)
    if metric == LARGEST and (spread := result.row(SPREAD, method, REFERENCE)):
        text = f"{number(row.value, 0)} ± {number(spread.value, 0)}"
    elif metric not in WITH_INTERVAL or fitted:
        text = text.split(" ")[0]
    if fitted:
        text += " (fitted)"
    return f"{text}\n{paper(row.paper, row.unit)}" if is_known(row.paper) else text


def equal_table(result: Result) -> str:
    """Return the tables of docs/results.md: the methods under equal treatment (same smoothing,
    common pixels), and its main pairs."""
    unsmoothed = result.equal.treatment == "none"
    shown = (result.equal.metric == HEADLINE) | (unsmoothed & (result.equal.metric == COMMON))
    equal = result.equal[shown].set_index("method")
    lines = equal.loc[[method for method in METHODS if method in equal.index]].reset_index()
    table = markdown(replace(figures(result, lines).turned, caption=""))
    sentences = tested_differences(result, main=True).texts.index
    return "\n".join((table, *(f"- {escaped(sentence)}." for sentence in sentences), ""))


def order_table(result: Result) -> str:
    """Return the table of docs/results.md that turns the order of 3-FSK and broadband round: their
    MAE with a wide averaging filter on broadband's depths, and with a phase that the calibration
    leaves at the third tone, which moves all of 3-FSK's depths by c ψ / 4π (f_i − f_3)."""
    *pair_hz, far_hz = Fsk().tones_hz
    step_m = SPEED_OF_LIGHT_M_S * LEFT_RAD / (4 * np.pi * (np.mean(pair_hz) - far_hz))
    fsk, moved = (_mae(result, "3fsk", 1, offset_m) for offset_m in (0, step_m))
    plain, averaged = (_mae(result, "broadband", size_px, 0) for size_px in (1, FILTER_PX))
    texts = {
        "as they are": (fsk, plain),
        f"broadband averaged over {FILTER_PX} × {FILTER_PX} pixels": (fsk, averaged),
        f"{LEFT_RAD} rad left at the third tone": (moved, plain),
        "both": (moved, averaged),
    }
    table = pd.DataFrame.from_dict(texts, orient="index", columns=["3-FSK", "broadband"])
    return markdown(Table("", table.rename_axis("MAE (mm)")))


def _mae(result: Result, method: str, size_px: int, offset_m: float) -> str:
    """Return the MAE as text of a method whose depths are averaged and moved."""
    maes_m = [
        np.nanmean(abs(masked_mean(z_m, size_px) + offset_m - reference_m))
        for capture in result.scored()
        for z_m, reference_m in [
            [result.surface(capture.name, name).z_m for name in (method, REFERENCE)]
        ]
    ]
    return figure(1e3 * float(np.mean(maes_m)), unit="mm")


PAGES: dict[tuple[str, str], Callable[[Result], str]] = {
    ("README.md", "table"): own_table,
    ("docs/results.md", "order"): order_table,
    ("docs/results.md", "table"): equal_table,
}


def block(name: str) -> re.Pattern[str]:
    """Return the pattern of a table between its marks on a page."""
    return re.compile(rf"(?<=<!-- {name}: begin -->\n)(.*)(?=<!-- {name}: end -->)", re.DOTALL)


def write(result: Result, root: Path = ROOT) -> None:
    """Write the tables in the pages below `root`, and the figure."""
    for (page, name), made in PAGES.items():
        before, _, after = block(name).split((root / page).read_text("utf-8"))
        write_text(root / page, before + made(result) + after)
    save(draw(result), root / FIGURE)


def draw(result: Result) -> Figure:
    """Draw photograph, ground truth, and the depths and errors of the methods SHOWN, of the capture
    POSE."""
    [pose] = (capture for capture in result.about.captures if capture.name == POSE)
    methods = tuple(method for method in result.about.methods if method.name in SHOWN)
    shown = replace(result, about=result.about.model_copy(update={"methods": methods}))
    with matplotlib.rc_context(STYLE):
        return depth_maps(shown, pose, REFERENCE).figure


def differences(result: Result, root: Path = ROOT) -> Iterator[str]:
    """Yield the page and the title of each line of a table whose figures are not those of the
    result."""
    for (page, name), made in PAGES.items():
        _, recorded, _ = block(name).split((root / page).read_text("utf-8"))
        lines = zip_longest(recorded.splitlines(), made(result).splitlines(), fillvalue="")
        for old, new in lines:
            title = old.strip("| ").partition(" |")[0]
            if old.startswith("|") and not title.startswith(NOT_COMPARED) and not agree(old, new):
                yield f"{title} ({page})"


def agree(old: str, new: str) -> bool:
    """Tell whether two texts differ only in numbers, and these by at most one unit of the last
    digit of the old ones."""
    pairs = zip(NUMBER.finditer(old), NUMBER.finditer(new), strict=False)
    return NUMBER.sub("", old) == NUMBER.sub("", new) and all(
        abs(float(a[0]) - float(b[0])) < 1.5 * 10.0 ** -len(a[1] or "") for a, b in pairs
    )


def main() -> None:
    """Compare or write the tables, as the command line asks. Other figures are no error, since
    another machine may have them."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n\n")[0])
    parser.add_argument("result", type=Path, nargs="?", default=Path("runs/table"))
    parser.add_argument("--write", action="store_true", help="write the tables and the figure")
    options = parser.parse_args()
    result = load(options.result)
    if options.write:
        write(result)
    others = "; ".join(differences(result))
    said = f"has other figures than recorded: {others}" if others else "has the recorded figures"
    print(f"{options.result} {said}")


if __name__ == "__main__":
    main()

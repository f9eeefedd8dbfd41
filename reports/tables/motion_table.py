"""The table of error over speed: a line for each capture with a known velocity, a column for each
method."""

import pandas as pd

from handbench.bench.results import HEADLINE, VELOCITY_BEYOND, VELOCITY_MAE, Result
from handbench.reports.tables.blocks import NONE, rounded

MARK = "†"
CAPTION = (
    "Error over speed, against the true surface at the start of the frame; speed: mean |radial "
    f"velocity| of the surface; {MARK}: at some pixels it is beyond the method's unambiguous "
    "velocity"
)


def motion_table(result: Result) -> tuple[tuple[str, ...], list[tuple[str, ...]]]:
    """Return the headings and the formatted lines of the table of error over speed; no lines if
    nothing moves."""
    found, titles = result.motion, result.about.method_titles
    kinds = [(HEADLINE, "mm"), (VELOCITY_MAE, "mm/s")]
    columns = [
        (metric, unit, str(method))
        for metric, unit in kinds
        for method, own in found.groupby("method", sort=False)
        if own[metric].notna().any()
    ]
    headings = (
        *("capture", "speed (mm/s)", "step (ms)"),
        *(f"{titles[m]}: {result.title(metric)} ({unit})" for metric, unit, m in columns),
    )
    rows = []
    for capture, lines in found.groupby("capture", sort=False):
        first, of = lines.iloc[0], {line.method: line for _, line in lines.iterrows()}
        cells = [_cell(of[method], metric) for metric, _, method in columns]
        rows.append(
            (str(capture), rounded(first.speed_mm_s), rounded(1e3 * first.step_time_s), *cells)
        )
    return headings, rows


def motion_csv(result: Result) -> str:
    """Return the table MOTION of a result, a line for each capture and method, as CSV; "" if
    nothing moves."""
    found = result.motion
    return found.to_csv(index=False, lineterminator="\n") if len(found) else ""


def _cell(line: pd.Series, metric: str) -> str:
    value = rounded(line[metric])
    return f"{value} {MARK}" if value != NONE and line[VELOCITY_BEYOND] > 0 else value

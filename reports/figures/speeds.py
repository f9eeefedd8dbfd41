"""The picture of a trade-off's settings over the speed of the target."""

from collections import defaultdict
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from handbench.bench.results import Section, Setting, best_at_each_speed
from handbench.reports.figures.style import COLUMN_IN, Picture, log_axis, method_styles, narrow

REST = 2.5  # the slowest speed over that at which a target at rest is drawn, on an axis without 0


def over_speed(about: Section, settings: tuple[Setting, ...]) -> Picture:
    """Plot the error of each method over the speed of the target.
    A point is the method's most accurate setting at that speed; it is hollow if the speed exceeds
    the setting's largest unambiguous velocity. Large points are the most accurate of all."""
    by_method: dict[str, list[Setting]] = defaultdict(list)
    for s in settings:
        if s.error:
            by_method[s.method].append(s)
    best = best_at_each_speed(s for some in by_method.values() for s in some)
    speeds = [s.speed_m_s or 0.0 for s in best]
    rest = min((v for v in speeds if v > 0), default=1.0) / REST
    styles = method_styles(by_method)
    size = (COLUMN_IN, 3.4) if narrow() else (7.5, 4)
    picture = Figure(figsize=size, layout="constrained")
    axis = picture.subplots()
    for method, some in by_method.items():
        own = best_at_each_speed(some)
        x, y = [s.speed_m_s or rest for s in own], [s.error or 0.0 for s in own]
        colour, marker = styles[method]
        line = "-" if any(s.velocity_limit_m_s for s in some) else "--"
        axis.plot(
            x,
            y,
            color=colour,
            marker=marker,
            markersize=4,
            linewidth=1.2,
            linestyle=line,
            label=method,
            markevery=[i for i, s in enumerate(own) if not s.beyond_limit],
        )
        for s in own:
            hollow: dict[str, Any] = {"fillstyle": "none"} if s.beyond_limit else {}
            if hollow or s in best:
                large = 8 if s in best else 4
                axis.plot(
                    s.speed_m_s or rest,
                    s.error or 0.0,
                    color=colour,
                    marker=marker,
                    markersize=large,
                    **hollow,
                )
    for side in ("x", "y"):
        log_axis(axis, side)
    axis.minorticks_off()
    axis.set_xticks([v or rest for v in speeds], [f"{v:g}" for v in speeds])
    axis.set(xlabel="speed of the hand in m/s", ylabel=f"MAE in {about.unit}")
    picture.legend(
        loc="outside lower center" if narrow() else "outside right center",
        ncols=2 if narrow() else 1,
        frameon=False,
    )
    listed = "; ".join(f"{s.title}: {np.round(s.error or 0, 2):g} {about.unit}" for s in best)
    return Picture(
        f"speed_{about.name}",
        f"{about.title}: MAE over the speed of the hand, of each method's most accurate tones and "
        "step time at that speed; solid lines: methods that measure velocities. "
        "Large points: the most accurate of all methods. Hollow points: "
        "the speed exceeds the largest unambiguous velocity. Both axes are logarithmic; a hand at "
        "rest is at the left end.",
        f"MAE over the speed of {len(by_method)} methods. The most accurate setting at each "
        f"speed: {listed}.",
        picture,
    )

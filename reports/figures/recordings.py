"""Figure of recorded data: levels of the radar's echoes over frequency and range, and positions of
antennas."""

from collections.abc import Mapping

import numpy as np
from matplotlib.figure import Figure

from handbench.reports.figures.style import COLOURS, STYLE, styled

SHARES = (10, 50, 90)  # percentiles over the channels


def echoes_figure(
    title: str,
    frequencies_hz: np.ndarray,
    levels_db: np.ndarray,
    places_m: Mapping[str, np.ndarray],
    profile: tuple[np.ndarray, np.ndarray] | None,
) -> Figure:
    """Plot a radar recording: level over frequency, positions of the antennas as seen from behind
    the array and, if given, level over range.

    Args:
        title: of the figure.
        frequencies_hz: [f].
        levels_db: [3, f], the 10th, 50th and 90th percentile over the channels (SHARES).
        places_m: group of antennas, such as "receivers" → positions [n, 3].
        profile: ranges [n] in metres up to the unambiguous range, and levels [n] in dB.
    """
    order = np.argsort(frequencies_hz)
    ghz, (low, middle, high) = frequencies_hz[order] / 1e9, levels_db[:, order]
    with styled(STYLE):
        figure = Figure(figsize=(10 if profile else 7, 3.2), layout="constrained")
        figure.suptitle(title)
        spectrum, places, *more = figure.subplots(1, 3 if profile else 2)
        spectrum.fill_between(
            ghz, low, high, color=COLOURS[0], alpha=0.2, linewidth=0, label="10 to 90 % of channels"
        )
        spectrum.plot(
            ghz,
            middle,
            color=COLOURS[0],
            marker="." if len(ghz) <= 64 else "",
            label="median channel",
        )
        spectrum.set(
            xlabel="frequency in GHz",
            ylabel="level in dB below the largest sample",
            title="spectrum",
        )
        spectrum.margins(y=0.4)  # for the legend
        spectrum.legend(loc="lower left")
        for (name, of_m), colour, marker in zip(places_m.items(), COLOURS, "os", strict=False):
            x_mm, y_mm = 1e3 * of_m[:, :2].T
            size = 12 if len(of_m) <= 300 else 2
            places.scatter(x_mm, y_mm, size, color=colour, marker=marker, linewidth=0, label=name)
        places.set(xlabel="x in mm, growing to the left", ylabel="y in mm", title="antennas")
        places.set_aspect("equal", adjustable="datalim")
        places.invert_xaxis()
        places.legend(loc="center")
        if profile:
            more[0].plot(1e3 * profile[0], profile[1], color=COLOURS[0])
            more[0].set(
                xlabel="half the path in mm;\nwhat is farther folds back",
                ylabel="dB below the maximum",
                title="range, mean of channels",
            )
    return figure

"""Figures as texts: the one rule by which every table, picture and sentence rounds."""

import math
from typing import TypeGuard

NONE = "–"  # a missing figure


def is_known(figure: float | None) -> TypeGuard[float]:
    """Tell whether a figure is neither None nor NaN."""
    return figure is not None and figure == figure


def figure(
    value: float | None,
    low: float | None = None,
    high: float | None = None,
    unit: str = "",
    places: int | None = None,
) -> str:
    """Format a figure followed by its interval, such as "1.23 [1.10, 1.36]". Without a known
    interval, only the figure is returned; a missing figure is a dash. places: decimals, if not
    those of `decimals`."""
    if not is_known(value):
        return NONE
    places = decimals(value, low, high, unit) if places is None else places
    if not is_known(low) or not is_known(high):
        return number(value, places)
    return f"{number(value, places)} [{number(low, places)}, {number(high, places)}]"


def stacked(value: float, low: float, high: float, unit: str, places: int | None = None) -> str:
    """Format a figure for a table: `figure`, with its interval on a line of its own."""
    return figure(value, low, high, unit, places).replace(" ", "\n", 1)


def decimals(value: float, low: float | None, high: float | None, unit: str) -> int:
    """Return the number of decimals with which a figure and its interval [low, high] are printed.
    With an interval there are enough for two significant digits of half its width, but at most
    three of the value. Without one there are two of the value: the third depends on the processor,
    whose rounding moves pixels across the edge of the reference. Millimetres have at least one, as
    in the paper, percentages one, pixels none."""
    if unit in ("%", "pixels") or not value:
        return 1 if unit == "%" else 0
    if is_known(low) and is_known(high) and high > low:
        places = min(_places(value, 3), _places((high - low) / 2, 2))
    else:
        places = _places(value, 2)
    return max(places, 1) if unit == "mm" else places


def _places(value: float, digits: int) -> int:
    return min(max(digits - 1 - math.floor(math.log10(abs(value))), 0), 6)


def number(value: float | None, places: int) -> str:
    """Format a number with `places` decimals and a true minus sign; a missing number is a dash."""
    return f"{value:.{places}f}".replace("-", "−") if is_known(value) else NONE


def paper_places(unit: str) -> int:
    """Return the number of decimals with which the paper prints a figure."""
    return 1 if unit == "mm" else 2


def paper(value: float | None, unit: str) -> str:
    """Format a figure with as many decimals as the paper prints."""
    return number(value, paper_places(unit))


def p_text(p: float | None) -> str:
    """Format a p-value with two decimals, or with three below 0.1. Below 0.001 it is "< 0.001"; an
    unknown one is a dash."""
    return "< 0.001" if is_known(p) and p < 0.001 else number(p, 3 if p and p < 0.1 else 2)

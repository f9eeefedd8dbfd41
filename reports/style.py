"""What every picture shares: fonts, colours and markers of the methods, how times are written."""

from __future__ import annotations

from dataclasses import dataclass

from matplotlib.figure import Figure

from bench.results import MethodFacts, Result

STYLE = {
    "font.size": 9,
    "axes.titlesize": 9,
    "axes.linewidth": 0.6,
    "savefig.dpi": 200,
    "pdf.fonttype": 42,
    "text.parse_math": False,  # names are text, whatever dollars they hold
}
ORDER = ("broadband", "2fsk", "3fsk", "narrowband")  # as the paper's Fig. 3
COLOURS = (  # Okabe and Ito, then Tol's muted ones
    "#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#000000", "#882255", "#44AA99", "#999933",
)
MARKERS = ("o", "s", "^", "D", "v", "P", "X", "<", ">", "*")
AGAINST = {"photogrammetry": "against photogrammetry", "truth": "against the true surface"}


@dataclass(frozen=True)
class Picture:
    """A figure with its file name's stem, its caption and a description for those who cannot see it."""

    stem: str
    caption: str
    alt: str
    figure: Figure


def methods(result: Result) -> list[MethodFacts]:
    """Known methods in the paper's order, then the others."""
    rank = {name: i for i, name in enumerate(ORDER)}
    return sorted(result.about.methods, key=lambda method: rank.get(method.name, len(rank)))


def looks(result: Result) -> dict[str, tuple[str, str]]:
    """Method → colour and marker, the same in every picture."""
    return {m.name: (COLOURS[i % len(COLOURS)], MARKERS[i % len(MARKERS)]) for i, m in enumerate(methods(result))}


def time_text(result: Result, method: MethodFacts) -> str:
    """The method's time per frame, as a title writes it."""
    rows = (result.row("seconds", method.name, reference) for reference in AGAINST)
    seconds = next((row.value for row in rows if row and row.value is not None), None)
    if seconds is None:
        return "time unknown"
    return f"{seconds:.2g} s" if seconds < 10 else f"{seconds:.0f} s"

"""A trade-off in the terminal: fronts, what is dominated and by what, claims; and an answer."""

from __future__ import annotations

from rich import box
from rich.console import Console
from rich.markup import escape
from rich.table import Table

from bench.results import Section, Setting, Tradeoff
from bench.studies.tradeoff.answer import Answer
from bench.studies.tradeoff.pareto import front, with_acquisition
from bench.studies.tradeoff.settings import setting_path

WIDTH = 150  # where the terminal does not tell


def show(tradeoff: Tradeoff, count_acquisition: bool = False) -> None:
    """Print all sections; with the acquisition counted, the imaging front is that of frame and acquisition together."""
    found = Console()
    console = found if found.is_terminal else Console(width=WIDTH)
    for section in tradeoff.facts.sections:
        settings = tradeoff.section(section.name)
        counted = count_acquisition and section.name == "imaging"
        if counted:
            settings = tuple(with_acquisition(s) for s in settings if s.acquisition_s is not None)
        console.print(_front(section, settings, counted))
        for line in _dominated(settings, [s.name for s in front(settings)]):
            console.print(line, highlight=False)
        console.print()
    for claim in tradeoff.facts.claims:
        console.print(
            f"{escape(claim.text)}: the paper says {claim.paper:.4g}, counted {_number(claim.counted)}, measured "
            f"{_number(claim.measured)}",
            highlight=False,
        )


def say_answer(tradeoff: Tradeoff, answer: Answer) -> None:
    """Print an answer, and the command that runs it."""
    s = answer.setting
    print(
        f"{answer.asked}: {s.name}, MAE {s.error:.3g} mm ({_range(s.low, s.high)}), {1e3 * s.seconds:.3g} ms "
        f"({_range(s.seconds_low, s.seconds_high, 1e3)})"
    )
    print(f"handbench run {setting_path(tradeoff.folder, s.name)} -o RESULTS")


def _front(section: Section, settings: tuple[Setting, ...], acquired: bool) -> Table:
    """The front, and the settings that are the best of their own method alone."""
    best = [s.name for s in front(settings)]
    time_of = "frame and acquisition" if acquired else "time"
    table = Table(box=box.SIMPLE, title=f"{section.title}: {section.metric} against {time_of}", title_justify="left")
    table.add_column("setting")
    for title in (section.unit, "95 %", "seen %", "ms", "range", "× reference", "front"):
        table.add_column(title, justify="right")
    shown = [s for s in settings if s.name in best or s.on_method_front]
    unit = next((s.seconds for s in settings if s.name == section.reference), None)
    for s in sorted(shown, key=lambda s: s.seconds):
        table.add_row(
            escape(s.name),
            f"{s.error:.3g}",
            _range(s.low, s.high),
            _number(s.seen_percent),
            f"{1e3 * s.seconds:.3g}",
            _range(s.seconds_low, s.seconds_high, 1e3),
            _number(s.seconds / unit if unit else None),
            "front" if s.name in best else "its method's",
        )
    return table


def _dominated(settings: tuple[Setting, ...], best: list[str]) -> list[str]:
    lines = []
    for name in best:
        under = [s.name for s in settings if s.dominated_by == name and s.name not in best]
        if under:
            lines.append(f"dominated by {escape(name)}: {escape(', '.join(under))}")
    unknown = [s.name for s in settings if s.error is None or s.seconds is None]
    return lines + ([f"without a figure: {escape(', '.join(unknown))}"] if unknown else [])


def _range(low: float | None, high: float | None, scale: float = 1) -> str:
    return f"{scale * low:.3g}–{scale * high:.3g}" if low is not None and high is not None else ""


def _number(value: float | None) -> str:
    return "–" if value is None else f"{value:.4g}"

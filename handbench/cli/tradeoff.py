"""`handbench tradeoff`: measure accuracy and time of many settings, and find those that no other
setting beats."""

from __future__ import annotations

import argparse
import re
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

from handbench.support.errors import HandbenchError

if TYPE_CHECKING:
    from handbench.bench.results import Section, Setting, Tradeoff

LENGTHS = {"mm": 1.0, "um": 1e-3, "µm": 1e-3, "cm": 10.0, "m": 1e3}  # in millimetres
TIMES = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "µs": 1e-6, "min": 60.0}


def run(options: argparse.Namespace) -> str:
    """Measure error and time of the benchmark's settings, print the settings that no other beats
    (the front) and write a report.
    --max-mae and --max-time ask for one setting within these limits. If there is none,
    HandbenchError is raised after everything is written."""
    from handbench.bench.run.benchmark_file import load_benchmark
    from handbench.bench.tradeoff.run import run as sweep
    from handbench.bench.tradeoff.run import setting_path
    from handbench.bench.tradeoff.settings import answer
    from handbench.reports.page.tradeoff_section import build

    error_mm = None if options.max_mae is None else quantity(options.max_mae, LENGTHS, "--max-mae")
    seconds = None if options.max_time is None else quantity(options.max_time, TIMES, "--max-time")
    sections = (
        None
        if options.sections is None
        else tuple(part.strip() for part in options.sections.split(","))
    )
    if (error_mm or seconds) and sections is not None and "imaging" not in sections:
        raise HandbenchError(
            "--max-mae, --max-time: choose among the settings of section 'imaging', which "
            "--sections leaves out; add imaging to --sections"
        )
    bench, base = load_benchmark(options.bench)
    found = sweep(bench, base, options.out, sections, options.overwrite)
    show(found, count_acquisition=options.count_acquisition)
    print(f"trade-off: {options.out}")
    print(f"report: {build(options.out, options.out / 'report')}")
    if error_mm or seconds:
        chosen, asked = answer(found, error_mm, seconds, options.count_acquisition)
        figures = f"MAE {_text(chosen.error)} mm{_within(chosen.low, chosen.high)}"
        times = (
            f"{_text(1e3 * (chosen.seconds or 0.0))} ms"
            f"{_within(chosen.seconds_low, chosen.seconds_high, 1e3)}"
        )
        print(f"{asked}: {chosen.name}, {figures}, {times}")
        print(f"handbench run {setting_path(found.folder, chosen.name)} -o RESULTS")
    best = sum(setting.on_front for setting in found.settings)
    return f"{options.out}: {best} of {len(found.settings)} settings are beaten by no other"


def quantity(text: str, units: dict[str, float], option: str) -> float:
    """Return the number in a text such as "2mm" or "33 ms", multiplied by the factor of its unit.
    units: unit → factor; option: name of the option, for messages. Raises HandbenchError for any
    other text."""
    found = re.fullmatch(r"\s*(\d+\.?\d*(?:e[+-]?\d+)?|\.\d+)\s*([a-zA-Zµ%]+)\s*", text)
    if found is None or found[2] not in units or not 0 < float(found[1]) < float("inf"):
        raise HandbenchError(
            f"{option}: is '{text}'; expected a number above 0 with its unit: {', '.join(units)}"
        )
    return float(found[1]) * units[found[2]]


def show(tradeoff: Tradeoff, count_acquisition: bool = False) -> None:
    """Print, for every section of a trade-off, a table of the settings that no other beats (the
    front), and the paper's statements about time.
    count_acquisition: add the time of acquisition to that of imaging, which may change the
    front."""
    from handbench.bench.tradeoff.settings import rank, with_acquisition

    for section in tradeoff.facts.sections:
        settings: Sequence[Setting] = tradeoff.section(section.name)
        counted = count_acquisition and section.name == "imaging"
        if counted:
            settings = rank(with_acquisition(settings), section.reference)
        against = "frame and acquisition" if counted else "time"
        print(f"{section.title}: {section.metric} against {against}")
        print(_front(section, settings))
        print(*_beaten(settings), "", sep="\n")
    for claim in tradeoff.facts.claims:
        counted_factor, measured = (
            "–" if f is None else f"{f:.4g}" for f in (claim.counted, claim.measured)
        )
        print(
            f"{claim.text}: the paper says {claim.paper:.4g}, counted {counted_factor}, measured "
            f"{measured}"
        )


def _front(section: Section, settings: Sequence[Setting]) -> str:
    """Return a Markdown table of the settings on a section's front, which no other setting beats,
    and of those that are beaten only by settings of another method."""
    shown = sorted(
        (s for s in settings if s.on_front or s.on_method_front), key=lambda s: s.seconds or 0.0
    )
    columns = {
        "setting": [s.name for s in shown],
        section.unit: [_text(s.error) for s in shown],
        "95 %": [_range(s.low, s.high) for s in shown],
        "seen %": [_text(s.seen_percent, 4) for s in shown],
        "ms": [_text(s.seconds and 1e3 * s.seconds) for s in shown],
        "range": [_range(s.seconds_low, s.seconds_high, 1e3) for s in shown],
        "× reference": [_text(s.ratio, 4) for s in shown],
        "front": ["front" if s.on_front else "its method's" for s in shown],
    }
    return markdown_table(columns, texts=("setting", "95 %", "range", "front"))


def markdown_table(columns: Mapping[str, Sequence[str]], texts: Sequence[str]) -> str:
    """Return a Markdown table whose columns are aligned on a terminal too.
    columns: heading → cells; empty columns are left out. texts: headings of the columns that are
    aligned left."""
    padded = []
    for heading, cells in columns.items():
        if any(cells):
            width, text = max(map(len, (heading, "---", *cells))), heading in texts
            rule = "-" * width if text else "-" * (width - 1) + ":"
            padded.append(
                [f"{cell:{'<' if text else '>'}{width}}" for cell in (heading, rule, *cells)]
            )
    return "".join("| " + " | ".join(line) + " |\n" for line in zip(*padded, strict=True))


def _beaten(settings: Sequence[Setting]) -> list[str]:
    best = sorted((s for s in settings if s.on_front), key=lambda s: (s.seconds, s.error))
    under = {one.name: [s.name for s in settings if s.dominated_by == one.name] for one in best}
    unknown = [s.name for s in settings if s.error is None or s.seconds is None]
    lines = [f"dominated by {name}: {', '.join(names)}" for name, names in under.items() if names]
    return lines + ([f"without a figure: {', '.join(unknown)}"] if unknown else [])


def _text(value: float | None, digits: int = 3) -> str:
    return "" if value is None else f"{value:.{digits}g}"


def _range(low: float | None, high: float | None, scale: float = 1) -> str:
    return f"{scale * low:.3g}–{scale * high:.3g}" if low is not None and high is not None else ""


def _within(low: float | None, high: float | None, scale: float = 1) -> str:
    text = _range(low, high, scale)
    return f" ({text})" if text else ""

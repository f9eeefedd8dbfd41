"""A trade-off in the terminal: fronts, what is dominated and by what, claims; and an answer."""

from dataclasses import asdict, replace

from bench.evaluation.metrics import METRICS
from bench.results import HEADLINE, Section, Setting, Tradeoff
from bench.studies.columns import Record, Table, columns
from bench.studies.tradeoff.answer import Answer, front, with_acquisition
from bench.studies.tradeoff.settings import setting_path


def show(tradeoff: Tradeoff, count_acquisition: bool = False) -> None:
    """Print all sections; with the acquisition counted, the imaging front is that of frame and acquisition together."""
    for section in tradeoff.facts.sections:
        settings = tradeoff.section(section.name)
        counted = count_acquisition and section.name == "imaging"
        if counted:
            settings = tuple(with_acquisition(s) for s in settings if s.acquisition_s is not None)
        print(f"{section.title}: {section.metric} against {'frame and acquisition' if counted else 'time'}")
        print(_front(section, settings).markdown())
        print(*_dominated(settings, [s.name for s in front(settings)]), "", sep="\n")
    for claim in tradeoff.facts.claims:
        counted_factor, measured = (_number(factor) or "–" for factor in (claim.counted, claim.measured))
        print(f"{claim.text}: the paper says {claim.paper:.4g}, counted {counted_factor}, measured {measured}")


def say_answer(tradeoff: Tradeoff, answer: Answer) -> None:
    """Print an answer, and the command that runs it."""
    s, title = answer.setting, METRICS[HEADLINE].title
    print(
        f"{answer.asked}: {s.name}, {title} {s.error:.3g} mm ({_range(s.low, s.high)}), {1e3 * s.seconds:.3g} ms "
        f"({_range(s.seconds_low, s.seconds_high, 1e3)})"
    )
    print(f"handbench run {setting_path(tradeoff.folder, s.name)} -o RESULTS")


def _front(section: Section, settings: tuple[Setting, ...]) -> Table:
    """The front, and the settings that are the best of their own method alone."""
    best = [s.name for s in front(settings)]
    unit = next((s.seconds for s in settings if s.name == section.reference), None)
    shown = sorted((s for s in settings if s.name in best or s.on_method_front), key=lambda s: s.seconds)
    known = [replace(c, heading=section.unit) if c.name == "error" else c for c in columns("tradeoff.front")]
    return Table("front", known, [_record(s, s.name in best, unit) for s in shown])


def _record(s: Setting, best: bool, unit: float | None) -> Record:
    ranges = {"interval": _range(s.low, s.high), "range": _range(s.seconds_low, s.seconds_high, 1e3)}
    return {**asdict(s), **ranges, "over": unit and s.seconds / unit, "front": "front" if best else "its method's"}


def _dominated(settings: tuple[Setting, ...], best: list[str]) -> list[str]:
    under = {name: [s.name for s in settings if s.dominated_by == name and s.name not in best] for name in best}
    unknown = [s.name for s in settings if s.error is None or s.seconds is None]
    lines = [f"dominated by {name}: {', '.join(names)}" for name, names in under.items() if names]
    return lines + ([f"without a figure: {', '.join(unknown)}"] if unknown else [])


def _range(low: float | None, high: float | None, scale: float = 1) -> str:
    return f"{scale * low:.3g}–{scale * high:.3g}" if low is not None and high is not None else ""


def _number(value: float | None) -> str:
    return "" if value is None else f"{value:.4g}"

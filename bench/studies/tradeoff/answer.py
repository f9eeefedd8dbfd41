"""The settings that are worth their time, which of them to take, and both in the terminal.

On the front stand those that nothing else beats: nothing is at least as fast, accurate and complete, and better in one.
A map that shows twice as much of a hand is not beaten by a more accurate one of half of it.

To take is the cheapest that is accurate enough, or the most accurate that is fast enough. A setting is held to the
upper end of its error's interval, and to a tenth more than the slowest of its rounds, so that a later run of it, which
is one more draw, keeps what this one promised. Too few captures have no interval: the error is then that of these.
"""

import re
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace

from handbench.bench.evaluation.metrics import METRICS
from handbench.bench.evaluation.tables import declared
from handbench.bench.results import HEADLINE, Section, Setting, Tradeoff
from handbench.bench.studies.columns import Record, Table
from handbench.bench.studies.tradeoff.settings import setting_path
from handbench.support.errors import HandbenchError

LENGTHS = {"mm": 1.0, "um": 1e-3, "µm": 1e-3, "cm": 10.0, "m": 1e3}  # in millimetres
HEADROOM = 1.1  # of a later run over the slowest round: the rounds are few
TIMES = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "µs": 1e-6, "min": 60.0}


def dominates(one: Setting, other: Setting) -> bool:
    """True where `one` is at least as fast, accurate and complete as `other`, and better in one; neither lacks an error
    or a time."""
    ours, theirs = ((s.seconds, s.error, -(s.seen_percent or 0.0)) for s in (one, other))
    return ours != theirs and all(a <= b for a, b in zip(ours, theirs, strict=True))


def front(settings: Sequence[Setting]) -> list[Setting]:
    """The settings that nothing dominates, fastest first; one without error or time is never among them."""
    known = [s for s in settings if s.error is not None and s.seconds is not None]
    return sorted((s for s in known if not any(dominates(t, s) for t in known)), key=lambda s: (s.seconds, s.error))


def rank(settings: Sequence[Setting], reference: str) -> list[Setting]:
    """The settings of one section with ratio (to the reference's seconds), on_front, on_method_front and dominated_by
    filled in. Of several that dominate a setting the most accurate one of the front is named."""
    best = front(settings)
    methods = {s.method for s in settings}
    own = [s for m in methods for s in front([s for s in settings if s.method == m])]
    unit = next((s.seconds for s in settings if s.name == reference), None)
    ranked = []
    for setting in settings:
        known = setting.error is not None and setting.seconds is not None
        over = [s for s in best if dominates(s, setting)] if known else []
        ratio = setting.seconds / unit if setting.seconds is not None and unit else None
        by = min(over, key=lambda s: (s.error, s.seconds)).name if over else ""
        fronts = {"on_front": setting in best, "on_method_front": setting in own}
        ranked.append(replace(setting, ratio=ratio, dominated_by=by, **fronts))
    return ranked


def with_acquisition(setting: Setting) -> Setting:
    """The setting with the time of its acquisition counted."""
    add = setting.acquisition_s or 0.0
    times = (None if s is None else s + add for s in (setting.seconds, setting.seconds_low, setting.seconds_high))
    return replace(setting, **dict(zip(("seconds", "seconds_low", "seconds_high"), times, strict=True)))


@dataclass(frozen=True)
class Answer:
    """setting: with its acquisition among its seconds, where that was asked for; asked: the question in words."""

    setting: Setting
    asked: str


def quantity(text: str, units: dict[str, float], option: str) -> float:
    """A number with its unit, 2mm or 33 ms, in the unit whose factor is 1; a HandbenchError for anything else."""
    found = re.fullmatch(r"\s*(\d+\.?\d*(?:e[+-]?\d+)?|\.\d+)\s*([a-zA-Zµ%]+)\s*", text)
    if found is None or found[2] not in units or not 0 < float(found[1]) < float("inf"):
        raise HandbenchError(f"{option}: is '{text}'; expected a number above 0 with its unit: {', '.join(units)}")
    return float(found[1]) * units[found[2]]


def answer(
    tradeoff: Tradeoff,
    max_error_mm: float | None = None,
    max_seconds: float | None = None,
    count_acquisition: bool = False,
) -> Answer:
    """The imaging setting for a largest error (the cheapest), a longest time (the most accurate), or both (the
    cheapest). Raises HandbenchError where none keeps to it, naming the nearest."""
    settings = [s for s in tradeoff.section("imaging") if s.error is not None and s.seconds is not None]
    if count_acquisition:
        settings = [with_acquisition(s) for s in settings if s.acquisition_s is not None]
    if not settings:
        raise HandbenchError(f"{tradeoff.folder}: has no imaging settings to choose from; sweep the section imaging")
    time_of = "frame and acquisition" if count_acquisition else "frame"
    limits = [f"{METRICS[HEADLINE].title} ≤ {max_error_mm:g} mm"] if max_error_mm is not None else []
    limits += [f"{time_of} ≤ {1e3 * max_seconds:g} ms"] if max_seconds is not None else []
    asked = " and ".join(limits)
    fit = [s for s in settings if _excess(s, max_error_mm, max_seconds) <= 1]
    if not fit:
        near = min(settings, key=lambda s: _excess(s, max_error_mm, max_seconds))
        bound = f"up to {near.high:.3g} mm" if near.high is not None else "on these captures"
        raise HandbenchError(
            f"no setting has {asked}; the nearest, '{near.name}', has {near.error:.3g} mm ({bound}) in "
            f"{1e3 * near.seconds:.3g} ms (up to {1e3 * _slowest_s(near):.3g}): allow more, or sweep further"
        )
    cheapest = max_error_mm is not None
    chosen = min(fit, key=lambda s: (s.seconds, s.error) if cheapest else (s.error, s.seconds))
    few = " on these captures, too few to promise it for others" if cheapest and chosen.high is None else ""
    return Answer(chosen, f"{'the cheapest' if cheapest else 'the most accurate'} with {asked}{few}")


def _excess(setting: Setting, max_error_mm: float | None, max_seconds: float | None) -> float:
    """By what factor the setting goes beyond the limits at worst; at most 1: it keeps to them."""
    error_mm = setting.error if setting.high is None else setting.high
    factors = [error_mm / max_error_mm] if max_error_mm is not None else []
    return max(factors + ([_slowest_s(setting) / max_seconds] if max_seconds is not None else []))


def _slowest_s(setting: Setting) -> float:
    """The time that a later run may take."""
    return HEADROOM * setting.seconds_high


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
        counted_factor, measured = ("–" if f is None else f"{f:.4g}" for f in (claim.counted, claim.measured))
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
    known = [replace(c, heading=section.unit) if c.name == "error" else c for c in declared(__file__)["front"].columns]
    records: list[Record] = [
        {
            **asdict(s),
            "interval": _range(s.low, s.high),
            "range": _range(s.seconds_low, s.seconds_high, 1e3),
            "over": unit and s.seconds / unit,
            "front": "front" if s.name in best else "its method's",
        }
        for s in shown
    ]
    return Table("front", known, records)


def _dominated(settings: tuple[Setting, ...], best: list[str]) -> list[str]:
    under = {name: [s.name for s in settings if s.dominated_by == name and s.name not in best] for name in best}
    unknown = [s.name for s in settings if s.error is None or s.seconds is None]
    lines = [f"dominated by {name}: {', '.join(names)}" for name, names in under.items() if names]
    return lines + ([f"without a figure: {', '.join(unknown)}"] if unknown else [])


def _range(low: float | None, high: float | None, scale: float = 1) -> str:
    return f"{scale * low:.3g}–{scale * high:.3g}" if low is not None and high is not None else ""

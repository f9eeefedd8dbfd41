"""Which settings are worth their time: nothing else is at least as fast, accurate and complete, and better in one.

A map that shows twice as much of a hand is not beaten by a more accurate one of half of it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from bench.results import Setting


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

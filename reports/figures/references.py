"""The reference surfaces that pictures show, and a note on their own errors."""

from collections.abc import Iterable

from handbench.bench.evaluation.metrics import HEADLINE
from handbench.bench.evaluation.scoring_protocols import REFERENCES
from handbench.bench.results.about import CaptureFacts
from handbench.bench.results.result_folder import Result
from handbench.reports.tables.rounding import figure

DRAWN = ("photogrammetry", "truth")  # the completed reference is drawn in these two


def drawn_references(captures: Iterable[CaptureFacts]) -> list[str]:
    """Return the references that pictures show and against which one of the captures is scored."""
    scored = {reference for capture in captures for reference in capture.references}
    return [reference for reference in DRAWN if reference in scored]


def floor_note(result: Result) -> str:
    """Return a sentence on the ground-truth floor for the captions of error maps. The floor is the
    mean error that a perfect radar would show, because the reference itself has errors.
    For each reference surface it gives the largest floor of all methods, mm. The sentence begins
    with a blank; "" if no floor is above zero."""
    floors = result.table[result.table.metric == "floor_mm"].groupby("reference").value.max()
    texts = [
        f"{figure(floors[reference], unit='mm')} mm against {reference}"
        for reference in REFERENCES
        if floors.get(reference, 0.0) > 0
    ]
    floor = f"Ground-truth floor, the {result.title(HEADLINE)} of a perfect radar"
    return f" {floor}: {', '.join(texts)}." if texts else ""

"""Matching of candidates to the target's elements, by distances alone; ambiguous matches are refused."""

from collections.abc import Sequence
from typing import TypeVar

import numpy as np

from handbench.calibration.spheres.description import Candidate, Target
from handbench.calibration.transforms import umeyama
from handbench.support.errors import HandbenchError

TOLERANCE_M = 0.002  # how far two distances may differ: detection, the target's making, the photographs' scale
MAX_CANDIDATES = 80
Assignment = dict[int, int]  # element → candidate
CandidateT = TypeVar("CandidateT", bound=Candidate)


def match(candidates: Sequence[CandidateT], target: Target, sensor: str) -> dict[int, CandidateT]:
    """Element → candidate for the largest set of candidates that lie as the target's elements do (turned and moved,
    never mirrored). `sensor` names the candidates in errors.

    Raises HandbenchError when fewer than min(4, all) elements fit, when they lie on a line, or when the set can be
    read in more than one way: a symmetric target, or its asymmetric element unseen.
    """
    needed = min(4, len(target.element))
    found = assignments(candidates[:MAX_CANDIDATES], target)
    if not found or len(found[0]) < needed:
        raise HandbenchError(
            f"{sensor}: {len(found[0]) if found else 0} of {len(candidates)} candidates lie as the target's elements "
            f"do, expected at least {needed} of {len(target.element)}; check the target's description, the scale and "
            "that every element is in view"
        )
    best = found[0]
    if len(found) > 1:
        seen = ", ".join(str(element + 1) for element in sorted(best))
        raise HandbenchError(
            f"{sensor}: the target's elements {seen} can be matched in {len(found)} ways; use a target without "
            "symmetry and make sure that the element that breaks it is seen"
        )
    return {element: candidates[candidate] for element, candidate in best.items()}


def assignments(candidates: Sequence[Candidate], target: Target) -> list[Assignment]:
    """All assignments of the greatest size in which every pair of candidates is as far apart as its elements (within
    TOLERANCE_M) and a rotation carries all elements to their candidates."""
    centres_m = np.array([candidate.centre_m for candidate in candidates]).reshape(-1, 3)
    wanted_m, measured_m = _pairwise(target.centres_m), _pairwise(centres_m)
    count = len(target.element)
    found: list[Assignment] = []
    best = 3

    def extend(element: int, chosen: Assignment) -> None:
        nonlocal best, found
        if len(chosen) + count - element < best:
            return  # cannot become as large as what is known
        if element == count:
            if _is_rotation(chosen, target.centres_m, centres_m):
                found = [chosen] if len(chosen) > best else [*found, chosen]
                best = len(chosen)
            return
        for i, candidate in enumerate(candidates):
            others = list(chosen)
            gaps = measured_m[i, [chosen[o] for o in others]] - wanted_m[element, others]
            if element in candidate.elements and (np.abs(gaps) < TOLERANCE_M).all():
                extend(element + 1, {**chosen, element: i})
        extend(element + 1, chosen)  # the element is not seen

    extend(0, {})
    return found


def _is_rotation(chosen: Assignment, elements_m: np.ndarray, centres_m: np.ndarray) -> bool:
    """Distances cannot tell a set from its mirror image; the best rotation can."""
    source, target = elements_m[list(chosen)], centres_m[list(chosen.values())]
    matrix = umeyama(source, target)
    offset = target - source @ matrix[:3, :3].T - matrix[:3, 3]
    return bool(np.linalg.norm(offset, axis=1).max() < TOLERANCE_M)


def _pairwise(points_m: np.ndarray) -> np.ndarray:
    return np.linalg.norm(points_m[:, None] - points_m[None], axis=2)

"""Placements of the calibration target with which something is wrong."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from handbench.bench.scenes.target_placements import Placement, placement
from handbench.calibration.spheres.description import Target


@dataclass(frozen=True)
class Case(Placement):
    """One placement. fault: none, two hidden, fifth missing, wrong file, or one that a study
    adds."""

    fault: str = "none"

    @property
    def heard(self) -> tuple[int, ...]:
        """Indices of the elements that the radar sees."""
        hidden = {
            "two hidden": (self.number % 4, (self.number + 1) % 4),
            "fifth missing": (4,),
        }.get(self.fault, ())
        return tuple(i for i in range(len(self.described.element)) if i not in hidden)

    @property
    def seen(self) -> tuple[int, ...]:
        """Indices of the elements that the cameras see: the same, or, in every second placement,
        all."""
        return (
            self.heard if self.number // 8 % 2 == 0 else tuple(range(len(self.described.element)))
        )


def case(number: int, folder: Path, fault: str = "none", photographs: bool = True) -> Case:
    """Placement `number` with a fault, and with eight cameras for photographs."""
    placed = placement(number, folder, **({"photos": {"cameras": 8}} if photographs else {}))
    return Case(
        number,
        placed.scene,
        wrong(placed.described) if fault == "wrong file" else placed.described,
        fault,
    )


def wrong(target: Target) -> Target:
    """A description of another target: the square 20 mm larger."""
    larger = 1 + 0.02 / 0.12
    return target.model_copy(
        update={
            "element": tuple(
                e.model_copy(update={"centre_m": tuple((larger * np.array(e.centre_m)).tolist())})
                for e in target.element
            )
        }
    )

"""The cases: one hand scene with a plausible cause for every effect, and what is switched in each
case."""

from __future__ import annotations

import tomllib
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from handbench.bench.scenes.scene_file import SceneFile
from handbench.radar.simulation.known_effects import IDS
from handbench.support.config import parse

CAUSES: dict[str, Any] = tomllib.loads(Path(__file__).with_name("causes.toml").read_text("utf-8"))
ROUGH = {"rms_m": 3e-5, "correlation_m": 1e-3}
TREMOR = {"amplitude_m": 5e-5, "frequency_hz": 9.0}
SKIN, PRINTED = {"kind": "skin"}, {"kind": "plastic", "permittivity": 2.7, "loss_tangent": 0.01}
REFERENCE = (
    "obliquity",
    "shadow_antennas",
    "skin",
    "multipath",
    "noise",
)  # what a hand before absorber calls for


@dataclass(frozen=True)
class Case:
    """One row: the effects that are on, and the one by which it differs from the case `against`."""

    name: str
    effect: str
    effects: tuple[str, ...]
    material: dict[str, Any]
    against: str = "reference"


def cases() -> list[Case]:
    """The reference, each of its effects left out, coarser shadows, and each other effect added."""
    rows = [Case("reference", "", REFERENCE, SKIN)]
    rows += [Case(f"without {name}", name, _without(name), SKIN) for name in REFERENCE]
    rows.append(
        Case(
            "shadow_centre instead",
            "shadow_centre",
            (*_without("shadow_antennas"), "shadow_centre"),
            SKIN,
        )
    )
    printed = (*_without("skin"), "dielectric")
    rows.append(
        Case("dielectric instead of metal", "dielectric", printed, PRINTED, against="without skin")
    )
    known = {case.effect for case in rows} | set(REFERENCE)
    return rows + [Case(name, name, (*REFERENCE, name), SKIN) for name in IDS if name not in known]


def _without(name: str) -> tuple[str, ...]:
    return tuple(effect for effect in REFERENCE if effect != name)


def scene_file(pose: str, case: Case, seed: int = 1) -> SceneFile:
    """The case's scene file."""
    target = {
        "kind": "hand",
        "pose": pose,
        "material": case.material,
        "motion": TREMOR,
        "roughness": ROUGH,
    }
    values = {
        "version": 1,
        "name": pose,
        "seed": seed,
        "target": target,
        "effects": list(case.effects),
        **CAUSES,
    }
    return parse(SceneFile, values, f"case '{case.name}'")

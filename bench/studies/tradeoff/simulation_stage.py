"""Sampling × which effects are on: how near maps of simulated echoes come to those of exact ones, in millimetres."""

from dataclasses import dataclass, fields
from itertools import product
from typing import Annotated, Any

import numpy as np
from pydantic import AfterValidator, Field, field_validator

from handbench.bench.results import Section, Setting
from handbench.bench.scenes.scene_file import known_effects
from handbench.bench.studies.exact.cases import LONG_M, Case, body, cases, kept_echoes, maps, tones_hz
from handbench.bench.studies.exact.cylinders import ALONG
from handbench.bench.studies.tradeoff.measuring import in_turns
from handbench.bench.studies.tradeoff.opening import Context, line, section
from handbench.radar.data.arrays import qar50
from handbench.radar.data.capture import RadarCapture
from handbench.radar.simulation.catalogue import CONTAINED, EFFECTS
from handbench.radar.simulation.known_effects import Choice
from handbench.radar.simulation.scene import EchoScene
from handbench.radar.simulation.selection import choose
from handbench.radar.simulation.simulate import simulate_scene
from handbench.radar.warmup import compile_kernels
from handbench.support.config import Config, suggest

ORDINARY = 4.0  # facets, and mirrors of two bounces, to a wavelength in every simulation
METHOD = "3fsk"
Positive = Annotated[float, Field(gt=0)]


class SimulationKnobs(Config):
    """scenes: of studies/exact/cases.py, dipoles along the cylinders. Facets' and mirrors' edges that fit into the
    shortest wavelength, at least, and how much farther apart than in every simulation the antennas are for which two
    bounces are traced. without: lists of effects that are left out of all; [] leaves out none. tolerance_mm: of
    `effects = "auto"`. The first of each is combined with the others' first, and facets with all of `without`."""

    scenes: tuple[str, ...] = Field(("fingers 6 mm apart, skin", "finger before palm, skin"), min_length=1)
    facets_per_wavelength: tuple[Positive, ...] = Field((ORDINARY, 2.0), min_length=1)
    mirrors_per_wavelength: tuple[Positive, ...] = Field((ORDINARY, 2.0, 8.0), min_length=1)
    nodes_apart: tuple[Positive, ...] = Field((1.0, 2.0, 0.5), min_length=1)
    without: tuple[Annotated[tuple[str, ...], AfterValidator(known_effects)], ...] = (
        (),
        ("multipath",),
        ("multipath", "shadow_diffraction"),
        ("multipath", "shadow_diffraction", "shadow_antennas"),
        ("multipath", "shadow_diffraction", "shadow_antennas", "shadow_centre"),
    )
    tolerance_mm: tuple[Positive, ...] = (0.1, 1.0)

    @field_validator("scenes")
    @classmethod
    def _there(cls, scenes: tuple[str, ...]) -> tuple[str, ...]:
        for name in scenes:
            if name not in _cases():
                raise ValueError(f"'{name}' is no exact scene; {suggest(name, list(_cases()))}")
        return scenes


@dataclass(frozen=True)
class Way:
    """One way to simulate: the samplings, and the effects by what is left out or, by a tolerance, as auto chooses."""

    facets_per_wavelength: float = ORDINARY
    mirrors_per_wavelength: float = ORDINARY
    nodes_apart: float = 1.0
    without: tuple[str, ...] = ()
    tolerance_mm: float | None = None

    @property
    def words(self) -> str:
        """The sampling, where it is not the ordinary one, and the effects."""
        words = {
            "facets_per_wavelength": "{:g} facets per wavelength",
            "mirrors_per_wavelength": "{:g} mirrors per wavelength",
            "nodes_apart": "nodes {:g} times as far apart",
        }
        said = [text.format(self.knobs[key]) for key, text in words.items() if key in self.knobs]
        if self.tolerance_mm is not None:
            return ", ".join([*said, f"auto at {self.tolerance_mm:g} mm"])
        return ", ".join([*said, f"without {', '.join(self.without)}" if self.without else "all effects"])

    @property
    def name(self) -> str:
        """The setting's name, as 2-facets-all-effects."""
        return self.words.replace(" per wavelength", "").replace(",", "").replace(" ", "-")

    @property
    def knobs(self) -> dict[str, Any]:
        """Its values that are not the ordinary ones."""
        usual = Way()
        given = {field.name: getattr(self, field.name) for field in fields(self)}
        return {key: value for key, value in given.items() if value != getattr(usual, key)}

    def simulate(self, case: Case, frequencies_hz: np.ndarray) -> np.ndarray:
        """One frame's samples [f, tx, rx]."""
        scene = EchoScene(
            qar50(),
            frequencies_hz,
            np.zeros(len(frequencies_hz)),
            body(case),
            coarser=ORDINARY / self.facets_per_wavelength,
            mirrors_coarser=self.facets_per_wavelength / self.mirrors_per_wavelength,
            nodes_apart=self.nodes_apart,
        )
        return simulate_scene(scene, self.choices(scene)).capture.samples[0]

    def choices(self, scene: EchoScene) -> tuple[Choice, ...]:
        """The rows of the effects."""
        if self.tolerance_mm is not None:
            return choose(scene, "auto", self.tolerance_mm)
        left = [effect.id for effect in EFFECTS if not effect.missing(scene) and effect.id not in self.without]
        return choose(scene, tuple(id for id in left if CONTAINED.get(id) not in left), tolerance_mm=0.0)


def measure(knobs: SimulationKnobs, context: Context) -> tuple[Section, list[Setting]]:
    """Simulate the exact scenes every way, in turns. Exact echoes are kept in the work folder."""
    frequencies_hz, known, listed = tones_hz("few"), _cases(), ways(knobs)
    chosen = {name: known[name] for name in knobs.scenes}
    exact = {name: kept_echoes(case, frequencies_hz, qar50(), context.work / "exact") for name, case in chosen.items()}
    compile_kernels()
    work = {
        (way, name): lambda way=way, case=case: way.simulate(case, frequencies_hz)
        for way in listed
        for name, case in chosen.items()
    }
    times, samples = in_turns(work, context.repeats, "simulation")
    true_m = {name: _depths(echoes, frequencies_hz) for name, echoes in exact.items()}
    about = section("simulation", listed[0].name, {"scenes": "; ".join(knobs.scenes)})
    settings = []
    for way in listed:
        found = [compared(_depths(samples[way, name], frequencies_hz), true_m[name]) for name in chosen]
        error_mm, both = (float(figure) for figure in np.mean(found, axis=0))
        seconds = np.mean([times[way, name] for name in chosen], axis=0).tolist()
        settings.append(line(about, way.name, way.words, way.knobs, error_mm, seconds=seconds, seen_percent=100 * both))
    return about, settings


def ways(knobs: SimulationKnobs) -> list[Way]:
    """Each once."""
    facets, mirrors, nodes = knobs.facets_per_wavelength, knobs.mirrors_per_wavelength, knobs.nodes_apart
    first = facets[0], mirrors[0], nodes[0]
    listed = [Way(n, min(n, mirrors[0]), nodes[0], names) for n, names in product(facets, knobs.without)]
    usual = knobs.without[0] if knobs.without else ()
    listed += [Way(first[0], n, first[2], usual) for n in mirrors] + [Way(*first[:2], n, usual) for n in nodes]
    listed += [Way(*first, tolerance_mm=mm) for mm in knobs.tolerance_mm]
    return list(dict.fromkeys(listed))


def compared(ours_m: np.ndarray, exact_m: np.ndarray) -> tuple[float, float]:
    """Mean |Δz| in mm of the pixels that both maps have, and these over those that either has."""
    here, there = np.isfinite(ours_m), np.isfinite(exact_m)
    both, either = here & there, here | there
    off_mm = 1e3 * np.abs(ours_m - exact_m)[both]
    return float(off_mm.mean()) if len(off_mm) else np.inf, float(both.sum() / max(either.sum(), 1))


def _depths(samples: np.ndarray, frequencies_hz: np.ndarray) -> np.ndarray:
    """Depths of the 3-FSK map where the cylinders' ends do not count."""
    depth = maps(RadarCapture(samples[None], frequencies_hz, qar50()), (METHOD,))[METHOD]
    return depth.z_m[np.abs(depth.y_m) < LONG_M]


def _cases() -> dict[str, Case]:
    """The exact scenes by name and material."""
    return {f"{case.name}, {case.material}": case for case in cases(ALONG)}

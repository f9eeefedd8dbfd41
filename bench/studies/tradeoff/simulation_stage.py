"""Sampling of surfaces × which effects are on: how near simulated echoes come to those of the finest simulation."""

from dataclasses import dataclass, replace
from functools import partial
from itertools import product
from typing import Annotated, Any

import numpy as np
from pydantic import Field, field_validator

from bench.results import Section, Setting
from bench.scenes.build import Scene, load_scene
from bench.scenes.echoes import echo_scene
from bench.studies.study import in_turns
from bench.studies.tradeoff.opening import Context, line, section
from radar.simulation.causes import Noise
from radar.simulation.scene import EchoScene
from radar.simulation.selection import CONTAINED, EFFECTS, Choice, check_names, choose
from radar.simulation.simulate import simulate_scene
from radar.support.config import Config
from radar.support.errors import HandbenchError
from radar.support.files import inside
from radar.support.progress import say
from radar.warmup import compile_kernels

ORDINARY = 4.0  # facets to a wavelength in every simulation


class SimulationKnobs(Config):
    """facets_per_wavelength: how many edges of facets, or of the mirrors of two bounces, fit into the shortest
    wavelength, at least. without: lists of effects that are left out of all that the scene has a cause for, noise
    aside; [] leaves out none. tolerance_mm: of `effects = "auto"`, at the ordinary four facets. finest: the sampling of
    the simulation that the others are held against, which has all effects on."""

    facets_per_wavelength: tuple[Annotated[float, Field(gt=0)], ...] = Field(default=(2.0, 4.0), min_length=1)
    without: tuple[tuple[str, ...], ...] = (
        (),
        ("multipath",),
        ("multipath", "shadow_diffraction"),
        ("multipath", "shadow_diffraction", "shadow_antennas"),
        ("multipath", "shadow_diffraction", "shadow_antennas", "shadow_centre"),
    )
    tolerance_mm: tuple[Annotated[float, Field(gt=0)], ...] = (0.1, 1.0)
    finest: float = Field(default=8.0, gt=0)

    @field_validator("without")
    @classmethod
    def _known(cls, without: tuple[tuple[str, ...], ...]) -> tuple[tuple[str, ...], ...]:
        try:
            for names in without:
                check_names(names)
        except HandbenchError as error:
            raise ValueError(str(error).removeprefix("effects: ")) from None
        return without


@dataclass(frozen=True)
class Way:
    """One way to simulate: the sampling, and the effects by what is left out or, by a tolerance, as auto chooses."""

    facets_per_wavelength: float
    without: tuple[str, ...] = ()
    tolerance_mm: float | None = None

    @property
    def words(self) -> tuple[str, str]:
        """The sampling and the effects."""
        effects = f"without {', '.join(self.without)}" if self.without else "all effects"
        if self.tolerance_mm is not None:
            effects = f"auto at {self.tolerance_mm:g} mm"
        return f"{self.facets_per_wavelength:g} facets per wavelength", effects

    @property
    def name(self) -> str:
        """The setting's name, as 4-facets-all-effects."""
        return "-".join(self.words).replace(" per wavelength", "").replace(",", "").replace(" ", "-")

    @property
    def knobs(self) -> dict[str, Any]:
        """The name that tells it from the others."""
        effects = {"without": self.without} if self.tolerance_mm is None else {"tolerance_mm": self.tolerance_mm}
        return {"facets_per_wavelength": self.facets_per_wavelength, **effects}

    def simulate(self, scene: Scene) -> np.ndarray:
        """One frame's samples [f, tx, rx]."""
        sampled = replace(echo_scene(scene), coarser=ORDINARY / self.facets_per_wavelength)
        return simulate_scene(sampled, self._choices(sampled)).capture.samples[0]

    def _choices(self, scene: EchoScene) -> tuple[Choice, ...]:
        if self.tolerance_mm is not None:
            return choose(scene, "auto", self.tolerance_mm)
        left = [effect.id for effect in EFFECTS if not effect.missing(scene) and effect.id not in self.without]
        return choose(scene, tuple(id for id in left if CONTAINED.get(id) not in left), tolerance_mm=0.0)


def measure(knobs: SimulationKnobs, context: Context) -> tuple[Section, list[Setting]] | None:
    """Simulate the benchmark's first scene every way, in turns; the finest, which is slow, once. None where all its
    captures are recorded."""
    source = next((source for source in context.bench.capture if source.scene is not None), None)
    if source is None:
        say("tradeoff: simulation left out: the benchmark simulates no capture")
        return None
    scene = load_scene(inside(context.base, source.scene, "capture.scene"))
    scene = replace(scene, file=scene.file.model_copy(update={"noise": Noise()}))
    compile_kernels()
    finest = Way(knobs.finest)
    seconds, found = in_turns({finest: partial(finest.simulate, scene)}, 1, "simulation, the finest")
    exact = found[finest]
    more_s, others = in_turns({way: partial(way.simulate, scene) for way in ways(knobs)}, context.repeats, "simulation")
    errors = {way: difference_percent(samples, exact) for way, samples in others.items()}
    about = section("simulation", finest.name, {"scene": scene.file.name, "finest": " and ".join(finest.words)})
    return about, [
        line(about, way.name, ", ".join(way.words), way.knobs, errors.get(way), seconds=times)
        for way, times in {**seconds, **more_s}.items()
    ]


def ways(knobs: SimulationKnobs) -> list[Way]:
    """All but the finest."""
    listed = [Way(n, names) for n, names in product(knobs.facets_per_wavelength, knobs.without)]
    listed += [Way(ORDINARY, tolerance_mm=mm) for mm in knobs.tolerance_mm]
    return [way for way in dict.fromkeys(listed) if way != Way(knobs.finest)]


def difference_percent(samples: np.ndarray, exact: np.ndarray) -> float:
    """Root of the energy of the difference over that of the exact samples, both complex [f, tx, rx], in percent."""
    difference = (samples - exact).astype(np.complex128)
    return 100 * float(np.linalg.norm(difference) / np.linalg.norm(exact.astype(np.complex128)))

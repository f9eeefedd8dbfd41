"""The content of result.json: facts of captures, methods and metrics, and failures. A check refuses
names of captures and methods that would mislead readers."""

import unicodedata
from functools import cache
from pathlib import Path
from typing import Any, Literal, Self

from pydantic import Field, model_validator

from handbench.bench.evaluation.metrics import METRICS
from handbench.bench.evaluation.scoring_protocols import REFERENCES
from handbench.radar.data.grid import Sweep
from handbench.radar.methods.registry import METHODS
from handbench.radar.methods.registry import titles as titles
from handbench.radar.simulation.scene import Choice
from handbench.support.config import Config, Name, Tone, parse
from handbench.support.files import RESULT_BYTES, RESULT_VALUES, read_json

Reference = Literal["photogrammetry", "completed", "truth"]
Measure = Literal["accuracy", "precision"]
MEASURES: tuple[Measure, ...] = ("accuracy", "precision")


def folded(name: str) -> str:
    """Return a name reduced to its letters and digits, in lower case; names that a reader cannot
    tell apart become equal."""
    return "".join(filter(str.isalnum, unicodedata.normalize("NFKC", name).casefold()))


@cache
def _meanings() -> dict[str, str]:
    """Return what a folded name in a table stands for: a reference, or a method's id."""
    of_methods = {folded(name): id for id, title in titles().items() for name in (id, title)}
    return of_methods | {folded(name): name for name in REFERENCES}


def name_problem(name: str, own: str = "") -> str:
    """Explain why a name of a capture or method would mislead readers of a table: it reads as a
    reference, or as another method of handbench. Returns "" if it does not.
    own: id of the method that has the name; "" for a capture."""
    other = _meanings().get(folded(name), own)
    if other == own and other not in REFERENCES:
        return ""
    sort = "the reference" if other in REFERENCES else "handbench's method"
    return f"the name '{name}' reads as {sort} '{other}'; choose another name"


class MetricFacts(Config):
    """The definition of a metric, as recorded in a result: title, unit, direction and definition in
    words."""

    title: str
    unit: str
    better: Literal["lower", "higher", "zero"]
    definition: str


def metric_facts() -> dict[str, MetricFacts]:
    """Return the definitions of all metrics, as recorded in every result: metric → title, unit,
    direction and definition."""
    return {
        key: MetricFacts.model_validate(metric, from_attributes=True)
        for key, metric in METRICS.items()
    }


class CaptureFacts(Config):
    """One capture of a result.
    measures: "accuracy" (its depths are compared with `references`, pixel by pixel), "precision"
    (scatter of the depths over repeated frames), or both. own_mesh: whether the reference
    "photogrammetry" is the capture's own mesh.ply. effects: for a simulated capture, each simulated
    effect with its size and cost, and whether it was on."""

    name: Name
    measures: tuple[Measure, ...] = MEASURES
    pose: str | None = None
    distance_m: float | None = None
    references: tuple[Reference, ...] = ()
    own_mesh: bool = False
    effects: tuple[Choice, ...] = ()


class Sigmas(Config, extra="allow"):
    """The parts of a reference's σ, mm, and the names of those that are unknown."""

    __pydantic_extra__: dict[str, float | None]
    unknown: tuple[str, ...] = ()


class Facts(Config, extra="allow"):
    """The types of the further facts of a result that reports use."""

    warnings: dict[str, tuple[str, ...]] = Field(default_factory=dict)
    refined_transforms: dict[str, str] = Field(default_factory=dict)
    groundtruth_sigma_rms: dict[str, Sigmas] = Field(default_factory=dict)
    registration_residuals_mm: tuple[float, ...] = ()
    registration_error_at_hand_mm: float | None = None


class Settings(Config, extra="allow"):
    """The types of a method's settings that reports use."""

    tones_hz: tuple[Tone, ...] | Sweep = ()


class MethodFacts(Config):
    """One method of a result: its name, title, id (the same for several settings of one method),
    and its complete configuration on each capture."""

    name: Name
    title: str
    id: str = ""
    config: dict[str, dict[str, Any]] = Field(default_factory=dict)

    @property
    def foreign(self) -> bool:
        """Whether it is none of handbench's methods."""
        return self.id not in METHODS

    @model_validator(mode="after")
    def _is_clear(self) -> Self:
        for name in (self.name, self.title):
            if problem := name_problem(name, self.name):
                raise ValueError(problem)
        return self


class Failure(Config):
    """A stage of a run that failed, with the error message. method is "" if the failure affects all
    methods of the capture."""

    capture: str
    method: str = ""
    stage: str
    message: str

    @property
    def line(self) -> str:
        """The failure as one line of text: "CAPTURE METHOD: STAGE failed: MESSAGE"."""
        return f"{f'{self.capture} {self.method}'.strip()}: {self.stage} failed: {self.message}"


class About(Config):
    """Content of result.json.
    inputs: capture → hash of its content. captures, methods: those in the table. facts: further
    information, such as phase noise, intervals, and the uncertainty of the ground truth. failures:
    stages that failed, with their errors."""

    schema_version: Literal[1] = 1
    name: str
    protocol: dict[str, Any]
    metrics: dict[str, MetricFacts]
    inputs: dict[str, str]
    versions: dict[str, str]
    machine: dict[str, Any]
    captures: tuple[CaptureFacts, ...]
    methods: tuple[MethodFacts, ...]
    facts: dict[str, Any] = Field(default_factory=dict)
    failures: tuple[Failure, ...] = ()

    @property
    def method_titles(self) -> dict[str, str]:
        """Name → title of the methods, in the order of the table."""
        return {method.name: method.title for method in self.methods}


def read_about(path: Path) -> About:
    """Read and check result.json. Raises HandbenchError for another schema_version or wrong
    content."""
    what = "a benchmark's result, which a run writes at its end (`handbench run` resumes it)"
    content = read_json(path, what, RESULT_VALUES, RESULT_BYTES)
    about = parse(About, content, str(path))
    parse(Facts, about.facts, f"{path}: facts")
    for method, (capture, config) in ((m, of) for m in about.methods for of in m.config.items()):
        parse(Settings, config, f"{path}: method '{method.name}' on '{capture}'")
    return about

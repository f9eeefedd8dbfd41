"""Content of result.json: names, facts of captures, methods and metrics, failures."""

import unicodedata
from pathlib import Path
from typing import Any, Literal, Self

from pydantic import Field, model_validator

from handbench.bench.evaluation.equal_treatment import EQUAL_METRICS
from handbench.bench.evaluation.equal_treatment import TREATMENTS as TREATMENTS
from handbench.bench.evaluation.equal_treatment import on_common_pixels as on_common_pixels
from handbench.bench.evaluation.metrics import HEADLINE as HEADLINE
from handbench.bench.evaluation.metrics import METRICS, TITLES
from handbench.support.config import Config, ConfigT, Name, parse
from handbench.support.errors import HandbenchError
from handbench.support.files import read_json
from handbench.support.limits import RESULT_BYTES, RESULT_VALUES

# of the surface: what is seen, and what is seen and right
SHARES = ("observed_percent", "complete_2mm_percent")
# read at a glance
HEADLINES = (HEADLINE, "floor_mm", "max_mm", *SHARES, *EQUAL_METRICS, "precision_mm", "seconds")
# completed: by the truth, where photogrammetry has no surface
REFERENCES = ("photogrammetry", "completed", "truth")
Reference = Literal["photogrammetry", "completed", "truth"]
Measure = Literal["accuracy", "precision"]
MEASURES: tuple[Measure, ...] = ("accuracy", "precision")


def folded(name: str) -> str:
    """Return what a reader sees of a name: its letters and digits, without case."""
    return "".join(filter(str.isalnum, unicodedata.normalize("NFKC", name).casefold()))


# what a name in a table stands for: a reference, or a method's id
STANDS_FOR = {folded(name): name for name in REFERENCES} | {
    folded(name): id for id, title in TITLES.items() for name in (id, title)
}


def name_problem(name: str, own: str = "") -> str:
    """Say whether a table's reader would take a method's or a capture's name for a reference or for
    another method of handbench; "" if not. own: the id of the method that it names."""
    other = STANDS_FOR.get(folded(name), "")
    if other in REFERENCES:
        return f"'{name}' has the same meaning as '{other}', a reference; choose another name"
    if other not in ("", own):
        return (
            f"'{name}' has the same meaning as '{other}', a method of handbench; choose another "
            "name"
        )
    return ""


class MetricFacts(Config):
    """A metric as it was defined when the result was made."""

    title: str
    unit: str
    better: Literal["lower", "higher", "zero"]
    definition: str


def metric_facts() -> dict[str, MetricFacts]:
    """The definitions of the metrics, as recorded in every result."""
    return {
        key: MetricFacts.model_validate(metric, from_attributes=True)
        for key, metric in METRICS.items()
    }


class CaptureFacts(Config):
    """One capture of a result.
    measures: "accuracy" (scored pixel by pixel against `references`), "precision" (by the scatter
    over repeats), or both. effects: for a simulated capture, the simulated effects: on or off, size
    and cost of each."""

    name: Name
    measures: tuple[Measure, ...] = MEASURES
    pose: str | None = None
    distance_m: float | None = None
    references: tuple[Reference, ...] = ()
    effects: tuple[dict[str, Any], ...] = ()

    @model_validator(mode="before")
    @classmethod
    def _of_before(cls, given: Any) -> Any:
        """Accept the form of earlier versions: a `kind`, which was "accuracy" for captures that
        measured both."""
        if not isinstance(given, dict) or given.get("kind") not in MEASURES:
            return given
        rest = {key: value for key, value in given.items() if key != "kind"}
        return rest if given["kind"] == "accuracy" else {"measures": ("precision",), **rest}


class MethodFacts(Config):
    """One method with its resolved configuration."""

    name: Name
    title: str
    config: dict[str, Any] = Field(default_factory=dict)

    @model_validator(mode="after")
    def _is_clear(self) -> Self:
        for name in (self.name, self.title):
            if problem := name_problem(name, self.name):
                raise ValueError(problem)
        return self


class Failure(Config):
    """A stage that failed, and why. method: empty if the failure concerns all methods of the
    capture."""

    capture: str
    method: str = ""
    stage: str
    message: str

    @property
    def line(self) -> str:
        """The failure as one line of text, "CAPTURE METHOD: STAGE failed: MESSAGE"."""
        return (
            f"{' '.join(filter(None, (self.capture, self.method)))}: {self.stage} failed: "
            f"{self.message}"
        )


class About(Config):
    """Content of result.json.
    inputs: capture → hash of its content. captures, methods: those in the table. facts: what else
    is known, as the noise, the intervals and the ground truth's uncertainty. failures: what was
    left out, and why."""

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


def read_facts(model: type[ConfigT], path: Path, what: str, remedy: str) -> ConfigT:
    """Read and check result.json, or a file like it, as a `model`.
    what, remedy: for messages: what the file is, and what to do if its version is another. Raises
    HandbenchError for another schema_version or wrong content."""
    content = read_json(path, what, RESULT_VALUES, RESULT_BYTES)
    version = content.get("schema_version") if isinstance(content, dict) else None
    ours = model.model_fields["schema_version"].default
    if version != ours:
        raise HandbenchError(
            f"{path}: schema_version is {version!r}, but this version of handbench reads {ours}; "
            f"{remedy}"
        )
    return parse(model, content, str(path))

"""Problems of capture folders."""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from handbench.bench.datasets.native import (
    ARRAY,
    ECHOES,
    EMPTY,
    FAR_M,
    MESH,
    PHOTOS,
    TARGET,
    TRANSFORM,
    TRUTH,
    CaptureFile,
)
from handbench.bench.validation.checks import array_warnings, pair_warnings, surface_warnings, transform_warnings
from handbench.bench.validation.photo_problems import photo_problems
from handbench.bench.validation.problems import Found, Location, Problem, Sheet, attempt, parsed
from handbench.calibration.array.array_file import with_calibration
from handbench.calibration.spheres.description import Target
from handbench.calibration.transforms import load_transform
from handbench.groundtruth.mesh.surface import Surface, read_surface
from handbench.radar.data.arrays import PlanarScan
from handbench.radar.data.capture import RadarCapture
from handbench.radar.data.echoes_file import load_capture
from handbench.radar.methods.advice import require_tones
from handbench.radar.methods.registry import Method, method
from handbench.support.config import Config
from handbench.support.errors import HandbenchError
from handbench.support.files import inside


@dataclass(frozen=True)
class Seen:
    """Facts of a capture that a benchmark must know: its name, frequencies [f], number of frames (None: as many as
    asked for), what its sensor asks of methods, whether it can be scored, without and with a transform from elsewhere,
    and what it lacks to calibrate with."""

    name: str | None
    frequencies_hz: np.ndarray | None = None
    frames: int | None = None
    methods: dict[str, dict[str, Any]] | None = None
    scored: tuple[bool, bool] = (True, True)
    lacks: tuple[str, ...] = ()

    @classmethod
    def of(
        cls, about: CaptureFile | None, echoes: RadarCapture | None, scored: tuple[bool, bool], lacks: tuple[str, ...]
    ) -> "Seen":
        """The facts of a capture, of which some could not be read."""
        name, methods = (about.name, about.methods) if about else (None, None)
        frequencies_hz, frames = (echoes.frequencies_hz, len(echoes.samples)) if echoes else (None, None)
        return cls(name, frequencies_hz, frames, methods, scored, lacks)

    def problem_of(self, chosen: Method, asked: dict[str, Any]) -> str | None:
        """The reason why a method, configured as its sensor and `asked` want it, cannot image the capture; None: it
        can."""
        of_sensor = self.methods or {}
        values = {**of_sensor.get(chosen.base or chosen.id, {}), **of_sensor.get(chosen.id, {}), **asked}
        try:
            config = chosen.configure(values, "configuration")
        except HandbenchError:
            return None  # told where it stands
        if self.frequencies_hz is None:
            return None
        samples = np.zeros((1, len(self.frequencies_hz), 1), np.complex64)
        try:
            require_tones(RadarCapture(samples, self.frequencies_hz, PlanarScan(np.zeros((1, 3)))), config)
        except HandbenchError as error:
            return str(error)
        return None


def capture_problems(folder: Path, scored: bool | None = True) -> Found[Seen]:
    """All problems of a capture folder; what is missing is one only where something needs it. scored: whether a
    reference is needed; None: its absence is a warning."""
    found, about = yield from parsed(CaptureFile, folder / "capture.toml", "a capture description")
    if isinstance(found.values, dict):
        yield from _described(folder, found)
    echoes = yield from _echoes(folder)
    surfaces = {}
    for name in (TRUTH, MESH):
        if (folder / name).exists():
            surfaces[name] = yield from surface_problems(folder / name)
    if (folder / TRANSFORM).exists():
        yield from _transform(folder / TRANSFORM, surfaces.get(MESH))
    if (folder / TARGET).exists():
        yield from _target(folder / TARGET)
    if (folder / PHOTOS).is_dir():
        yield from photo_problems(folder / PHOTOS)
    lacks = tuple(name for name in (TARGET, PHOTOS, ECHOES) if not (folder / name).exists())
    kind = about.kind if about is not None else "other"
    if kind == "target" and TARGET in lacks:
        yield Problem(folder, None, f"is a target's capture without {TARGET}; copy the target's description here")
    measured = any((folder / name).exists() for name in (MESH, PHOTOS))
    if scored is not False and kind != "target" and not measured and TRUTH not in surfaces:
        text = f"nothing to score against; add {PHOTOS}, {MESH} or {TRUTH}"
        yield Problem(folder, None, text, warning=scored is None)
    true, carried = TRUTH in surfaces, measured and (folder / TRANSFORM).exists()
    return Seen.of(about, echoes, (true or carried, true or measured), lacks)


def _described(folder: Path, sheet: Sheet) -> Iterator[Problem]:
    """Problems of a capture.toml: of the files, the scene and the methods that it names."""
    contains = sheet.values.get("contains")
    for index, name in enumerate(contains if isinstance(contains, list) else ()):
        at = ("contains", index)
        if not isinstance(name, str):
            continue
        path = yield from sheet.attempt(at, partial(inside, folder, name, "contains"))
        if path is not None and not path.exists():
            yield sheet.problem(at, f"{name} is missing, but is said to be there; copy it again")
    distance_m, box_m = sheet.values.get("distance_m"), sheet.values.get("box_m")
    if isinstance(distance_m, int | float) and abs(distance_m) > FAR_M:
        yield sheet.problem(("distance_m",), f"distance_m is {distance_m:g}; is that millimetres?", warning=True)
    if isinstance(box_m, list) and len(box_m) == 6 and all(isinstance(value, int | float) for value in box_m):
        if any(low >= high for low, high in zip(box_m[:3], box_m[3:], strict=True)):
            text = f"box_m is {box_m}; expected xmin, ymin, zmin, then the larger xmax, ymax, zmax"
            yield sheet.problem(("box_m",), text)
        if max(map(abs, box_m)) > FAR_M:
            yield sheet.problem(("box_m",), f"box_m reaches {max(map(abs, box_m)):g} m; is that millimetres?", True)
    methods = sheet.values.get("methods")
    for id, values in methods.items() if isinstance(methods, dict) else ():
        yield from method_problems(sheet, id, values, ("methods", id), ("methods", id))


def method_problems(sheet: Sheet, id: str, values: Any, at_id: Location, at_values: Location) -> Found[Config | None]:
    """An id that no method has, and what is wrong with its configuration."""
    chosen = yield from sheet.attempt(at_id, lambda: method(id))
    return None if chosen is None else (yield from sheet.complaints(chosen.config, values, at_values))


def _echoes(folder: Path) -> Found[RadarCapture | None]:
    echoes = yield from attempt(folder / ECHOES, lambda: load_capture(folder / ECHOES))
    if echoes is None:
        return None
    calibration, empty = folder / ARRAY, folder / EMPTY
    yield from attempt(calibration, lambda: with_calibration(echoes, calibration))
    if empty.exists():
        yield from attempt(empty, lambda: load_capture(empty))
    for text in (*array_warnings(echoes), *pair_warnings(echoes)):
        yield Problem(folder / ECHOES, None, text, warning=True)
    return echoes


def surface_problems(file: Path) -> Found[Surface | None]:
    """Problems of a surface's file."""
    surface = yield from attempt(file, lambda: read_surface(file))
    for text in surface_warnings(surface) if surface is not None else ():
        yield Problem(file, None, text, warning=True)
    return surface


def _transform(file: Path, mesh: Surface | None) -> Iterator[Problem]:
    transform = yield from attempt(file, lambda: load_transform(file).require("photo", "radar", file))
    for text in transform_warnings(transform, mesh) if transform is not None else ():
        yield Problem(file, None, text, warning=True)


def _target(file: Path) -> Iterator[Problem]:
    found, target = yield from parsed(Target, file, "a calibration target description")
    for index, element in enumerate(target.element if target is not None else ()):
        for key in ("centre_m", "sphere_radius_m", "ball_radius_m"):
            largest_m = float(np.abs(getattr(element, key)).max())
            if largest_m > (FAR_M if key == "centre_m" else 1.0):
                text = f"{key} is {largest_m:g} m; is that millimetres?"
                yield found.problem(("element", index, key), text, warning=True)

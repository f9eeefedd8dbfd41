"""The methods that turn echoes into depth maps, by id: the built-in ones, and those of installed
plug-ins.

A package names a module with registered methods as an entry point of the group "handbench.methods",
as handbench itself does.
"""

from __future__ import annotations

import inspect
import re
import sys
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache
from importlib import metadata
from pathlib import Path
from typing import Any

import numpy as np

from handbench.radar.data.capture import RadarCapture
from handbench.radar.data.depthmap import DepthMap
from handbench.support import code_hash
from handbench.support.code_hash import with_version
from handbench.support.config import Config, checked_name, parse, suggest
from handbench.support.errors import HandbenchError
from handbench.support.files import content_hash
from handbench.support.progress import say

GROUP = "handbench.methods"
OWN = "handbench"  # the distribution whose methods are the built-in ones
MOVED = (
    "radar",
    "calibration",
    "groundtruth",
    "bench",
    "reports",
)  # packages of their own until version 0.2
PAPER = (
    "Bräunig et al., An Efficient yet High-Performance Method for Precise Radar-Based "
    "Imaging of Human Hand Poses"
)


@dataclass(frozen=True)
class Reconstruction:
    """A depth map and, from volumetric methods, how to image the complex volume [nz, ny, nx] behind
    it, and its volume_z_m [nz]."""

    depth: DepthMap
    volume: Callable[[], np.ndarray] | None = None
    volume_z_m: np.ndarray | None = None


@dataclass(frozen=True)
class Method:
    """A method: run(capture, config, frame) → Reconstruction, with a declared configuration; a
    variant of the method `base` takes what a sensor asks of that. distribution: the plug-in that it
    comes from (None: built in)."""

    id: str
    config: type[Config]
    run: Callable[[RadarCapture, Any, int], Reconstruction]
    summary: str
    source: str
    base: str | None = None
    distribution: str | None = None

    def configure(self, values: dict[str, Any], where: str) -> Config:
        """The configuration from plain values; unknown keys are errors."""
        return parse(self.config, values, where)


METHODS: dict[str, Method] = {}
BROKEN: dict[str, str] = {}  # plug-ins that are not there, and why
_begun: set[str] = set()

Run = Callable[[RadarCapture, Any, int], Reconstruction]


def register(
    id: str, config: type[Config], summary: str, source: str = PAPER, base: str | None = None
) -> Callable[[Run], Run]:
    """Decorator that adds a function run(capture, config, frame) → Reconstruction to the registry.
    Raises HandbenchError for an id that is taken or no name, and for a configuration without
    defaults."""

    def add(run: Run) -> Run:
        if id in METHODS:
            raise HandbenchError(
                f"method '{id}' is registered twice, first by "
                f"{METHODS[id].distribution or 'handbench'}; "
                "choose another id"
            )
        try:
            checked_name(id)
        except ValueError as error:
            raise HandbenchError(f"method '{id}': {error}") from None
        if base is not None and base not in METHODS:
            raise HandbenchError(
                f"method '{id}': is a variant of '{base}'; {suggest(base, list(METHODS))}"
            )
        parse(config, {}, f"method '{id}': defaults")
        METHODS[id] = Method(id, config, run, summary, source, base)
        return run

    return add


def method(id: str) -> Method:
    """The method with this id; an unknown id names the nearest, and the plug-ins that it may be
    missing with."""
    _load()
    if id not in METHODS:
        missing = f"; plug-ins that could not be loaded: {', '.join(BROKEN)}" if BROKEN else ""
        raise HandbenchError(f"method: unknown id '{id}'; {suggest(id, list(METHODS))}{missing}")
    return METHODS[id]


def methods() -> list[Method]:
    """All methods, the built-in ones first, in the order of their registration."""
    _load()
    return list(METHODS.values())


def method_key(id: str) -> tuple[str, ...]:
    """`source_key` of the method with this id; of none, "", and of one that only its depth maps are
    of: nothing."""
    _load()
    return source_key(METHODS[id]) if id in METHODS else ()


@cache
def source_key(method: Method) -> tuple[str, ...]:
    """Identity of a method's code, as first asked for: for the key of what it makes. Of a plug-in
    all Python files of its package, its version and those of the distributions that it requires; of
    a method here all that its module runs."""
    try:
        file = Path(inspect.getsourcefile(method.run) or "")
    except TypeError:  # no Python function
        file = Path()
    if not file.is_file():
        raise HandbenchError(
            f"method '{method.id}': its code is in no file, so a change could not be noticed; "
            "move it"
        )
    if method.distribution is None:
        ours = _top(method.run.__module__) == code_hash.PACKAGE
        return (code_hash.key_of(method.run.__module__) if ours else content_hash(file),)
    package = sys.modules[_top(method.run.__module__)]
    roots = sorted({file, *map(Path, getattr(package, "__path__", ()))})
    files = [
        path
        for root in roots
        for path in ([root] if root.is_file() else sorted(root.rglob("*.py")))
    ]
    requirements = metadata.requires(method.distribution) or []
    required = sorted(re.split(r"[^\w.-]", line, maxsplit=1)[0] for line in requirements)
    versions = map(with_version, [method.distribution, *required])
    return *versions, content_hash(*(part for path in files for part in (path.name, path)))


def _load() -> None:
    """Import the built-in methods and the plug-ins, once. A plug-in that fails is said in one line
    and left out whole, so that it harms nobody who does not ask for it."""
    if GROUP in _begun:  # also by a plug-in that asks for a method while it is imported
        return
    _begun.add(GROUP)
    points = [
        (f"{point.dist and point.dist.name}", point.name, point)
        for point in metadata.entry_points(group=GROUP)
    ]
    for distribution, name, point in sorted(
        points, key=lambda found: (found[0] != OWN, *found[:2])
    ):
        before = dict(METHODS)
        try:
            point.load()
            if not any(_top(m.run.__module__) == _top(point.module) for m in METHODS.values()):
                raise HandbenchError(f"{point.module} registers no method")
        except (
            Exception,
            SystemExit,
        ) as error:  # whatever a stranger's module does when it is imported
            if distribution == OWN:
                raise
            METHODS.clear()
            METHODS.update(before)
            reason = _reason(error)
            BROKEN[f"{name} of {distribution}"] = " ".join(reason.split())
            say(
                f"plug-in {name} of {distribution}: left out: {BROKEN[f'{name} of {distribution}']}"
            )
        for id in METHODS.keys() - before.keys():
            METHODS[id] = replace(
                METHODS[id], distribution=None if distribution == OWN else distribution
            )


def _reason(error: BaseException) -> str:
    """Why a plug-in could not be loaded. The packages that were installed beside handbench until
    0.2 are inside it."""
    if isinstance(error, ModuleNotFoundError) and error.name and _top(error.name) in MOVED:
        return (
            f"imports {error.name}, which is handbench.{error.name} since version 1.0; change "
            "the import"
        )
    return str(error) if isinstance(error, HandbenchError) else f"{type(error).__name__}: {error}"


def _top(module: str) -> str:
    return module.partition(".")[0]

"""The registry of methods that turn echoes into depth maps: the built-in methods, and those of
installed plug-ins, by id.

A package becomes a plug-in by an entry point of the group "handbench.methods" that names a module
which registers methods. handbench registers its own in the same way.
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
from handbench.support.config import Config, checked_name, parse, suggest
from handbench.support.errors import HandbenchError
from handbench.support.files import content_hash
from handbench.support.progress import say

GROUP = "handbench.methods"
OWN = "handbench"  # the distribution whose methods are the built-in ones
PAPER = (
    "Bräunig et al., An Efficient yet High-Performance Method for Precise Radar-Based "
    "Imaging of Human Hand Poses"
)


@dataclass(frozen=True)
class Reconstruction:
    """The result of a method: a depth map; for methods that image a volume, also a function that
    images the complex volume [nz, ny, nx] it came from, and the volume's depths volume_z_m [nz],
    metres."""

    depth: DepthMap
    volume: Callable[[], np.ndarray] | None = None
    volume_z_m: np.ndarray | None = None


@dataclass(frozen=True)
class Method:
    """A registered method: its id, its configuration class, and its function run(capture, config,
    frame) → Reconstruction.

    summary: one line for listings; title: its name in tables; source: publication or file that
    describes it; base: id of the method that this one is a variant of, whose sensor-specific
    settings apply to it; distribution: the plug-in's package (None: built in).
    """

    id: str
    config: type[Config]
    run: Callable[[RadarCapture, Any, int], Reconstruction]
    summary: str
    source: str
    title: str
    base: str | None = None
    distribution: str | None = None

    def configure(self, values: dict[str, Any], where: str) -> Config:
        """Return the method's configuration made of plain values, by name; the others have their
        defaults. where: origin of the values, named in error messages. Raises HandbenchError for
        unknown names and invalid values."""
        return parse(self.config, values, where)


METHODS: dict[str, Method] = {}
BROKEN: dict[str, str] = {}  # plug-ins that could not be loaded, and why
_begun: set[str] = set()

Run = Callable[[RadarCapture, Any, int], Reconstruction]


def register(
    id: str,
    config: type[Config],
    summary: str,
    source: str = PAPER,
    base: str | None = None,
    title: str = "",
) -> Callable[[Run], Run]:
    """Return a decorator that registers a function run(capture, config, frame) → Reconstruction as
    a method; the arguments become the fields of its `Method`.

    Raises HandbenchError for an id that is taken or is no valid name, for an unknown base, and for
    a configuration that has a parameter without default.
    """

    def add(run: Run) -> Run:
        if id in METHODS:
            raise HandbenchError(
                f"method '{id}': is registered twice, first by "
                f"{METHODS[id].distribution or 'handbench'}; choose another id"
            )
        try:
            checked_name(id)
        except ValueError as error:
            raise HandbenchError(f"method '{id}': {error}") from None
        if base is not None and base not in METHODS:
            raise HandbenchError(
                f"method '{id}': its base '{base}' is unknown; {suggest(base, list(METHODS))}"
            )
        parse(config, {}, f"method '{id}': defaults")
        METHODS[id] = Method(id, config, run, summary, source, title or id, base)
        return run

    return add


def method(id: str) -> Method:
    """Look up a method by its id. Raises HandbenchError for an unknown id, naming the most similar
    one and the plug-ins that could not be loaded."""
    _load()
    if id not in METHODS:
        missing = f"; these plug-ins could not be loaded: {', '.join(BROKEN)}" if BROKEN else ""
        raise HandbenchError(f"method: unknown id '{id}'; {suggest(id, list(METHODS))}{missing}")
    return METHODS[id]


def methods() -> list[Method]:
    """List all methods, the built-in ones first, in the order of their registration."""
    _load()
    return list(METHODS.values())


def titles() -> dict[str, str]:
    """Return the names of all methods in tables: id → title."""
    return {method.id: method.title for method in methods()}


def method_key(id: str) -> tuple[str, ...]:
    """Return hashes and versions that change with the code of the method with this id (see
    `source_key`); an empty tuple for "" and for ids that are not registered."""
    _load()
    return source_key(METHODS[id]) if id in METHODS else ()


def with_version(distribution: str) -> str:
    """Return a distribution's name with its installed version, such as "numpy 2.1.0"; with "none"
    if it is not installed."""
    try:
        return f"{distribution} {metadata.version(distribution)}"
    except metadata.PackageNotFoundError:  # an extra that is not installed
        return f"{distribution} none"


@cache
def source_key(method: Method) -> tuple[str, ...]:
    """Return hashes and versions that change with a method's code, so that results stored under
    them are computed anew after a change.

    For a plug-in these cover all Python files of its package, its version and those of its
    requirements; for a built-in method, all code that its module runs. They are computed once per
    process. Raises HandbenchError for a method whose code is in no file.
    """
    try:
        file = Path(inspect.getsourcefile(method.run) or "")
    except TypeError:  # no Python function
        file = Path()
    if not file.is_file():
        raise HandbenchError(
            f"method '{method.id}': its code is in no file, so handbench cannot notice a change "
            "of it; define it in a Python file"
        )
    if method.distribution is None:
        return () if _top(method.run.__module__) == OWN else (content_hash(file),)
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
    """Import the modules that register methods, those of handbench and those of plug-ins, once per
    process. A plug-in that fails is reported in one line, and none of its methods is registered;
    other methods still work."""
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
                raise HandbenchError(
                    f"the module {point.module} registers no method; call handbench's register in "
                    "it"
                )
        except (Exception, SystemExit) as error:  # an import of foreign code may do anything
            if distribution == OWN:
                raise
            METHODS.clear()
            METHODS.update(before)
            reason = _reason(error)
            BROKEN[f"{name} of {distribution}"] = " ".join(reason.split())
            say(
                f"plug-in {name} of {distribution}: was not loaded and is left out: "
                f"{BROKEN[f'{name} of {distribution}']}"
            )
        for id in METHODS.keys() - before.keys():
            METHODS[id] = replace(
                METHODS[id], distribution=None if distribution == OWN else distribution
            )


def _reason(error: BaseException) -> str:
    """Describe in words why a plug-in could not be loaded."""
    return str(error) if isinstance(error, HandbenchError) else f"{type(error).__name__}: {error}"


def _top(module: str) -> str:
    return module.partition(".")[0]

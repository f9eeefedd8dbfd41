"""Hashes of the code that a module runs (its own and that of all modules that it imports), by which
a stored result is recognised as made by other code.

All imports of a module count, also those in functions and `importlib.import_module("a.b")`,
together with the packages around them. Imports for types only (`if TYPE_CHECKING:`) never run and
do not count. A module that uses its `__file__` reads data files from its folder, which count as
code.
"""

import ast
import gc
import re
import sys
from collections.abc import Iterator
from functools import cache
from importlib import metadata
from pathlib import Path
from typing import NamedTuple

from handbench.support.files import content_hash

ROOT = Path(__file__).parents[1]
PACKAGE = "handbench"
BY_NAME = ("import_module", "__import__")
BLOCKS = ("body", "orelse", "finalbody", "handlers", "cases")  # of statements, in a statement


class _Module(NamedTuple):
    """What one module contributes: the hash of its file, the names of handbench's modules that it
    imports (with the packages around them), and of the other libraries."""

    hash: str
    ours: frozenset[str]
    others: frozenset[str]


class Sources:
    """The source files of handbench's modules, found in the package's folder `root`. Each is read
    once, on first use."""

    def __init__(self, root: Path = ROOT) -> None:
        self.root = root
        self.in_clone = not (
            root / "radar"
        ).is_dir()  # the other rooms and the scripts are next to the package
        self._file = cache(self._find)
        self._modules: dict[str, _Module] = {}

    def imports_of(self, module: str) -> tuple[list[str], list[str]]:
        """Return the names of all handbench modules that run when `module` is imported, itself
        among them, and of the other libraries that these import, Python's own excepted; both
        sorted. Raises ModuleNotFoundError for an unknown module."""
        ours: set[str] = set()
        others: set[str] = set()
        waiting = {module, *self._passed(module)}
        while waiting:
            name = waiting.pop()
            ours.add(name)
            found = self._module(name)
            others |= found.others
            waiting |= found.ours - ours
        return sorted(ours), sorted(others - sys.stdlib_module_names)

    def key(self, module: str) -> str:
        """Return a hash of all code that a module runs: the files of handbench's modules, and the
        versions of the other libraries and of Python."""
        ours, others = self.imports_of(module)
        versions = [installed(name) for name in others]
        return content_hash(
            [[name, self._module(name).hash] for name in ours], versions, sys.version_info[:2]
        )

    def _module(self, name: str) -> _Module:
        if name not in self._modules:
            self._modules[name] = self._read(name)
        return self._modules[name]

    def _read(self, name: str) -> _Module:
        file = self._file(name)
        if file is None:
            raise ModuleNotFoundError(f"{name}: there is no such module in {self.root}")
        source = file.read_bytes()
        names = _imported(source, name if file.name == "__init__.py" else name.rpartition(".")[0])
        ours = frozenset(passed for n in names for passed in self._passed(n))
        others = frozenset(top for n in names if (top := n.partition(".")[0]) != PACKAGE)
        data: list[Path] = []
        if b"__file__" in source:  # but for what comes and goes, Python's and numba's compiled code
            below = (
                p
                for p in file.parent.rglob("*")
                if p.suffix != ".py" and "__pycache__" not in p.parts
            )
            data = sorted(p for p in below if p.is_file())
        named = [part for path in data for part in (path.relative_to(file.parent).as_posix(), path)]
        return _Module(content_hash(file, *named), ours, others)

    def _passed(self, name: str) -> list[str]:
        """Return the modules of handbench that run when a name is imported: of a.b.c those of a,
        a.b and a.b.c that exist."""
        parts = name.split(".") if name.partition(".")[0] == PACKAGE else []
        prefixes = (".".join(parts[:count]) for count in range(1, len(parts) + 1))
        return [prefix for prefix in prefixes if self._file(prefix) is not None]

    def _find(self, name: str) -> Path | None:
        parts = name.split(".")
        folders = [self.root.joinpath(*parts[1:])] if parts[0] == PACKAGE else []
        if self.in_clone:
            folders.append(
                self.root.parent.joinpath(*(parts[1:] if parts[0] == PACKAGE else parts))
            )
        places = (
            place
            for folder in folders
            for place in (folder / "__init__.py", folder.with_suffix(".py"))
        )
        return next((place for place in places if place.is_file()), None)


@cache
def key_of(module: str) -> str:
    """Return a hash of all code that a module of the installed handbench runs, from the files as
    this process first read them."""
    return _INSTALLED.key(module)


_INSTALLED = Sources()


@cache
def _imported(source: bytes, package: str) -> frozenset[str]:
    """Return the full names that a module imports. For `from a import b` these are a and a.b, which
    may be a module. source: the module's text; package: the package that it is in, from which
    relative imports start."""
    collecting = gc.isenabled()
    gc.disable()  # it would go through each tree many times while it grows
    try:
        tree = ast.parse(source)
        return frozenset(
            _names(tree, package, calls=any(name.encode() in source for name in BY_NAME))
        )
    finally:
        if collecting:
            gc.enable()


def _names(tree: ast.Module, package: str, calls: bool) -> Iterator[str]:
    for node in _statements(tree):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            parents = package.split(".")[: 1 - node.level or None] if node.level else []
            base = ".".join([*parents, *filter(None, [node.module])])
            yield from (base, *(f"{base}.{alias.name}" for alias in node.names))
    for node in ast.walk(tree) if calls else ():
        if isinstance(node, ast.Call) and ast.unparse(node.func).endswith(BY_NAME):
            given = [name.value for name in node.args[:1] if isinstance(name, ast.Constant)]
            yield from (name for name in given if isinstance(name, str))


def _statements(node: ast.AST) -> Iterator[ast.AST]:
    """Yield all statements below a node of a syntax tree, at any depth, without those for types
    only."""
    types = isinstance(node, ast.If) and ast.unparse(node.test).endswith("TYPE_CHECKING")
    for block in BLOCKS[types:]:
        for inner in getattr(node, block, ()):
            yield inner
            yield from _statements(inner)


@cache
def installed(library: str) -> tuple[str, ...]:
    """Return the installed distributions that provide an imported library, each with its version,
    as "numpy 2.1.0"; without one, the library's name followed by "none"."""
    brought_by = {one.metadata["Name"] for one in _distributions().get(library, [])}
    return tuple(sorted(map(with_version, brought_by or {library})))


@cache
def _distributions() -> dict[str, list[metadata.Distribution]]:
    """Return the installed distributions by the names that can be imported from them, as
    `metadata.packages_distributions` finds them. This reads the text of their records, which is
    four times as fast as one object for each of 30 000 files."""
    found: dict[str, list[metadata.Distribution]] = {}
    for one in metadata.distributions():
        inferred = re.findall(r"(?m)^([^/,\n]+?)(?:/[^,\n]*)?\.py,", one.read_text("RECORD") or "")
        for name in (one.read_text("top_level.txt") or "").split() or set(inferred):
            found.setdefault(name, []).append(one)
    return found


def with_version(distribution: str) -> str:
    """Return a distribution's name with its installed version, as "numpy 2.1.0", or with "none"."""
    try:
        return f"{distribution} {metadata.version(distribution)}"
    except metadata.PackageNotFoundError:  # an extra that is not installed
        return f"{distribution} none"

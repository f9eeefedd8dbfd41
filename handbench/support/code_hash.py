"""Hashes of the code that a module runs, which is its own and that of all modules that it imports.
By them a stored result is recognised as computed by other code.

All imports of a module count, also those inside functions and `importlib.import_module("a.b")`,
together with the packages that contain them. Imports for type checking only (`if TYPE_CHECKING:`)
never run and do not count. If a module uses its `__file__`, it reads data files from its folder;
these count as code.
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
    """What the hash needs of one module: the hash of its file, and the names that it imports.
    ours: modules of handbench, with the packages that contain them; others: other libraries."""

    hash: str
    ours: frozenset[str]
    others: frozenset[str]


class Sources:
    """The source files of handbench's modules, found in the package folder `root`. Each file is
    read once, at its first use."""

    def __init__(self, root: Path = ROOT) -> None:
        self.root = root
        self.in_clone = not (
            root / "radar"
        ).is_dir()  # the other rooms and the scripts are next to the package
        self._file = cache(self._find)
        self._modules: dict[str, _Module] = {}

    def imports_of(self, module: str) -> tuple[list[str], list[str]]:
        """Return the names of all modules that run when `module` is imported, as two sorted lists.
        The first has handbench's modules, including `module`; the second has the libraries that
        these import, except Python's own. Raises ModuleNotFoundError for an unknown module."""
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
        """Return handbench's modules that run when a name is imported. For a.b.c these are a, a.b
        and a.b.c, as far as they exist."""
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
    """Return a hash of all code that a module of the installed handbench runs. Files count as this
    process first read them."""
    return _INSTALLED.key(module)


_INSTALLED = Sources()


@cache
def _imported(source: bytes, package: str) -> frozenset[str]:
    """Return the full names that a module imports. `from a import b` gives a and a.b, because a.b
    may be a module.
    source: text of the module; package: the package that contains it, from which relative imports
    start."""
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
    """Yield all statements below a node of a syntax tree, at any depth, except those for type
    checking only."""
    types = isinstance(node, ast.If) and ast.unparse(node.test).endswith("TYPE_CHECKING")
    for block in BLOCKS[types:]:
        for inner in getattr(node, block, ()):
            yield inner
            yield from _statements(inner)


@cache
def installed(library: str) -> tuple[str, ...]:
    """Return the installed distributions that provide an imported library, each with its version,
    such as "numpy 2.1.0". If there is none, the name of the library is followed by "none"."""
    brought_by = {one.metadata["Name"] for one in _distributions().get(library, [])}
    return tuple(sorted(map(with_version, brought_by or {library})))


@cache
def _distributions() -> dict[str, list[metadata.Distribution]]:
    """Find the installed distributions by the modules that they provide: name of a module →
    distributions.
    The result is that of `metadata.packages_distributions`. Reading the text of the distributions'
    records is four times as fast, because that function makes an object for each of 30 000
    files."""
    found: dict[str, list[metadata.Distribution]] = {}
    for one in metadata.distributions():
        inferred = re.findall(r"(?m)^([^/,\n]+?)(?:/[^,\n]*)?\.py,", one.read_text("RECORD") or "")
        for name in (one.read_text("top_level.txt") or "").split() or set(inferred):
            found.setdefault(name, []).append(one)
    return found


def with_version(distribution: str) -> str:
    """Return a distribution's name with its installed version, such as "numpy 2.1.0"; with "none"
    if it is not installed."""
    try:
        return f"{distribution} {metadata.version(distribution)}"
    except metadata.PackageNotFoundError:  # an extra that is not installed
        return f"{distribution} none"

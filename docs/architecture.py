"""The figure of docs/architecture.md: python docs/architecture.py OUT.svg (from the repository's root).

Packages and rooms are read from the folders, the arrows between them from the import statements; the graph of stages is
drawn below.
"""

from __future__ import annotations

import ast
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from html import escape
from pathlib import Path

PACKAGES = {  # package → left edge, top and width of its box; and what it holds, in a line
    "reports": (50, 46, 930, "results to tables, figures and pages"),
    "bench": (50, 186, 870, "captures × methods to results; the command line"),
    "calibration": (90, 326, 360, "photo frame to radar frame"),
    "groundtruth": (500, 326, 420, "photographs to a mesh"),
    "radar": (50, 466, 930, "echoes to depth maps, scenes to echoes"),
}
HEIGHT = 92
ROUTES = {  # (package, imported package) → the line between their boxes
    ("reports", "bench"): [(500, 138), (500, 186)],
    ("reports", "radar"): [(950, 138), (950, 466)],
    ("bench", "calibration"): [(280, 278), (280, 326)],
    ("bench", "groundtruth"): [(735, 278), (735, 326)],
    ("bench", "radar"): [(70, 278), (70, 466)],
    ("groundtruth", "calibration"): [(500, 372), (450, 372)],
    ("calibration", "radar"): [(280, 418), (280, 466)],
    ("groundtruth", "radar"): [(735, 418), (735, 466)],
}
DOOR = ("bench", "reports")  # bench/cli alone, when a command asks for it
STAGES = {  # stage → its place in the grid; and what it makes
    "simulate": (0, 0, "capture folder"),
    "sparse": (1, 0, "cameras, points"),
    "dense": (2, 0, "cloud"),
    "mesh": (3, 0, "mesh.ply"),
    "calibrate": (3, 1, "radar_from_photo"),
    "reconstruct": (2, 2, "depth.npz"),
    "repeat": (2, 3, "repeats.npz"),
    "score": (4, 1, "errors"),
    "table": (5, 1, "result.json, csv"),
}
NEEDS = (  # earlier stage → later stage
    ("simulate", "sparse"),
    ("sparse", "dense"),
    ("dense", "mesh"),
    ("dense", "calibrate"),
    ("simulate", "calibrate"),
    ("simulate", "reconstruct"),
    ("simulate", "repeat"),
    ("mesh", "score"),
    ("calibrate", "score"),
    ("reconstruct", "score"),
    ("score", "table"),
    ("repeat", "table"),
)
INK, PALE, LINE = "#1a1a1a", "#eef3f8", "#4a6a8a"


@dataclass(frozen=True)
class Box:
    """A rectangle, and where arrows end at its sides."""

    x: float
    y: float
    width: float
    height: float

    @property
    def middle(self) -> float:
        """The middle along x."""
        return self.x + self.width / 2


def imports(root: Path) -> set[tuple[str, str]]:
    """(package, package that it imports when it runs)."""
    found = set()
    for package in PACKAGES:
        for file in (root / package).rglob("*.py"):
            names = imported(ast.parse(file.read_text("utf-8")))
            tops = {name.split(".")[1] for name in names if name.startswith("handbench.")}
            found |= {(package, top) for top in tops & PACKAGES.keys() - {package}}
    return found


def imported(node: ast.AST) -> Iterator[str]:
    """The names of the modules that are imported below a node, but for types alone."""
    if isinstance(node, ast.Import):
        yield from (alias.name for alias in node.names)
    elif isinstance(node, ast.ImportFrom) and node.module:
        yield node.module
    elif not (isinstance(node, ast.If) and ast.unparse(node.test).endswith("TYPE_CHECKING")):
        for child in ast.iter_child_nodes(node):
            yield from imported(child)


def rooms(root: Path, package: str) -> list[str]:
    """The folders of a package that hold code."""
    return sorted(path.name for path in (root / package).iterdir() if (path / "__init__.py").is_file())


def text(x: float, y: float, words: str, size: int = 13, anchor: str = "middle", bold: bool = False) -> str:
    """Words at a place."""
    weight = ' font-weight="bold"' if bold else ""
    return f'<text x="{x:g}" y="{y:g}" font-size="{size}" text-anchor="{anchor}"{weight}>{escape(words)}</text>'


def rectangle(box: Box, fill: str) -> str:
    """A box with round corners."""
    place = f'x="{box.x:g}" y="{box.y:g}" width="{box.width:g}" height="{box.height:g}"'
    return f'<rect {place} rx="6" fill="{fill}" stroke="{LINE}"/>'


def arrow(points: list[tuple[float, float]]) -> str:
    """A line through points with a head at its end."""
    path = " ".join(f"{'L' if number else 'M'}{x:g},{y:g}" for number, (x, y) in enumerate(points))
    return f'<path d="{path}" fill="none" stroke="{LINE}" stroke-width="1.4" marker-end="url(#head)"/>'


def package_part(root: Path) -> list[str]:
    """The five packages with their rooms, and who imports whom. Raises KeyError for an import without a route."""
    parts = [text(50, 28, "Packages and rooms. An arrow: imports", 16, "start", True)]
    for name, (x, y, width, holds) in PACKAGES.items():
        box = Box(x, y, width, HEIGHT)
        parts += [rectangle(box, PALE), text(x + 12, y + 23, f"{name}/", 16, "start", True)]
        parts.append(text(x + 34 + 10 * len(name), y + 23, holds, 13, "start"))
        parts += room_boxes(box, rooms(root, name))
    parts += [arrow(ROUTES[pair]) for pair in sorted(imports(root) - {DOOR})]
    return parts


def room_boxes(box: Box, names: list[str]) -> list[str]:
    """The rooms of a package, side by side."""
    gap, width = 8, (box.width - 16 - 8 * (len(names) - 1)) / len(names)
    parts = []
    for number, name in enumerate(names):
        room = Box(box.x + 8 + number * (width + gap), box.y + 36, width, 46)
        parts += [rectangle(room, "white"), text(room.middle, room.y + 27, name, 13 if width > 70 else 12)]
    return parts


def stage_part(top: float) -> list[str]:
    """The graph of stages, from left to right."""
    boxes = {name: Box(50 + 160 * x, top + 22 + 74 * y, 130, 52) for name, (x, y, _) in STAGES.items()}
    parts = [text(50, top, "Stages of a run. An arrow: reads the folder of the earlier stage", 16, "start", True)]
    for before, after in NEEDS:
        a, b = boxes[before], boxes[after]
        start, end = (a.x + a.width, a.y + 25), (b.x, b.y + 25)
        turn = a.x + a.width + 15 if before == "simulate" else b.x - 15
        parts.append(arrow([start, end] if start[1] == end[1] else [start, (turn, start[1]), (turn, end[1]), end]))
    for name, box in boxes.items():
        fill = PALE if name != "table" else "white"
        parts += [rectangle(box, fill), text(box.middle, box.y + 23, name, 15, bold=True)]
        parts.append(text(box.middle, box.y + 42, STAGES[name][2], 12))
    return parts


def drawing(root: Path) -> str:
    """The figure as SVG."""
    width, height, top = 1030, 930, 610
    head = (
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width} {height}" '
        f'font-family="Helvetica, Arial, DejaVu Sans, sans-serif" fill="{INK}">'
        '<defs><marker id="head" markerWidth="9" markerHeight="8" refX="8" refY="4" orient="auto">'
        f'<path d="M0,0 L9,4 L0,8 z" fill="{LINE}"/></marker></defs>'
        f'<rect width="{width}" height="{height}" fill="white"/>'
    )
    return "\n".join([head, *package_part(root), *stage_part(top), "</svg>"]) + "\n"


if __name__ == "__main__":
    Path(sys.argv[1]).write_text(drawing(Path(__file__).parents[1]), encoding="utf-8")

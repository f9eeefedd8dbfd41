"""The commands of a page run, and print what the page says: the same words, and numbers within 2 %.

README, tutorial and methods share one folder, and no command runs twice. "…" in a page stands
for any words, and a time may be another one.
"""

from __future__ import annotations

import contextlib
import io
import re
import shlex
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path

import pytest

from handbench.cli.main import main
from handbench.radar.methods.registry import METHODS, method
from handbench.support.progress import ERASE_LINE
from tests.test_docs import DOCS, FENCE, ROOT, blocks, toml_of

TOLERANCE = 0.02
TIMES = ("seconds a frame", "seconds", "time s", "ms", "range", "× reference")
UNITS = ("s", "ms", "min")
NOT_RUN = ("paper_table", "runs/table")  # take minutes; `make table` runs them
NUMBER = r"[-−+]?\d+(?:\.\d+)?(?:e[-+−]?\d+)?"
TOKEN = re.compile(rf"(?<![\w.]){NUMBER}|[^\W\d]\w*|…|\d\w*")


@dataclass
class Session:
    """The folder of all pages. printed: folder and command → its exit code and what it printed."""

    folder: Path
    printed: dict[tuple[Path, str], tuple[int, str]] = field(default_factory=dict)

    def run(self, command: str) -> tuple[int, str]:
        """Run a command, as on a terminal, if it has not run yet."""
        asked = Path.cwd(), command
        if asked not in self.printed:
            output = Terminal()
            with contextlib.redirect_stdout(output), contextlib.redirect_stderr(output):
                code = main(shlex.split(command, comments=True)[1:])
            self.printed[asked] = code, output.getvalue().replace(ERASE_LINE, "")
        return self.printed[asked]


class Terminal(io.StringIO):
    """A stream that says it is a terminal, 80 columns wide and without colours."""

    def isatty(self) -> bool:
        return True


@pytest.fixture(scope="module")
def session(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Session]:
    """The folder of all pages; methods that a page registers are gone afterwards."""
    method("2fsk")  # loads the methods
    known = dict(METHODS)
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("TERM", "dumb")
        patch.setenv("COLUMNS", "80")
        yield Session(tmp_path_factory.mktemp("pages"))
    METHODS.clear()
    METHODS.update(known)


def of_tutorial() -> None:
    """Write the files that the page says to save."""
    first = toml_of("tutorial.md", 'name = "first"')
    Path("hand.toml").write_text(toml_of("tutorial.md", "[target]"), "utf-8")
    Path("first.toml").write_text(first, "utf-8")
    second = first.replace('"first"', '"second"') + toml_of("tutorial.md", "config = {")
    Path("second.toml").write_text(second, "utf-8")
    Path("small.toml").write_text(first + toml_of("tutorial.md", "[tradeoff]"), "utf-8")


def of_methods() -> None:
    """Write the tutorial's files, and register the page's method."""
    of_tutorial()
    exec(compile(blocks(DOCS / "methods.md", "python")[0], "methods.md", "exec"), {})


def of_recipes() -> None:
    """Write the captures of the recipes."""
    for code in blocks(DOCS / "recipes.md", "python"):
        exec(compile(code, "recipes.md", "exec"), {})


BEFORE = {  # page → what it needs first, and commands of another page
    "README.md": (lambda: None, ()),
    "tutorial.md": (of_tutorial, ()),
    "methods.md": (of_methods, ("handbench simulate hand.toml -o capture",)),
    "recipes.md": (of_recipes, ()),
}
prepared: Callable[[str], None] = cache(lambda page: BEFORE[page][0]())


def path(page: str) -> Path:
    """Where a page is."""
    return ROOT / page if page == "README.md" else DOCS / page


def steps(page: Path) -> list[tuple[str, list[str], str]]:
    """The page's blocks of commands: (heading above it, its commands, the output shown below)."""
    found = []
    text = page.read_text("utf-8")
    parts = [(m.start(), m[1], m[2]) for m in FENCE.finditer(text)]
    headings = [(m.start(), m[1]) for m in re.finditer(r"^##+ (.+)$", text, re.MULTILINE)]
    for number, (at, language, code) in enumerate(parts):
        lines = code.replace("\\\n", " ").splitlines()
        commands = [line for line in lines if line.startswith("handbench ")]
        commands = [line for line in commands if not any(word in line for word in NOT_RUN)]
        if language or not commands:
            continue
        heading = ([name for start, name in headings if start < at] or [""])[-1]
        _, kind, output = (*parts, (0, "end", ""))[number + 1]
        shown = kind in ("", "text") and not output.startswith(("handbench ", "make "))
        found.append((heading, commands, output if shown else ""))
    return found


def numbers_of(line: str, times: list[tuple[int, int]]) -> list[tuple[str, bool]]:
    """The words and numbers of a line, and whether each is a time: below the heading of a column of
    times, or with a unit of time behind it."""
    found = list(TOKEN.finditer(line))
    units = [*(m[0] in UNITS for m in found[1:]), False][: len(found)]
    return [
        (m[0].replace("−", "-"), unit or any(m.start() < end and m.end() > at for at, end in times))
        for m, unit in zip(found, units, strict=True)
    ]


def same(ours: list[tuple[str, bool]], theirs: list[str]) -> bool:
    """Tell whether a line of a page matches the words of a printed line."""
    if not ours:
        return not theirs
    (word, time), *others = ours
    if word == "…":
        return any(same(others, theirs[skip:]) for skip in range(len(theirs) + 1))
    return bool(theirs) and fits(word, theirs[0], time) and same(others, theirs[1:])


def fits(word: str, printed: str, time: bool) -> bool:
    """Tell whether a word or number of a page matches a printed one."""
    if not all(re.fullmatch(NUMBER, each) for each in (word, printed)):
        return word == printed
    return time or abs(float(word) - float(printed)) <= TOLERANCE * abs(float(printed)) + 1e-12


def missing(shown: str, printed: str) -> list[str]:
    """The lines of a page's output that were not printed."""
    there = [[word for word, _ in numbers_of(line, [])] for line in printed.splitlines()]
    times: list[tuple[int, int]] = []
    without = []
    for line in shown.splitlines():
        headings = [m.span() for name in TIMES for m in re.finditer(rf"(?<!\S){name}(?!\S)", line)]
        times = headings or times
        ours = numbers_of(line, times)
        if not headings and not any(same(ours, words) for words in there):
            without.append(line)
    return without


@pytest.mark.slow
@pytest.mark.parametrize(
    ("page", "heading"),
    list(dict.fromkeys((name, heading) for name in BEFORE for heading, _, _ in steps(path(name)))),
)
def test_the_commands_of_a_page_print_what_it_says(page, heading, session, monkeypatch):
    """The commands of the sections before run, too, unless they have."""
    folder = session.folder / (page if page == "recipes.md" else "tutorial")
    folder.mkdir(exist_ok=True)
    monkeypatch.chdir(folder)
    prepared(page)
    for command in BEFORE[page][1]:
        assert session.run(command)[0] == 0
    found = steps(path(page))
    last = max(n for n, (where, _, _) in enumerate(found) if where == heading)
    for where, commands, shown in found[: last + 1]:
        ended = [session.run(command) for command in commands]
        printed = "".join(text for _, text in ended)
        if where == heading:
            assert all(code == 0 for code, _ in ended) or "handbench: " in shown, printed
            assert missing(shown, printed) == [], printed


@pytest.mark.parametrize(
    ("shown", "printed"),
    [
        ("MAE 0.984 mm", "│ MAE │ 1.02 │ mm │"),
        ("2-FSK 6.18", "3-FSK 6.18"),
        ("MAE 0.984", "MAE 0.984 mm"),
    ],
)
def test_what_differs_is_seen(shown, printed):
    assert missing(shown, printed) == [shown]


def test_what_may_differ():
    table = "            mm     ms\n 2-FSK    6.18   31.6\n"
    assert missing(table, "| 2-FSK | 6.20 | 99 |") == []
    assert missing("took 3 s, … pixels", "took 900 s, 17 of 20 pixels") == []

"""Progress of a command: counted parts, as one bar or plain lines on stderr."""

import io
import sys
import time

from handbench.support import progress
from handbench.support.progress import Work


class Terminal(io.StringIO):
    """A stderr that says it is a terminal."""

    def isatty(self) -> bool:
        return True


def test_parts_are_counted_and_the_count_never_goes_back():
    """Also where fewer or more parts come than were planned."""
    work, seen = Work(3), list[int]()
    for label, reached in (("a", 0), ("b", 3), ("c", 2), ("d", 0)):
        work.begin(label)
        work.begin("beside")
        assert label in work.line()
        work.end(label)
        work.end("beside")
        work.reach(reached)
        seen.append(work.done)
    assert seen == sorted(seen) and seen[1] == 4 and work.line().startswith("3 of 3")


def test_inner_work_is_a_step_of_the_outer(monkeypatch):
    monkeypatch.setattr(sys, "stderr", io.StringIO())
    seen = []
    with progress.counted(4) as work, work.part("imaging"):
        for _ in progress.track("ab", "planes"):
            seen.append(work.line().partition("now ")[2])
        with progress.counted(7) as inner, inner.part("of a function"):
            assert work.running == ["imaging"]
        assert work.done == 0
    assert seen == [f"imaging, planes {n} of 2" for n in (1, 2)]
    assert progress._current is None


def test_a_terminal_gets_one_bar_and_lines_above_it(monkeypatch):
    monkeypatch.setenv("TERM", "xterm")
    monkeypatch.setenv("COLUMNS", "80")
    monkeypatch.setattr(sys, "stderr", Terminal())
    with progress.counted(4) as work, work.part("simulate-F"):
        progress.say("a warning")
        while "simulate-F" not in sys.stderr.getvalue().partition("a warning\n")[2]:
            time.sleep(0.01)
        drawn = sys.stderr.getvalue()
    warning = f"{progress.ERASE_LINE}a warning\n"
    assert warning in drawn and "0 of 4" in drawn
    assert "\n" not in drawn.replace(warning, "").strip("\n")  # one line, drawn again and again


def test_elsewhere_lines_say_the_same(monkeypatch, capsys):
    monkeypatch.setattr(progress, "PLAIN_INTERVAL_S", 0.01)
    assert list(progress.track([3, 1], "imaging")) == [3, 1]
    for _ in progress.track([3], "hard cases"):
        deadline = time.monotonic() + 60
        while "hard cases" not in (err := capsys.readouterr().err) and time.monotonic() < deadline:
            time.sleep(0.01)
    assert "0 of 1 done, 0 s so far; now hard cases\n" in err
    assert progress.ERASE_LINE not in err

"""Progress of a command: what is done, the time left, and one bar or plain lines on stderr."""

import io
import sys
import time

import pytest

from handbench.support import progress
from handbench.support.progress import Work


class Terminal(io.StringIO):
    """A stderr that says it is a terminal."""

    def isatty(self) -> bool:
        return True


def test_the_time_left_follows_the_measured_rate():
    """100 core seconds, of which two cores are expected to do 2 per second, and do 1."""
    work = Work(100.0, 2.0, start=0.0)
    assert work.line(0.0) == "0 %, 50 s left"
    work.begin("simulate-F", 40.0)
    assert work.line(10.0) == "20 %, 40 s left: simulate-F"
    assert work.line(1000.0) == "38 %, 31 s left: simulate-F"
    work.end("simulate-F", 40.0)
    rate = (40 + 10 * 2) / (40 + progress.TRUSTED_S)
    assert work.left(40.0) == f"{60 / rate:.0f} s left"


def test_what_an_earlier_run_has_done_is_no_part_of_the_work():
    work = Work(100.0, 1.0, start=0.0)
    work.begin("simulate-F", 60.0)
    work.end("simulate-F", 1.0, skipped=True)
    work.begin("dense-F", 40.0)
    work.begin("dense-U", 0.0)
    assert (work.total, work.done) == (40.0, 0.0)
    assert work.line(10.0) == "25 %, 30 s left: dense-F and 1 more"


def test_inner_work_is_a_step_of_the_outer(monkeypatch):
    monkeypatch.setattr(sys, "stderr", io.StringIO())
    seen = []
    with progress.work(4.0), progress.part("imaging", 3.0):
        for _ in progress.track("ab", "planes"):
            progress.begin("of a function", 5.0)
            seen.append((progress._current.label(), *progress._current.running))
            progress.end("of a function")
        assert progress._current.done == 0
    assert seen == [("imaging, of a function", "imaging")] * 2
    assert progress._current is None


def test_a_terminal_gets_one_bar_and_lines_above_it(monkeypatch):
    monkeypatch.setenv("TERM", "xterm")
    monkeypatch.setenv("COLUMNS", "80")
    monkeypatch.setattr(sys, "stderr", Terminal())
    with progress.work(4.0, 1.0), progress.part("simulate-F", 3.0):
        progress.say("a warning")
        while "simulate-F" not in sys.stderr.getvalue().partition("a warning\n")[2]:
            time.sleep(0.01)
        drawn = sys.stderr.getvalue()
    said = f"{progress.ERASE_LINE}a warning\n"
    assert said in drawn and " % " in drawn and " left " in drawn
    assert "\n" not in drawn.replace(said, "").strip("\n")  # one line, drawn again and again


def test_elsewhere_lines_say_the_same(monkeypatch, capsys):
    monkeypatch.setattr(progress, "PLAIN_INTERVAL_S", 0.01)
    assert list(progress.track([3, 1], "imaging")) == [3, 1]
    for _ in progress.track([3], "hard cases"):
        deadline = time.monotonic() + 60
        while "hard cases" not in (err := capsys.readouterr().err) and time.monotonic() < deadline:
            time.sleep(0.01)
    assert "0 %: hard cases 1 of 1\n" in err
    assert progress.ERASE_LINE not in err


@pytest.mark.parametrize(("seconds", "words"), [(99, "99 s"), (100, "2 min"), (7200, "2 h")])
def test_a_duration_in_words(seconds, words):
    assert progress.duration(seconds) == words

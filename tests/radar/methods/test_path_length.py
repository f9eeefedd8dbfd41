"""A 3-FSK map passes few files, so that a reader can follow it from the method to the compiled
loops."""

import sys
from pathlib import Path
from types import CodeType

from numba.core.registry import CPUDispatcher

from handbench.radar.imaging.plan import fresh_plans
from handbench.radar.methods.registry import method
from tests.installed_copy import ROOMS
from tests.radar.simulated_points import around, bumpy, points_capture, surface_points

ROOT = Path(__file__).parents[3]
PACKAGES = (*ROOMS, "handbench")
MOST = 20


def files_passed(call) -> set[str]:
    """The files of our packages whose functions run in call(). Compiled functions leave no trace:
    those count that a function names that ran, and those that they name."""
    files: set[str] = set()

    def count(code: CodeType, names: dict) -> None:
        file = Path(code.co_filename)
        if not file.is_relative_to(ROOT) or file.relative_to(ROOT).parts[0] not in PACKAGES:
            return
        files.add(str(file.relative_to(ROOT)))
        for found in map(names.get, code.co_names):
            if isinstance(found, CPUDispatcher):
                count(found.py_func.__code__, found.py_func.__globals__)

    def note(frame, event, _) -> None:
        if event == "call" and frame.f_code.co_name != "<module>":
            count(frame.f_code, frame.f_globals)

    sys.setprofile(note)
    try:
        call()
    finally:
        sys.setprofile(None)
    return files


def test_a_3fsk_map_passes_twenty_files_at_most(monkeypatch):
    monkeypatch.setenv("HANDBENCH_WORKERS", "1")  # all of it in this thread
    fsk = method("3fsk")
    capture = points_capture(surface_points(bumpy, half_m=0.01, pitch_m=0.001))
    config = fsk.configure(around((0.0, 0.0)), "test")
    with fresh_plans():
        passed = files_passed(lambda: fsk.run(capture, config, 0))
    assert "radar/methods/fsk.py" in passed and "radar/imaging/cpu/forward.py" in passed
    assert len(passed) <= MOST, sorted(passed)

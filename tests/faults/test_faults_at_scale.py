"""A handful of each kind of fault (`make faults` tries many): what follows is the same result, or
one sentence.

Kinds that need processes of their own are marked `faults` and left to `pytest -m faults`: what they
leave behind for a while would disturb other tests.
"""

from __future__ import annotations

import pytest

from handbench.cli import doctor
from handbench.cli.main import main
from tests.faults.campaign import KINDS, Ground

SLOW = {
    "signal kill -9",
    "signal SIGTERM",
    "signal SIGINT",
    "at once",
    "cluster",
    "memory",
    "unwritable",
    "outputs",
}


@pytest.fixture(scope="module")
def ground(tmp_path_factory: pytest.TempPathFactory) -> Ground:
    """Few tries."""
    return Ground(tmp_path_factory.mktemp("faults"), tries=1, every=False)


@pytest.mark.filterwarnings(
    "ignore::pytest.PytestUnraisableExceptionWarning"
)  # files that vanish while they are open
@pytest.mark.parametrize(
    "kind", [pytest.param(k, marks=pytest.mark.faults if k in SLOW else ()) for k in KINDS]
)
def test_no_fault_loses_anything(ground: Ground, kind: str) -> None:
    found = list(KINDS[kind](ground))
    assert found and [each for each in found if each.loss] == []


@pytest.mark.parametrize(
    ("error", "words"),
    [
        (MemoryError("Unable to allocate 3.2 GiB"), "out of memory (Unable to allocate 3.2 GiB)"),
        (
            FileNotFoundError(2, "No such file or directory", "x/a.ply"),
            "x/a.ply: No such file or directory",
        ),
        (OSError(27, "File too large"), "File too large"),
    ],
)
def test_what_the_system_refuses_is_one_sentence(
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    error: Exception,
    words: str,
) -> None:
    def refuse(_: object) -> None:
        raise error

    monkeypatch.setattr(doctor, "run", refuse)
    assert main(["doctor"]) == 2
    assert words in capsys.readouterr().err


def test_a_file_that_is_none_of_the_system_s_keeps_its_traceback(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def broken(_: object) -> None:
        raise FileNotFoundError("a bug")

    monkeypatch.setattr(doctor, "run", broken)
    with pytest.raises(FileNotFoundError, match="a bug"):
        main(["doctor"])

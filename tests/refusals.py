"""What is refused. Tests assert the places that a message names, not its words; people read those:
`make messages` writes the messages of all tests, one a line, to runs/messages.txt."""

import os
import re
from collections.abc import Callable
from contextlib import redirect_stderr
from io import StringIO

import pytest

from handbench.cli.main import main
from handbench.support.errors import HandbenchError


def refuse(call: Callable[[], object], *places: str) -> None:
    """Assert that a call ends in a HandbenchError of one line that names every place: a file, a
    key, an argument or a value."""
    with pytest.raises(HandbenchError) as refusal:
        call()
    _check(str(refusal.value), places)


def refuse_command(arguments: list[str], *places: str) -> None:
    """Assert that a command ends with exit code 2 after one line that names every place."""
    with redirect_stderr(StringIO()) as printed:
        assert main(arguments) == 2
    _check(printed.getvalue().strip().rpartition("\n")[2], places)


def _check(message: str, places: tuple[str, ...]) -> None:
    assert "\n" not in message
    assert [place for place in places if place not in message] == []
    # words of parsers, which say nothing to those who have the file
    assert not re.search("could not convert|to increase the limit|Error -|synchronously", message)
    if record := os.environ.get("HANDBENCH_MESSAGES"):
        with open(record, "a") as file:
            file.write(message + "\n")

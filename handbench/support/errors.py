"""The exception for known errors, which the user can mend."""

from collections.abc import Sequence


class HandbenchError(Exception):
    """A known error, which the user can mend.
    Its message is one line that names the file or argument, what was found, what was expected and
    what to do. The command line prints it and exits with code 2; any other exception keeps its
    traceback.

    problems: the same, with a line for each problem; the message may name only the first ones."""

    def __init__(self, message: str, problems: Sequence[str] = ()) -> None:
        super().__init__(_one_line(message))
        self.problems = tuple(map(_one_line, problems or (message,)))


def _one_line(text: str) -> str:
    """Return a text without line breaks and terminal codes, which names and libraries' texts that a
    message quotes may have."""
    return "".join(c if c.isprintable() else "?" for c in " ".join(text.split()))

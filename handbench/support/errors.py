"""The exception for known errors, which the user can mend."""

from collections.abc import Sequence


class HandbenchError(Exception):
    """A known error, which the user can mend.
    Its message is one line that names the file or argument, what was found, what was expected and
    what to do. The command line prints it and exits with code 2; any other exception keeps its
    traceback.

    problems: the same, with a line for each problem; the message may name only the first ones."""

    def __init__(self, message: str, problems: Sequence[str] = ()) -> None:
        super().__init__(printable(message))
        self.problems = tuple(map(printable, problems or (message,)))


def printable(text: str) -> str:
    r"""Return a text on one line, with characters that cannot be printed written as in \x1b.
    Names and texts from files may have such characters, which a terminal would obey."""
    return "".join(c if c.isprintable() else c.encode("unicode_escape").decode() for c in text)

"""The exception for known errors, which the user can mend."""

import re
from collections.abc import Sequence

# what parsers say → what it means for the one who has the file
PLAIN = (
    (
        r"could not convert string to float: b?('.*?')",
        r"\1 is no number; write it with a point, and no unit",
    ),
    (r"Exceeds the limit \(.* to increase the limit", "a whole number has too many digits"),
    (r"Error -\d while decompressing data: [a-z ]+", "its compressed data are damaged"),
    (r"Can't synchronously read data \([^()]*\)", "its data are damaged"),
    (r"Unable to synchronously open file \(file signature not found\)", "it is no HDF5 file"),
)


class HandbenchError(Exception):
    """A known error, which the user can mend.
    Its message is one line that names the file or argument, what was found, what was expected and
    what to do. The command line prints it and exits with code 2; any other exception keeps its
    traceback.

    problems: the same, with a line for each problem; the message may name only the first ones.
    Sentences of parsers in them become plain ones (PLAIN). code: of the command's exit."""

    code = 2

    def __init__(self, message: str, problems: Sequence[str] = ()) -> None:
        super().__init__(_plain(message))
        self.problems = tuple(map(_plain, problems or (message,)))


def _plain(text: str) -> str:
    for said, meant in PLAIN:
        text = re.sub(said, meant, text)
    return printable(text)


def printable(text: str) -> str:
    r"""Return a text on one line, with characters that cannot be printed written as in \x1b.
    Names and texts from files may have such characters, which a terminal would obey."""
    return "".join(c if c.isprintable() else c.encode("unicode_escape").decode() for c in text)

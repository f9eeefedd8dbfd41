"""The exception for known errors, which the user can mend."""


class HandbenchError(Exception):
    """A known error, which the user can mend.
    Its message is one line that names the file or argument, what was found, what was expected and
    what to do. The command line prints it and exits with code 2; any other exception keeps its
    traceback."""

    def __init__(self, message: str) -> None:
        # Messages quote names and libraries' texts, which may hold line breaks or terminal codes.
        super().__init__("".join(c if c.isprintable() else "?" for c in " ".join(message.split())))

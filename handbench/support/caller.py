"""Names of options and settings for messages, in the form that the user types: on the command line,
in a benchmark file, or in Python."""

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from typing import Any, Literal

Caller = Literal["command line", "benchmark", "Python"]
_caller: Caller = "Python"


@contextmanager
def called_from(caller: Caller) -> Iterator[None]:
    """Context manager in which messages write options in the form of `caller`; the default is
    Python."""
    global _caller
    before, _caller = _caller, caller
    try:
        yield
    finally:
        _caller = before


def option(on_command_line: str, elsewhere: str | None = None) -> str:
    """Return the name of an option for a message, in the form of the current caller.
    on_command_line: its name there, such as "--overwrite". elsewhere: its name in Python and in
    benchmark files; None: the same without dashes and with "_" for "-"."""
    if _caller == "command line":
        return on_command_line
    return elsewhere or on_command_line.lstrip("-").replace("-", "_")


def settings(values: Mapping[str, Any]) -> str:
    """Return a method's settings (name → value) as text for a message, in the form of the current
    caller: --set f1_hz=82e9, config = { f1_hz = 82e9 }, or f1_hz=82e9.
    A value in a table has a name with a dot, such as "z.start_m". A value that is text is written
    unchanged."""
    if _caller == "command line":
        texts = {name: _text(value) for name, value in values.items()}
        return " ".join(
            f"--set {name}='{text}'" if "[" in text else f"--set {name}={text}"
            for name, text in texts.items()
        )
    if _caller == "benchmark":
        inside = ", ".join(f"{name} = {_text(value)}" for name, value in values.items())
        return f"config = {{ {inside} }}"
    tables: dict[str, list[str]] = {}
    for name, value in values.items():
        table, _, key = name.rpartition(".")
        text = f'"{key}": {_text(value)}' if table else _text(value)
        tables.setdefault(table or key, []).append(text)
    return ", ".join(
        f"{name}={{{', '.join(texts)}}}" if ":" in texts[0] else f"{name}={texts[0]}"
        for name, texts in tables.items()
    )


def _text(value: Any) -> str:
    """Format a value for a message; a float from 1e6 on is written in units of 1e9, such as
    82e9."""
    if isinstance(value, tuple):
        return f"[{','.join(map(_text, value))}]"
    if isinstance(value, float) and abs(value) >= 1e6:
        return f"{value / 1e9:.10g}e9"
    return f"{value:.10g}" if isinstance(value, float) else str(value)

"""Options and settings in messages, written as the caller types them: on the command line, in a
benchmark file, or in Python."""

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from typing import Any, Literal

Caller = Literal["command line", "benchmark", "Python"]
_caller: Caller = "Python"


@contextmanager
def called_from(caller: Caller) -> Iterator[None]:
    """Context in which messages write options as `caller` types them; by default as Python."""
    global _caller
    before, _caller = _caller, caller
    try:
        yield
    finally:
        _caller = before


def option(on_command_line: str, elsewhere: str | None = None) -> str:
    """Name an option, as "--overwrite". elsewhere: its name in Python and in benchmark files; by
    default the same without dashes."""
    if _caller == "command line":
        return on_command_line
    return elsewhere or on_command_line.lstrip("-").replace("-", "_")


def settings(values: Mapping[str, Any]) -> str:
    """Write a method's settings, name → value: --set f1_hz=82e9, config = { f1_hz = 82e9 }, or
    f1_hz=82e9. A value in a table has a name with a dot, "z.start_m"; a text is written as it
    is."""
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
    """Format a value; a float in units of 1e9, or as it is if it is small."""
    if isinstance(value, tuple):
        return f"[{','.join(map(_text, value))}]"
    if isinstance(value, float) and abs(value) >= 1e6:
        return f"{value / 1e9:.10g}e9"
    return f"{value:.10g}" if isinstance(value, float) else str(value)

"""Line numbers of the keys of a TOML or JSON file, which their parsers do not tell."""

import re

Location = tuple[str | int, ...]
TOKEN = re.compile(
    r'''"""(?:\\.|[^\\])*?"{3,5}|\'\'\'.*?\'{3,5}'''  # strings of several lines
    r"""|"(?:\\.|[^"\\\n])*"|'[^'\n]*'|\#[^\n]*"""  # strings, comments
    r"""|[\[\]{}=:,.\n]|[^\s\[\]{}=:,."'\#]+""",  # punctuation, words
    re.DOTALL,
)


def lines_of(text: str, toml: bool = True) -> dict[Location, int]:
    """The line, counted from 1, of every key and of every item of a list, by its place as ("method", 1, "config").
    `text` is known to be good TOML (else JSON); nothing is said of what is not understood."""
    try:
        return _Scanner(text).toml() if toml else _Scanner(text).json()
    except (IndexError, RecursionError):
        return {}


def line_of(lines: dict[Location, int], location: Location) -> int | None:
    """The line of a place, or of the nearest one around it that has one."""
    return next((lines[location[:n]] for n in range(len(location), -1, -1) if location[:n] in lines), None)


class _Scanner:
    def __init__(self, text: str) -> None:
        self.tokens: list[tuple[str, int]] = []
        self.at = 0
        self.lines: dict[Location, int] = {}
        line, end = 1, 0
        for match in TOKEN.finditer(text):
            line += text.count("\n", end, match.start())
            end = match.start()
            if not match.group().startswith("#"):
                self.tokens.append((match.group(), line))
        self.tokens.append(("\n", line))

    def json(self) -> dict[Location, int]:
        self._value(())
        return self.lines

    def toml(self) -> dict[Location, int]:
        table: Location = ()
        counts: dict[Location, int] = {}  # of [[tables]]
        while self._skip_newlines():
            line = self.tokens[self.at][1]
            if self._token() != "[":
                self._pair(table)
                continue
            several = self.tokens[self.at + 1][0] == "["
            self.at += 2 if several else 1
            table = ()
            keys = self._key("]")
            for key in keys[:-1]:
                table = (*table, key)
                table += (counts[table] - 1,) if table in counts else ()
            table = (*table, keys[-1])
            if several:
                self.lines.setdefault(table, line)
                counts[table] = counts.get(table, 0) + 1
                table = (*table, counts[table] - 1)
            self.lines.setdefault(table, line)
            self.at += 2 if several else 1
        return self.lines

    def _pair(self, table: Location) -> None:
        line = self.tokens[self.at][1]
        place = table
        for key in self._key("=", ":"):
            place = (*place, key)
            self.lines.setdefault(place, line)
        self.at += 1
        self._value(place)

    def _key(self, *ends: str) -> list[str]:
        parts = []
        while self._token() not in ends:
            token = self._token()
            if token != ".":
                parts.append(token[1:-1] if token[0] in "\"'" else token)
            self.at += 1
        return parts

    def _value(self, place: Location) -> None:
        opened = self._token()
        if opened not in ("[", "{"):
            while self._token() not in (",", "]", "}", "\n"):
                self.at += 1
            return
        self.at += 1
        index = 0
        while self._skip_newlines() and self._token() not in ("]", "}"):
            if self._token() == ",":
                self.at += 1
            elif opened == "{":
                self._pair(place)
            else:
                self.lines[(*place, index)] = self.tokens[self.at][1]
                self._value((*place, index))
                index += 1
        self.at += 1

    def _token(self) -> str:
        return self.tokens[self.at][0]

    def _skip_newlines(self) -> bool:
        """Go on to the next token that is no line's end; False at the end of the file."""
        while self.at < len(self.tokens) and self._token() == "\n":
            self.at += 1
        return self.at < len(self.tokens)

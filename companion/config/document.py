"""YAML text -> plain values, without what YAML does behind one's back.

A key that stands twice, numbers that YAML reads as octal or base 60, dates, tags, anchors and aliases are refused, each
with its line: of two readings a person may have had, one would fly the vehicle. Works on the parser's events, so that
nothing recurses and no value is built before it has been looked at.
"""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from typing import Any, Final

import yaml

from companion.errors import ConfigError

_DEEPEST: Final = 20
_MOST_DIGITS: Final = 15
_MOST_SHOWN: Final = 20
_WORDS: Final[dict[str, bool | None]] = {
    **dict.fromkeys(("true", "yes", "on"), True),
    **dict.fromkeys(("false", "no", "off"), False),
    **dict.fromkeys(("", "~", "null"), None),
}
_DECIMAL: Final = re.compile(r"[-+]?((0|[1-9]\d*)(\.\d*)?|\.\d+)([eE][-+]?\d+)?")
_NOT_FINITE: Final = re.compile(r"[-+]?\.(inf|nan)", re.IGNORECASE)
_MAC: Final = re.compile(r"\d\d(:\d\d){5}")
_REFUSED: Final = (
    (re.compile(r"[-+]?0\d+(\.\d*)?"), "a number with a leading 0 is octal in YAML; write {plain}, or quote it"),
    (re.compile(r"[-+]?[1-9]\d*(:[0-5]?\d)+(\.\d*)?"),
     "with colons a number to the base of 60 in YAML; write the plain one, or quote it"),
    (re.compile(r"[-+]?\d[\d_]*_[\d_.]*"), "underscores in a number; write {plain}, or quote it"),
    (re.compile(r"[-+]?0[xob][0-9a-fA-F_]+"), "not a decimal number; write it as one, or quote it"),
    (re.compile(r"\d{4}-\d\d?-\d\d?([Tt ].*)?"), "a date in YAML; quote it"),
)  # fmt: skip
"""What of plain scalars means something else to YAML than it says."""
_ODD: Final = re.compile("[\x00-\x08\x0b\x0c\x0e-\x1f\x7f-\x9f\u2028\u2029\ufffe\uffff\ud800-\udfff]")
_UNSEEN: Final = re.compile("[\u00a0\u00ad\u200b-\u200f\u202a-\u202e\u2060-\u2064\ufeff]")
"""Nobody sees them: a key or a path with one is another than it looks. A comment may have them."""
_LINE_END: Final = re.compile("\r\n|\r|\n")


def read_document(text: str, where: str) -> Any:
    """The values of one YAML document: dicts with keys of text, lists, text, bool, int, float, None.

    Raises ConfigError with a line of `where` and the line in it for everything that is wrong.
    """
    builder = _Builder()
    odd = _ODD.search(text)
    if odd is not None:
        line = len(_LINE_END.findall(text, 0, odd.start())) + 1
        raise ConfigError(f"{where}: line {line}: character U+{ord(odd[0]):04X}, {_told(odd[0])}; take it out")
    try:
        for event in yaml.parse(text, Loader=yaml.SafeLoader):
            builder.take(event)
    except _TooDeep as error:
        builder.problems.append(str(error))
    except yaml.MarkedYAMLError as error:
        builder.problems.append(f"{_at(error.problem_mark)}not valid YAML: {error.problem}")
    except yaml.YAMLError as error:
        raise ConfigError(f"{where}: not valid YAML: {' '.join(str(error).split())}") from None
    if len(builder.problems) == 1:
        raise ConfigError(f"{where}: {builder.problems[0]}")
    if builder.problems:
        shown = builder.problems[:_MOST_SHOWN] + ["..."] * (len(builder.problems) > _MOST_SHOWN)
        lines = "\n".join(f"  {problem}" for problem in shown)
        raise ConfigError(f"{where}: {len(builder.problems)} errors\n{lines}")
    return builder.document


class _TooDeep(Exception):
    """Deeper than any configuration."""


@dataclass(slots=True)
class _Level:
    """A mapping or list that has not ended."""

    values: dict[str, Any] | list[Any]
    name: str | None
    """Key or place that it stands at."""
    key: str | None = None
    lines: dict[str, int] = field(default_factory=dict)
    """Of each key, where it stood first."""
    is_left_out: bool = False
    """The value that follows is of a key that was refused."""


class _Builder:
    """Takes the events of one document in their order."""

    def __init__(self) -> None:
        self.document: Any = None
        self.problems: list[str] = []
        self._levels: list[_Level] = []
        self._documents = 0

    def take(self, event: Any) -> None:
        if isinstance(event, yaml.DocumentStartEvent):
            self._documents += 1
            if self._documents > 1:
                self._refuse(event, "a second document begins; expected one")
        if isinstance(event, yaml.AliasEvent):
            self._refuse(event, f"*{event.anchor}: aliases are not read here; write the value again")
            self._add(None, event)
        elif isinstance(event, yaml.CollectionStartEvent):
            self._check(event)
            self._begin({} if isinstance(event, yaml.MappingStartEvent) else [], event)
        elif isinstance(event, yaml.CollectionEndEvent):
            self._levels.pop()
        elif isinstance(event, yaml.ScalarEvent):
            self._check(event)
            unseen = _UNSEEN.search(event.value)
            if unseen is not None:
                self._refuse(
                    event, f"character U+{ord(unseen[0]):04X}, which looks like a space or nothing; take it out"
                )
            is_key = bool(self._levels) and self._is_at_key(self._levels[-1])
            self._add(event.value if is_key else self._value(event), event)

    def _begin(self, values: dict[str, Any] | list[Any], event: Any) -> None:
        if len(self._levels) >= _DEEPEST:
            raise _TooDeep(f"{_at(event.start_mark)}nested more than {_DEEPEST} deep, which no configuration is")
        name = self._levels[-1].key if self._levels else None
        self._add(values, event)
        self._levels.append(_Level(values, name))

    def _add(self, value: Any, event: Any) -> None:
        """As the next value of the mapping or list that is open, or as its next key."""
        if not self._levels:
            self.document = value if self._documents < 2 else self.document
            return
        level = self._levels[-1]
        if isinstance(level.values, list):
            level.values.append(value)
        elif self._is_at_key(level):
            self._add_key(level, value, event)
        else:
            if level.key is not None:
                level.values[level.key] = value
            level.key, level.is_left_out = None, False

    def _add_key(self, level: _Level, key: Any, event: Any) -> None:
        line = event.start_mark.line + 1
        level.is_left_out = True
        if not isinstance(key, str):
            self._refuse(event, "expected a word as the key")
        elif key in level.lines:
            self._refuse(event, f"{key} is there twice, first in line {level.lines[key]}; keep one of them")
        else:
            level.lines[key] = line
            level.key, level.is_left_out = key, False

    @staticmethod
    def _is_at_key(level: _Level) -> bool:
        return isinstance(level.values, dict) and level.key is None and not level.is_left_out

    def _check(self, event: Any) -> None:
        if event.anchor is not None:
            self._refuse(event, f"&{event.anchor}: anchors are not read here; write each value where it belongs")
        if event.tag is not None and event.tag != "!":
            name = event.tag.replace("tag:yaml.org,2002:", "!!")
            self._refuse(event, f"{name}: tags are not read here; write the value alone")

    def _value(self, event: Any) -> Any:
        text = event.value
        if event.style is not None:  # quoted
            return text
        if text.lower() in _WORDS:
            return _WORDS[text.lower()]
        if _MAC.fullmatch(text):
            return text
        if _DECIMAL.fullmatch(text):
            return self._number(text, event)
        if _NOT_FINITE.fullmatch(text):
            return float(text.replace(".", "", 1))
        for pattern, why in _REFUSED:
            if pattern.fullmatch(text):
                self._refuse(event, f"{_short(text)}: {why.format(plain=_plain(text))}")
                return None
        return text

    def _number(self, text: str, event: Any) -> int | float | None:
        if text.lstrip("+-").isdecimal():
            if len(text.lstrip("+-")) > _MOST_DIGITS:
                self._refuse(event, f"{_short(text)}: a number of {len(text)} digits; expected {_MOST_DIGITS} at most")
                return None
            return int(text)
        return float(text)

    def _refuse(self, event: Any, what: str) -> None:
        keys = [level.name for level in self._levels] + [level.key for level in self._levels[-1:]]
        path = ".".join(key for key in keys if key is not None)
        self.problems.append(f"{_at(event.start_mark)}{path and f'{path}: '}{what}")


def _at(mark: Any) -> str:
    return "" if mark is None else f"line {mark.line + 1}: "


def _told(character: str) -> str:
    """Where an editor shows no line's end, YAML's next line is none to a person: a comment would hide a key."""
    if character in "\x85\u2028\u2029":
        return "at which YAML begins a new line and an editor does not"
    return "which no text holds (is this UTF-16?)" if character == "\0" else "which cannot be printed"


def _plain(text: str) -> str:
    """The number that was meant, most likely."""
    bare = text.replace("_", "").lstrip("+-").lstrip("0")
    return ("-" if text[0] == "-" else "") + (bare if bare[:1].isdigit() else "0" + bare)


def _short(text: str) -> str:
    return text if len(text) <= 30 else f"{text[:30]}..."

"""YAML file -> `Config`: unknown keys are fatal, all errors are reported together, each with the path of its key."""

from __future__ import annotations

import dataclasses
import difflib
import functools
import math
import types
import typing
from pathlib import Path
from typing import Any, Final

import msgspec
import yaml

from companion.config.document import read_document
from companion.config.rules import config_errors
from companion.config.schema import CHECK, Config
from companion.errors import ConfigError
from csi_bridge.regular_file import open_regular

_LARGEST_BYTES: Final = 256 << 10
_MOST_SHOWN: Final = 20


def load_config(path: Path) -> Config:
    """Raises ConfigError with one line for each error found."""
    document = read_document(text_of(path), str(path))
    if not isinstance(document, dict):
        raise ConfigError(f"{path}: expected a mapping of keys at the top, got {_kind(document)}")
    return config_of(document, str(path))


def text_of(path: Path) -> str:
    """Raises ConfigError; reads no more than a configuration can hold, whatever the name stands for."""
    try:
        with open_regular(path) as file:
            data = file.read(_LARGEST_BYTES + 1)
    except FileNotFoundError:
        raise ConfigError(
            f"{path}: no such configuration file; --config names another, `companion config example uav` prints one"
        ) from None
    except (OSError, ValueError) as error:  # a name with a zero byte
        raise ConfigError(f"{path}: cannot be read: {getattr(error, 'strerror', None) or error}") from None
    if len(data) > _LARGEST_BYTES:
        raise ConfigError(f"{path}: larger than {_LARGEST_BYTES >> 10} KB; expected a configuration")
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        line = data[: error.start].count(b"\n") + 1
        raise ConfigError(f"{path}: line {line}: not UTF-8 (byte 0x{data[error.start]:02x})") from None


def save_config(config: Config, path: Path) -> None:
    """Writes what `load_config` reads back."""
    path.write_text(yaml.safe_dump(msgspec.to_builtins(config), sort_keys=False))


def config_of(document: dict[str, Any], where: str) -> Config:
    """The configuration that a mapping of keys means. Raises ConfigError that begins with `where`."""
    errors: list[str] = []
    config = _build(Config, document, "", errors)
    if config is not None and not errors:
        errors = config_errors(config)
    if errors or config is None:
        count = "1 error" if len(errors) == 1 else f"{len(errors)} errors"
        shown = errors[:_MOST_SHOWN] + ["..."] * (len(errors) > _MOST_SHOWN)
        raise ConfigError(f"{where}: {count}\n" + "\n".join(f"  {line}" for line in shown))
    assert isinstance(config, Config)
    return config


def _build(cls: type, data: Any, path: str, errors: list[str]) -> Any:
    """An instance of the dataclass `cls`, or None with the reasons appended to `errors`."""
    if not isinstance(data, dict):
        errors.append(f"{path}: expected a mapping of keys, got {_kind(data)}")
        return None
    fields, hints = _fields(cls)
    before = len(errors)
    errors += [
        f"{_join(path, str(key))}: unknown key{_suggestion(str(key), fields)}" for key in data if key not in fields
    ]
    values = {}
    for name, spec in fields.items():
        if name in data:
            values[name] = _convert(hints[name], data[name], _join(path, name), errors)
        elif spec.default is dataclasses.MISSING and spec.default_factory is dataclasses.MISSING:
            errors.append(f"{_join(path, name)}: missing; expected {_describe(hints[name])}")
    return cls(**values) if len(errors) == before else None


@functools.cache
def _fields(cls: type) -> tuple[dict[str, dataclasses.Field[Any]], dict[str, Any]]:
    """The fields of a dataclass by name, and their types. Annotations are text, which is compiled here each time."""
    return {field.name: field for field in dataclasses.fields(cls)}, typing.get_type_hints(cls, include_extras=True)


def _convert(hint: Any, value: Any, path: str, errors: list[str]) -> Any:
    if typing.get_origin(hint) in (types.UnionType, typing.Union):  # `X | None`: null is as good as absent
        if value is None:
            return None
        (hint,) = (arg for arg in typing.get_args(hint) if arg is not type(None))
    if dataclasses.is_dataclass(hint):
        return _build(typing.cast(type, hint), value, path, errors)
    arguments = typing.get_args(hint)
    if typing.get_origin(hint) is list and dataclasses.is_dataclass(arguments[0]):
        if not isinstance(value, list):
            errors.append(f"{path}: expected a list, got {_kind(value)}")
            return None
        return [_build(typing.cast(type, arguments[0]), item, f"{path}[{i}]", errors) for i, item in enumerate(value)]
    if not _is_finite(value):
        errors.append(f"{path}: expected a finite number (got {_shown(value)})")
        return None
    try:
        converted = msgspec.convert(value, hint)
        for extra in (one.extra for one in arguments if isinstance(one, msgspec.Meta)):
            if extra is not None:
                extra[CHECK](converted)
    except msgspec.ValidationError as error:
        errors.append(f"{path}: {_expected(hint) or str(error).replace('`', '')} (got {_shown(value)})")
        return None
    except ValueError as error:
        errors.append(f"{path}: {error}")
        return None
    return converted


def _is_finite(value: Any) -> bool:
    if isinstance(value, list):
        return all(map(_is_finite, value))
    return not isinstance(value, float) or math.isfinite(value)


def _join(path: str, name: str) -> str:
    return f"{path}.{name}" if path else name


def _suggestion(key: str, fields: dict[str, Any]) -> str:
    close = difflib.get_close_matches(key, fields, n=1)
    return f"; did you mean {close[0]}?" if close else f"; known here: {', '.join(fields)}"


def _expected(hint: Any) -> str:
    """What would be right, where the type can say it in words: a choice, or the description of a form."""
    if typing.get_origin(hint) is typing.Literal:
        return f"expected {_describe(hint)}"
    described = (meta.description for meta in typing.get_args(hint)[1:] if isinstance(meta, msgspec.Meta))
    return next((f"expected {text}" for text in described if text), "")


def _shown(value: Any) -> str:
    text = repr(value)
    return text if len(text) <= 60 else f"{text[:60]}..."


def _describe(hint: Any) -> str:
    if dataclasses.is_dataclass(hint):
        return "a section"
    if typing.get_origin(hint) is typing.Literal:
        return " or ".join(map(str, typing.get_args(hint)))
    base = typing.get_args(hint)[0] if typing.get_origin(hint) is typing.Annotated else hint
    return getattr(base, "__name__", str(base))


def _kind(value: Any) -> str:
    return "nothing" if value is None else type(value).__name__

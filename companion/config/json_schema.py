"""The keys of a configuration as a JSON schema, for editors: what a value means while it is being written.

Draft 7, which the YAML language server has always known. What must fit each other (`rules`) no schema can say; the
service and `companion config check` do.
"""

from __future__ import annotations

import ast
import contextlib
import dataclasses
import inspect
import textwrap
import typing
from collections.abc import Iterator
from typing import Any, Final, cast

import msgspec

from companion.config import schema, tag_camera
from companion.config.schema import CHECK, Config

_DRAFT: Final = "http://json-schema.org/draft-07/schema#"
_TITLE: Final = "Configuration of the companion"
_MOST: Final = 255
"""No number with a check of its own is larger: WiFi channels."""


def json_schema() -> dict[str, Any]:
    """Unknown keys are wrong, as they are to the service; each key has its meaning."""
    made = msgspec.json.schema(Config)
    sections: dict[str, Any] = made["$defs"]
    for name, section in sections.items():
        _complete(section, getattr(schema if hasattr(schema, name) else tag_camera, name))
    root = sections.pop(Config.__name__)
    whole = {"$schema": _DRAFT, **root, "title": _TITLE, "$defs": sections}
    return cast(dict[str, Any], msgspec.json.decode(msgspec.json.encode(whole)))  # tuples become lists


def keys_of(described: dict[str, Any]) -> dict[str, dict[str, Any]]:
    """Every key of a schema of ours, as `gate.max_speed_m_s` or `peers[].mac`, with what it says of it."""
    return dict(_keys(described, described.get("$defs", {}), ""))


def _keys(section: dict[str, Any], sections: dict[str, Any], path: str) -> Iterator[tuple[str, dict[str, Any]]]:
    for name, described in section.get("properties", {}).items():
        below = f"{path}{name}"
        yield below, described
        for reference, joint in _references(described):
            yield from _keys(sections[reference.rpartition("/")[2]], sections, f"{below}{joint}.")


def _references(described: dict[str, Any]) -> Iterator[tuple[str, str]]:
    """Sections that a key holds: itself, one of its choices or its items."""
    for choice in (described, *described.get("anyOf", ()), *described.get("allOf", ())):
        if "$ref" in choice:
            yield choice["$ref"], ""
    if "$ref" in (items := described.get("items", {})):
        yield items["$ref"], "[]"


def _complete(section: dict[str, Any], cls: type) -> None:
    section["additionalProperties"] = False
    section["description"] = " ".join((cls.__doc__ or "").split())
    meanings, hints = _meanings(cls), typing.get_type_hints(cls, include_extras=True)
    for name, described in section["properties"].items():
        if "$ref" in described:  # draft 7 looks at nothing that stands beside a reference
            described["allOf"] = [{"$ref": described.pop("$ref")}]
        if name in meanings:
            described["description"] = meanings[name]
        if checks := list(_checks(hints[name])):
            described["enum"] = [value for value in range(_MOST + 1) if all(_passes(check, value) for check in checks)]
        _flatten(described)


def _flatten(described: dict[str, Any]) -> None:
    """A tuple's places are a later draft's: here all of them get what the first is, without limits of its own."""
    places = described.pop("prefixItems", None)
    if places is not None:
        described["items"] = {"type": places[0]["type"]}


def _meanings(cls: type) -> dict[str, str]:
    """The text below each field, which Python itself does not keep."""
    (body,) = (
        node for node in ast.parse(textwrap.dedent(inspect.getsource(cls))).body if isinstance(node, ast.ClassDef)
    )
    found = {}
    for field, text in zip(body.body, body.body[1:], strict=False):
        if isinstance(field, ast.AnnAssign) and isinstance(field.target, ast.Name) and isinstance(text, ast.Expr):
            with contextlib.suppress(ValueError, AttributeError):  # no text, then
                found[field.target.id] = " ".join(ast.literal_eval(text.value).split())
    assert found.keys() <= {field.name for field in dataclasses.fields(cls)}
    return found


def _checks(hint: Any) -> Iterator[Any]:
    for meta in typing.get_args(hint):
        if isinstance(meta, msgspec.Meta) and meta.extra is not None:
            yield meta.extra[CHECK]


def _passes(check: Any, value: int) -> bool:
    try:
        check(value)
    except ValueError:
        return False
    return True

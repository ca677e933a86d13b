"""Convert TOML and JSON documents that come from outside to typed values.

A `msgspec.Struct` describes a document; errors name the document, the key and the allowed values.
"""

from __future__ import annotations

import difflib
import json
import math
import re
import types
import typing
from typing import Any, TypeVar

import msgspec

from s2rstore.errors import RequestError, shortened

Kind = TypeVar("Kind")
_MAX_SHOWN = 60
_TYPES = {"str": str, "int": int, "float": float, "bool": bool, "array": list, "object": dict}
_NAMES = {
    "str": "text",
    "int": "a whole number",
    "float": "a number",
    "bool": "true or false",
    "array": "a list",
    "object": "a table",
}
_UNKNOWN = re.compile(r"Object contains unknown field `(.*)`\Z", re.S)
_MISSING = re.compile(r"Object missing required field `(.*)`\Z", re.S)
_EXPECTED = re.compile(r"Expected `([^`]*)`(.*?)(?:, got `?(\w+)`?)?\Z", re.S)
_STEP = re.compile(r"\.([^.\[]+)|\[(\d+)\]|(\[\.\.\.\])")


def convert(
    data: Any, kind: type[Kind], where: str, check: bool = True, key: str = ""
) -> Kind:  # fmt: skip
    """Return `data` as an instance of the struct `kind`; `where` names the document.

    `key` is the key of `data` in the document. Raises RequestError for unknown, missing and invalid
    values. `check` also refuses numbers that are not finite or exceed 64 bits, and empty texts, at
    any depth.
    """
    if check:
        _check_values(data, where, key)
    try:
        return msgspec.convert(data, kind, str_keys=True)
    except msgspec.ValidationError as error:
        raise RequestError(f"{where}: {_message(str(error), data, kind, key)}") from None


def _check_values(value: Any, where: str, key: str) -> None:
    place = f"{where}: {key}"
    if isinstance(value, dict):
        for name, each in value.items():
            _check_values(each, where, f"{key}.{name}" if key else str(name))
    elif isinstance(value, list):
        for number, each in enumerate(value):
            _check_values(each, where, f"{key}[{number}]")
    elif isinstance(value, float) and not math.isfinite(value):
        raise RequestError(f"{place}: expected a finite number, got {value}")
    elif type(value) is int and abs(value) >= 2**63:
        raise RequestError(f"{place}: expected a number of at most 64 bits")
    elif isinstance(value, str) and (not value.strip() or "\0" in value):
        raise RequestError(f"{place}: must not be empty or contain NUL")


def _message(text: str, data: Any, kind: Any, key: str) -> str:
    reason, _, path = text.partition(" - at `$")
    expected = _EXPECTED.match(reason)
    key, value, struct = _resolve(path.rstrip("`"), data, kind, key, expected and expected[3])
    prefix = f"{key}." if key else ""
    if missing := _MISSING.match(reason):
        return f"{prefix}{missing[1]}: missing"
    if unknown := _UNKNOWN.match(reason):
        known = [field.encode_name for field in msgspec.structs.fields(struct)]
        close = difflib.get_close_matches(unknown[1], known, n=1)
        suggestion = f"did you mean {close[0]}? " if close else ""
        return (
            f"{prefix}{shortened(unknown[1])}: unknown key; {suggestion}known: {', '.join(known)}"
        )
    if expected is None:
        return f"{key}: {reason}" if key else reason
    kinds = expected[1].split(" | ")
    if "float" in kinds and "int" in kinds:
        kinds.remove("int")
    allowed = " or ".join(_NAMES[each] for each in kinds if each in _NAMES)
    limit = re.sub(r"(\d)\.0\b", r"\1", expected[2])
    got = expected[3] if (expected[3] or "").isdigit() else _shown(value)
    return f"{key or 'document'}: expected {allowed}{limit}, got {got}"


def _resolve(
    path: str, data: Any, kind: Any, key: str, actual_type: str | None
) -> tuple[str, Any, Any]:
    """The key, value and struct type at a path of msgspec, which does not name keys of a dict."""
    for name, number, any_key in _STEP.findall(path):
        if any_key:
            expected = _TYPES.get(actual_type or "")
            name = next((str(k) for k, v in data.items() if type(v) is expected), next(iter(data)))
        if number:
            kind = next(iter(typing.get_args(kind)), kind)
            data, key = data[int(number)], f"{key}[{number}]"
        else:
            kind = _field_type(kind, name)
            data, key = data[name], f"{key}.{name}" if key else name
    return key, data, kind


def _field_type(kind: Any, name: str) -> Any:
    """The struct that a field or the values of a dict are annotated with, else the annotation."""
    if isinstance(kind, type) and issubclass(kind, msgspec.Struct):
        kind = typing.get_type_hints(kind).get(name)
    options = (
        typing.get_args(kind) if typing.get_origin(kind) in (dict, types.UnionType) else (kind,)
    )
    structs = [each for each in options if isinstance(each, type)]
    return next((each for each in structs if issubclass(each, msgspec.Struct)), kind)


def _shown(value: Any) -> str:
    if isinstance(value, dict | list):
        return "a table" if isinstance(value, dict) else "a list"
    text = json.dumps(value, ensure_ascii=False, default=str)
    return text if len(text) <= _MAX_SHOWN else f"{text[:_MAX_SHOWN]}..."

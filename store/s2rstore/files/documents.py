"""Read JSON and TOML of unknown origin: of bounded size, each key once, not nested too deeply."""

from __future__ import annotations

import json
import re
import tomllib
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, TypeVar

import msgspec

from s2rstore.errors import RequestError
from s2rstore.files.input_files import read_text, reason_of

T = TypeVar("T")

MAX_JSON_BYTES = 8 << 20
"""Bytes of a JSON document. Parsed, it takes up to 50 times as much memory."""
MAX_TOML_BYTES = 1 << 20
"""Bytes of a TOML document: a thousand times what the configurations here need."""
_MAX_KEY_PARTS = 32
"""Maximum parts of a dotted TOML key; tomllib needs memory quadratic in their number."""
_TOML_TOKEN = re.compile(
    r"""(?P<key>"(?:[^"\\\n]|\\.)*"|'[^'\n]*'|[\w+-]+)|(?P<dot>\.)|(?P<blank>[ \t]+)|.|\n""", re.S
)


def read_json(path: Path, limit: int = MAX_JSON_BYTES) -> Any:
    """The value of a JSON file of at most `limit` bytes; RequestError for anything else."""
    return parse_json(read_text(path, limit), str(path))


def read_toml(path: Path) -> dict[str, Any]:
    """The table of a TOML file; RequestError for any other content."""
    text = read_text(path, MAX_TOML_BYTES)
    with _refusing(f"{path}: not valid TOML"):
        _check_keys(text)
        return tomllib.loads(text)


def read_document(path: Path) -> Any:
    """A JSON file where the suffix is `.json`, else TOML."""
    return read_json(path) if path.suffix.lower() == ".json" else read_toml(path)


def parse_json(text: str | bytes, where: str) -> Any:
    """The value of a JSON text; RequestError, beginning with `where`, for anything else.

    Duplicate keys of an object are refused, because readers differ in which one counts.
    """
    with _refusing(f"{where}: not valid JSON"):
        return json.loads(text, object_pairs_hook=_unique)


def decode_json(content: bytes, kind: type[T], where: str) -> T:
    """A JSON text as a record whose fields have the declared types.

    Raises RequestError, which begins with `where` and names the wrong field and the valid type.
    """
    with _refusing(f"{where}: damaged", "; restore it"):
        return msgspec.json.decode(content, type=kind)


@contextmanager
def _refusing(problem: str, advice: str = "") -> Iterator[None]:
    """Turn errors of a parser into RequestErrors that state the problem and the reason."""
    try:
        yield
    except RecursionError:
        raise RequestError(f"{problem} (nested too deeply){advice}") from None
    except (msgspec.DecodeError, ValueError) as error:
        raise RequestError(f"{problem} ({reason_of(error)}){advice}") from error


def parse_object(text: str | bytes, where: str) -> dict[str, Any]:
    """The value of a JSON text that must be an object; see `parse_json`."""
    value = parse_json(text, where)
    if not isinstance(value, dict):
        raise RequestError(f"{where}: not a JSON object")
    return value


def _unique(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    counts = Counter(key for key, _ in pairs)
    for key, count in counts.items():
        if count > 1:
            raise ValueError(f"duplicate key {key[:80]!r}")
    return dict(pairs)


def _check_keys(text: str) -> None:
    """Raises ValueError for a dotted key of too many parts."""
    parts, dotted = 0, False
    for token in _TOML_TOKEN.finditer(text):
        if token["key"] is not None:
            parts = parts + 1 if dotted else 1
        elif token["dot"] is None and token["blank"] is None:
            parts = 0
        if parts > _MAX_KEY_PARTS:
            line = text.count("\n", 0, token.start()) + 1
            raise ValueError(f"line {line}: a key of more than {_MAX_KEY_PARTS} parts")
        if token["blank"] is None:
            dotted = token["dot"] is not None and parts > 0

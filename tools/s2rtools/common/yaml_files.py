"""Read YAML files of unknown origin: plain values only, within size limits."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from ruamel.yaml import YAML

from s2rstore.errors import RequestError, first_line
from s2rstore.files.input_files import read_text

_MAX_BYTES = 64 << 10
"""Parsing takes about a second for each 50 KB."""
_MAX_VALUES = _MAX_BYTES
"""Values that are left where each alias is replaced by what it stands for."""


def read_yaml(path: Path) -> Any:
    """The value of a YAML file of at most 64 KiB; RequestError for anything else.

    Numbers, texts, lists and tables are read; tags that make other objects are refused.
    """
    text = read_text(path, _MAX_BYTES)
    try:
        value = YAML(typ="safe", pure=True).load(text)
    except RecursionError:
        raise RequestError(f"{path}: not valid YAML (nested too deeply)") from None
    except Exception as error:  # a value that does not fit its tag raises errors of any type
        mark = getattr(error, "problem_mark", None)
        line = f" at line {mark.line + 1}" if mark else ""
        reason = getattr(error, "problem", None) or first_line(error)
        raise RequestError(f"{path}: not valid YAML ({reason}{line})") from error
    _check_size(value, path)
    return value


def _check_size(value: Any, path: Path) -> None:
    """Raise RequestError where few aliases stand for very many values, or for themselves."""
    values = [value]
    for each in values:
        values += (
            each.values() if isinstance(each, dict) else each if isinstance(each, list) else ()
        )
        if len(values) > _MAX_VALUES:
            raise RequestError(f"{path}: more than {_MAX_VALUES:,} values; use no aliases")

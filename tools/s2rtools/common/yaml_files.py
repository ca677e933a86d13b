"""Read YAML files of unknown origin: plain values only, within size limits."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from ruamel.yaml import YAML
from ruamel.yaml.error import YAMLError

from s2rstore.errors import RequestError, first_line
from s2rstore.files.input_files import read_text

_MAX_BYTES = 64 << 10
"""Parsing takes about a second for each 50 KB."""


def read_yaml(path: Path) -> Any:
    """The value of a YAML file of at most 64 KiB; RequestError for anything else.

    Numbers, texts, lists and tables are read; tags that make other objects are refused.
    """
    text = read_text(path, _MAX_BYTES)
    try:
        return YAML(typ="safe", pure=True).load(text)
    except RecursionError:
        raise RequestError(f"{path}: not valid YAML (nested too deeply)") from None
    except (YAMLError, ValueError) as error:
        mark = getattr(error, "problem_mark", None)
        line = f" at line {mark.line + 1}" if mark else ""
        reason = getattr(error, "problem", None) or first_line(error)
        raise RequestError(f"{path}: not valid YAML ({reason}{line})") from error

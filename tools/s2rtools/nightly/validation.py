"""What a night's TOML file gives: known names of the right type, values that name their place."""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from s2rstore.errors import RequestError
from s2rtools.gap.defaults import ODOMETRY

_SECTIONS: dict[str, dict[str, type | tuple[type, ...]]] = {
    "": {
        "name": str, "store": str, "run": str, "select": str, "axes": list, "reference": str,
        "golden": str, "threshold": (int, float), "margin": (int, float), "seed": int,
        "replicates": int, "features": str,
    },
    "drives": {"folder": str, "rate": (int, float), "topic": str, "dynamics": list},
    "sysid": {
        "simulator": str, "parameters": list, "fix": dict, "range": dict, "drives": str,
        "seed": int, "seeds": int, "evaluations": int,
    },
    "output": {"history": str, "reports": str, "metrics": str},
    "stale": {"after_days": (int, float)},
}  # fmt: skip
_TOLD = {
    str: "text", int: "a whole number", (int, float): "a number", list: "a list of names",
    dict: "a table of numbers",
}  # fmt: skip
_TABLES: dict[str, tuple[tuple[type, ...], str]] = {
    "fix": ((int, float), _TOLD[dict]),
    "range": ((str,), 'a table of ranges, as latency = "0..0.5"'),
}


class Given:
    """Checked values of one file; every complaint names it."""

    def __init__(self, path: Path, content: Mapping[str, Any]) -> None:
        self.path = path
        self._content = content

    def refuse(self, where: str, told: str) -> RequestError:
        return RequestError(f"{self.path}: {where}: {told}")

    def get(self, key: str, section: str = "", default: Any = None) -> Any:
        table = self._content.get(section, {}) if section else self._content
        return table.get(key, default)

    def needed(self, key: str, section: str = "") -> Any:
        value = self.get(key, section)
        if value is None:
            raise self.refuse(_named(section, key), "missing")
        return value

    def place(self, value: str) -> Path:
        """A path, relative to the file's folder."""
        try:
            return (self.path.parent / Path(value).expanduser()).resolve()
        except RuntimeError as error:
            raise RequestError(f"{self.path}: {value}: no such user's folder") from error

    def file(self, key: str, section: str = "") -> Path | None:
        """An existing file."""
        value = self.get(key, section)
        if value is None:
            return None
        path = self.place(value)
        if not path.is_file():
            raise self.refuse(_named(section, key), f"{path}: no such file")
        return path

    def drives(self, key: str, section: str) -> str | None:
        """An existing folder, or the word `odometry`."""
        value = self.get(key, section)
        if value is None or value == ODOMETRY:
            return None if value is None else ODOMETRY
        path = self.place(value)
        if not path.is_dir():
            told = f"{path}: no such folder (or `{ODOMETRY}`; without it: the store's)"
            raise self.refuse(_named(section, key), told)
        return str(path)

    def number(self, key: str, default: float, lowest: float, highest: float, section: str = "",
               over: bool = False) -> Any:  # fmt: skip
        """A finite number within bounds; `over` leaves out the lowest."""
        value = self.get(key, section, default)
        if not math.isfinite(value) or not lowest <= value <= highest or (over and value == lowest):
            bounds = f"over {lowest:g}" if over else f"{lowest:g} .. {highest:g}"
            raise self.refuse(_named(section, key), f"{bounds}, not {value}")
        return value


def check_types(path: Path, content: Mapping[str, Any]) -> None:
    """Raises RequestError for a name that is not known, and for a value of another type."""
    for key, value in content.items():
        if key in _SECTIONS and key:
            if not isinstance(value, dict):
                raise RequestError(f"{path}: {key}: must be a table, [{key}]")
            for inner, found in value.items():
                _check_type(path, key, inner, found)
        else:
            _check_type(path, "", key, value)


def _check_type(path: Path, section: str, key: str, value: object) -> None:
    known = _SECTIONS[section]
    where = _named(section, key)
    if key not in known:
        others = [*known, *(f"[{name}]" for name in _SECTIONS if name and not section)]
        raise RequestError(f"{path}: {where}: not known; known: {', '.join(others)}")
    wanted = known[key]
    if isinstance(value, bool) or not isinstance(value, wanted):
        told = _TABLES[key][1] if wanted is dict else _TOLD[wanted]
        raise RequestError(f"{path}: {where}: must be {told}, not {value!r}")
    each = value.values() if isinstance(value, dict) else (value,)
    if any(isinstance(one, int) and abs(one) >= 2**63 for one in each):
        raise RequestError(f"{path}: {where}: beyond what 64 bits hold")
    if isinstance(value, str) and (not value.strip() or "\0" in value):
        raise RequestError(f"{path}: {where}: must not be empty")
    if isinstance(value, list) and not all(isinstance(item, str) for item in value):
        raise RequestError(f"{path}: {where}: must be {_TOLD[list]}")
    if isinstance(value, dict):
        kinds, told = _TABLES[key]
        if not all(type(item) in kinds for item in value.values()):
            raise RequestError(f"{path}: {where}: must be {told}")


def _named(section: str, key: str) -> str:
    return f"{section}.{key}" if section else key

"""What to do every night: a TOML file, checked before anything is opened."""

from __future__ import annotations

import math
import re
import tomllib
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from s2rstore import history, layout
from s2rstore.errors import RequestError
from s2rtools.gap import defaults
from s2rtools.gap.axes import AXES
from s2rtools.gap.defaults import ODOMETRY
from s2rtools.nightly import simulation
from s2rtools.nightly.places import check_apart

_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9_.-]{0,79}\Z")
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


@dataclass(frozen=True, slots=True)
class Sysid:
    """Which simulator to identify from a folder of drives, as `s2r sysid` does.

    `parameters` None: those that it searches by default; `fixed` are known values; `ranges` are
    written as LOW..HIGH or LOW..HIGH:log.
    """

    drives: str
    simulator: str = "planar"
    parameters: tuple[str, ...] | None = None
    fixed: Mapping[str, float] = field(default_factory=dict)
    seed: int = 1
    seeds: int = 3
    evaluations: int | None = None
    ranges: Mapping[str, str] = field(default_factory=dict)
    topic: str | None = None


@dataclass(frozen=True, slots=True)
class Config:
    """One nightly gate; all paths are resolved.

    `drives` is a folder (by default the one in the store), or `odometry`, whose `rate` (Hz) is
    needed where it was stored without times; `topic` is that of poses in ROS bags,
    `dynamics` what is asked of the axes of motion, as `s2r gap --dynamics` words.
    """

    source: Path
    name: str
    store: Path
    run: str | None
    select: str
    axes: tuple[str, ...]
    reference: Path | None
    golden: Path | None
    threshold: float
    margin: float
    seed: int
    replicates: int
    features: Path | None
    drives: str | None
    rate: float | None
    topic: str | None
    dynamics: tuple[str, ...]
    sysid: Sysid | None
    history: Path
    reports: Path
    metrics: Path | None
    stale_after: float


class _Reader:
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


def read(path: Path) -> Config:
    """Raises RequestError for a file that is missing, no TOML, or asks for what is not known."""
    try:
        content = tomllib.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise RequestError(f"{path}: {error.strerror or error}") from error
    except (ValueError, RecursionError) as error:
        raise RequestError(f"{path}: no TOML ({error})") from error
    _check_types(path, content)
    given = _Reader(path.absolute(), content)
    name = given.get("name", default=path.stem)
    if not _NAME.match(name):
        raise given.refuse("name", f"{name!r}: use letters, digits and _ . - (at most 80)")
    store = given.place(given.needed("store"))
    if not store.is_dir():
        raise given.refuse("store", f"{store}: no such folder")
    kept, told = (given.get(key, "output") for key in ("history", "metrics"))
    found = Config(
        source=given.path,
        name=name,
        store=store,
        run=given.get("run"),
        select=given.get("select", default="all"),
        axes=_axes(given),
        reference=given.file("reference"),
        golden=given.file("golden"),
        threshold=float(given.number("threshold", defaults.THRESHOLD, 0, math.inf, over=True)),
        margin=float(given.number("margin", defaults.MARGIN, 0, math.inf, over=True)),
        seed=given.number("seed", defaults.SEED, 0, defaults.MOST_SEED),
        replicates=_replicates(given),
        features=given.file("features"),
        drives=_drives(given, store),
        rate=_rate(given),
        topic=given.get("topic", "drives"),
        dynamics=_dynamics(given),
        sysid=_sysid(given, store) if "sysid" in content else None,
        history=given.place(kept) if kept else history.path_in(store),
        reports=given.place(given.get("reports", "output", f"reports/{name}")),
        metrics=given.place(told) if told else None,
        stale_after=float(given.number("after_days", 7.0, 0, math.inf, "stale")),
    )
    check_apart(found)
    return found


def _axes(given: _Reader) -> tuple[str, ...]:
    wanted = given.get("axes", default=[])
    for name in wanted:
        if name not in AXES:
            raise given.refuse("axes", f"{name!r}: one of {', '.join(AXES)}")
    if len(set(wanted)) != len(wanted):
        raise given.refuse("axes", "names an axis twice")
    return tuple(wanted)


def _drives(given: _Reader, store: Path) -> str | None:
    own = store / layout.DRIVES
    return given.drives("folder", "drives") or (str(own) if own.is_dir() else None)


def _replicates(given: _Reader) -> int:
    bounds = defaults.FEWEST_REPLICATES, defaults.MOST_REPLICATES
    return int(given.number("replicates", defaults.REPLICATES, *bounds))


def _dynamics(given: _Reader) -> tuple[str, ...]:
    words = tuple(given.get("dynamics", "drives", []))
    if words:
        from s2rtools.gap.dynamics import options

        try:
            options.axes(words)
        except RequestError as error:
            told = str(error).removeprefix("--dynamics ")
            raise given.refuse("drives.dynamics", told) from error
    return words


def _rate(given: _Reader) -> float | None:
    if given.get("rate", "drives") is None:
        return None
    return float(given.number("rate", 0.0, 0, math.inf, "drives", over=True))


def _sysid(given: _Reader, store: Path) -> Sysid:
    drives = given.drives("drives", "sysid") or _drives(given, store)
    if drives in (None, ODOMETRY):
        raise given.refuse("sysid.drives", "missing, and there is no folder in drives.folder")
    names = given.get("parameters", "sysid")
    evaluations = given.get("evaluations", "sysid")
    if evaluations is not None:
        evaluations = given.number("evaluations", 0, 10, 1_000_000, "sysid")
    wanted = Sysid(
        str(drives),
        given.get("simulator", "sysid", "planar"),
        None if names is None else tuple(names),
        given.get("fix", "sysid", {}),
        given.number("seed", 1, 0, defaults.MOST_SEED, "sysid"),
        given.number("seeds", 3, 1, 100, "sysid"),
        evaluations,
        given.get("range", "sysid", {}),
        given.get("topic", "drives"),
    )
    try:
        simulation.check(wanted)
    except RequestError as error:
        raise given.refuse("sysid", str(error).removeprefix("--")) from error
    return wanted


def _check_types(path: Path, content: Mapping[str, Any]) -> None:
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

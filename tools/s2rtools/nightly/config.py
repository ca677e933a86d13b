"""What to do every night: a TOML file, checked before anything is opened."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

from s2rstore.errors import RequestError
from s2rstore.files import layout, safe_files
from s2rstore.files.input_files import read_toml
from s2rstore.gap_history import reader as history
from s2rtools.gap import defaults
from s2rtools.gap.axes import AXES
from s2rtools.gap.defaults import ODOMETRY
from s2rtools.nightly import sysid_settings
from s2rtools.nightly.output_paths import check_apart
from s2rtools.nightly.validation import Given, check_types

_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9_.-]{0,79}\Z")


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


def read(path: Path) -> Config:
    """Raises RequestError for a file that is missing, no TOML, or asks for what is not known."""
    content = read_toml(path)
    check_types(path, content)
    given = Given(path.absolute(), content)
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
        history=given.place(kept) if kept else history.history_path(store),
        reports=given.place(given.get("reports", "output", f"reports/{name}")),
        metrics=given.place(told) if told else None,
        stale_after=float(given.number("after_days", 7.0, 0, math.inf, "stale")),
    )
    check_apart(found)
    return found


def _axes(given: Given) -> tuple[str, ...]:
    wanted = given.get("axes", default=[])
    for name in wanted:
        if name not in AXES:
            raise given.refuse("axes", f"{name!r}: one of {', '.join(AXES)}")
    if len(set(wanted)) != len(wanted):
        raise given.refuse("axes", "names an axis twice")
    return tuple(wanted)


def _drives(given: Given, store: Path) -> str | None:
    wanted = given.drives("folder", "drives")
    if wanted is None:
        own = safe_files.checked_folder(store, layout.DRIVES) if store.is_dir() else None
        wanted = None if own is None else str(own)
    return wanted


def _replicates(given: Given) -> int:
    bounds = defaults.FEWEST_REPLICATES, defaults.MOST_REPLICATES
    return int(given.number("replicates", defaults.REPLICATES, *bounds))


def _dynamics(given: Given) -> tuple[str, ...]:
    words = tuple(given.get("dynamics", "drives", []))
    if words:
        from s2rtools.gap.dynamics import options

        try:
            options.axes(words)
        except RequestError as error:
            told = str(error).removeprefix("--dynamics ")
            raise given.refuse("drives.dynamics", told) from error
    return words


def _rate(given: Given) -> float | None:
    if given.get("rate", "drives") is None:
        return None
    return float(given.number("rate", 0.0, 0, math.inf, "drives", over=True))


def _sysid(given: Given, store: Path) -> Sysid:
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
        sysid_settings.check(wanted)
    except RequestError as error:
        raise given.refuse("sysid", str(error).removeprefix("--")) from error
    return wanted

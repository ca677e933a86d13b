"""Configuration of a nightly gate: a TOML file that is validated before anything is opened."""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import msgspec
from msgspec import Meta, Struct

from s2rstore.errors import RequestError
from s2rstore.files import layout, safe_files
from s2rstore.files.documents import read_toml
from s2rstore.gap_history import reader as history
from s2rstore.gap_history.change_check import YEAR_LEVEL
from s2rtools.common.command_line.assignments import parse_assignments
from s2rtools.common.typed_documents import convert
from s2rtools.gap.axes import (
    AXES,
    MARGIN,
    MAX_SEED,
    MOTION,
    ODOMETRY,
    SEED,
    THRESHOLD,
    configured,
    options_of,
)
from s2rtools.gap.axis import GapSettings
from s2rtools.gap.gate.gate import GapRequest

if TYPE_CHECKING:
    from s2rtools.sysid.identify import SysidSettings

_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9_.-]{0,79}\Z")
Positive = Annotated[float, Meta(gt=0)]
Seed = Annotated[int, Meta(ge=0, le=MAX_SEED)]


class DrivesTable(Struct, frozen=True, forbid_unknown_fields=True):
    """The section [drives]."""

    folder: str | None = None
    rate: Positive | None = None
    topic: str | None = None
    dynamics: list[str] = []


class SysidTable(Struct, frozen=True, forbid_unknown_fields=True):
    """The section [sysid]: parameters are identified from a folder of drives, as `s2r sysid` does.

    `parameters` None: those that are searched by default; `fixed` are known values; `ranges` are
    written as LOW..HIGH or LOW..HIGH:log.
    """

    drives: str = ""
    simulator: str = "planar"
    parameters: tuple[str, ...] | None = None
    fixed: dict[str, int | float] = msgspec.field(name="fix", default_factory=dict)
    seed: Seed = 1
    seeds: Annotated[int, Meta(ge=1, le=100)] = 3
    evaluations: Annotated[int, Meta(ge=10, le=1_000_000)] | None = None
    ranges: dict[str, str] = msgspec.field(name="range", default_factory=dict)

    def settings(self) -> SysidSettings:
        """The settings of the identification. Raises RequestError for invalid ranges."""
        from s2rtools.sysid.identify import SysidSettings
        from s2rtools.sysid.parameter_space import parse_ranges

        ranges = parse_ranges(self.ranges, "range.")
        return SysidSettings(
            self.simulator, self.parameters, self.fixed, self.seeds, seed=self.seed,
            evaluations=self.evaluations, ranges=ranges,
        )  # fmt: skip


class OutputTable(Struct, frozen=True, forbid_unknown_fields=True):
    """The section [output]."""

    history: str | None = None
    reports: str | None = None
    metrics: str | None = None


class StaleTable(Struct, frozen=True, forbid_unknown_fields=True):
    """The section [stale]."""

    after_days: Annotated[float, Meta(ge=0)] = 7.0


class ConfigFile(Struct, frozen=True, forbid_unknown_fields=True):
    """The TOML file."""

    store: str
    name: str | None = None
    run: str | None = None
    select: str = "all"
    axes: list[str] = []
    reference: str | None = None
    golden: str | None = None
    threshold: Positive = THRESHOLD
    margin: Positive = MARGIN
    seed: Seed = SEED
    features: str | None = None
    drives: DrivesTable = DrivesTable()
    sysid: SysidTable | None = None
    output: OutputTable = OutputTable()
    stale: StaleTable = StaleTable()


@dataclass(frozen=True, slots=True)
class NightlyConfig:
    """One nightly gate with resolved paths; `stale_after` is in days."""

    source: Path
    name: str
    store: Path
    request: GapRequest
    sysid: SysidTable | None
    history: Path
    reports: Path
    metrics: Path | None
    stale_after: float


def read(path: Path) -> NightlyConfig:
    """Read a configuration. Raises RequestError that names file and key for anything invalid."""
    file = convert(read_toml(path), ConfigFile, str(path))
    source = path.absolute()
    name = path.stem if file.name is None else file.name
    if not _NAME.match(name):
        raise _invalid(source, "name", f"{name!r}: use letters, digits and _ . - (at most 80)")
    store = _resolve(source, file.store)
    if not store.is_dir():
        raise _invalid(source, "store", f"{store}: no such folder")
    drives = _drives(source, "drives.folder", file.drives.folder)
    if drives is None:
        folder = safe_files.checked_folder(store, layout.DRIVES)
        drives = None if folder is None else str(folder)
    request = GapRequest(
        run=file.run,
        expression=file.select,
        axes=_axes(source, file.axes),
        drives=drives,
        rate=file.drives.rate,
        features=_file(source, "features", file.features),
        topic=file.drives.topic,
        reference=_file(source, "reference", file.reference),
        golden=_file(source, "golden", file.golden),
        threshold=file.threshold,
        margin=file.margin,
        options=_options(source, file.drives.dynamics),
        settings=GapSettings(fail_level=YEAR_LEVEL, seed=file.seed),
    )
    output = file.output
    config = NightlyConfig(
        source=source,
        name=name,
        store=store,
        request=request,
        sysid=_sysid(source, file.sysid, drives) if file.sysid else None,
        history=_resolve(source, output.history) if output.history else history.history_path(store),
        reports=_resolve(source, output.reports or f"reports/{name}"),
        metrics=_resolve(source, output.metrics) if output.metrics else None,
        stale_after=file.stale.after_days,
    )
    _check_outputs(config)
    return config


def _invalid(source: Path, key: str, message: str) -> RequestError:
    return RequestError(f"{source}: {key}: {message}")


def _resolve(source: Path, value: str) -> Path:
    """A path, relative to the folder of the configuration."""
    try:
        return (source.parent / Path(value).expanduser()).resolve()
    except RuntimeError as error:
        raise RequestError(f"{source}: {value}: the user has no home folder") from error


def _file(source: Path, key: str, value: str | None) -> Path | None:
    """An existing file."""
    if value is None:
        return None
    path = _resolve(source, value)
    if not path.is_file():
        raise _invalid(source, key, f"{path}: no such file")
    return path


def _drives(source: Path, key: str, value: str | None) -> str | None:
    """An existing folder, or `odometry`."""
    if value is None or value == ODOMETRY:
        return value
    path = _resolve(source, value)
    if not path.is_dir():
        reason = f"{path}: no such folder; give a folder or {ODOMETRY!r} (default: the store's)"
        raise _invalid(source, key, reason)
    return str(path)


def _axes(source: Path, names: list[str]) -> tuple[str, ...]:
    for name in names:
        if name not in AXES:
            raise _invalid(source, "axes", f"{name!r}: expected one of {', '.join(AXES)}")
    if len(set(names)) != len(names):
        raise _invalid(source, "axes", "an axis is listed twice")
    return tuple(names)


def _options(source: Path, written: list[str]) -> dict[str, str]:
    try:
        texts = parse_assignments(MOTION, written, options_of(MOTION))
        if texts:
            configured(texts)
    except RequestError as error:
        reason = str(error).removeprefix(f"{MOTION} ")
        raise _invalid(source, "drives.dynamics", reason) from error
    return texts


def _sysid(source: Path, table: SysidTable, default_drives: str | None) -> SysidTable:
    """The section with the resolved folder of drives."""
    from s2rtools.sysid.identify import configured_simulator

    drives = _drives(source, "sysid.drives", table.drives or default_drives)
    if drives is None or drives == ODOMETRY:
        raise _invalid(source, "sysid.drives", "missing, and drives.folder names no folder")
    try:
        configured_simulator(table.settings())
    except RequestError as error:
        raise _invalid(source, "sysid", str(error).removeprefix("--")) from error
    return msgspec.structs.replace(table, drives=drives)


def _check_outputs(config: NightlyConfig) -> None:
    """Raises RequestError where an output is a folder, a device, or another file of the gate."""
    request = config.request
    taken = {config.source.resolve(), request.reference, request.golden, request.features}
    for name, path in {"history": config.history, "metrics": config.metrics}.items():
        if path is None:
            continue
        key = f"output.{name}"
        if path.exists() and not path.is_file():
            raise _invalid(config.source, key, f"{path}: a folder or a device; name a file")
        if path in taken:
            reason = f"{path}: is another file of this gate; name a different file"
            raise _invalid(config.source, key, reason)
        taken.add(path)

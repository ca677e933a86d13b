"""Read the tables of a store's index, at one generation, as records."""

from __future__ import annotations

from dataclasses import replace
from functools import cached_property
from typing import Any

from s2rstore.errors import RequestError
from s2rstore.files.documents import parse_object
from s2rstore.geometry.camera_offset import RigOffset
from s2rstore.index import row_records, schema
from s2rstore.index.open_index import OpenIndex
from s2rstore.records import (
    NO_RUN,
    SIDES,
    ArrayRecord,
    Dataset,
    Domain,
    Model,
    Part,
    Room,
    Run,
    Trajectory,
    TranslatorRecord,
)
from s2rstore.security.printable_text import printable, printable_lines, printable_values

NO_POSES = "the data set has no poses"
"""Why views and commands refuse a data set of images without poses."""


class IndexCatalog(OpenIndex):
    """An open index with the rows of its small tables as records, which are checked at opening."""

    def _prepare(self) -> None:
        """Raise RequestError where a row of a small table is invalid."""
        super()._prepare()
        self._provenance: dict[str, dict[str, str]] = {}
        filled = self.execute("SELECT count(*) FROM dataset") != [(0,)]
        tables = [
            "trajectories",
            "rooms",
            "label_names",
            "domains",
            "models",
            "translators",
            "runs",
        ]
        for name, most in row_records.MAX_ROWS.items():
            (count,) = self.execute(f'SELECT count(*) FROM "{name}"')[0]
            if count > most:
                raise RequestError(f"{self._index}: table {name}: {count} rows, at most {most}")
        for table in ["dataset", *tables] if filled else tables:
            getattr(self, table)  # reads and checks the table

    @cached_property
    def dataset(self) -> Dataset:
        rows = self._rows("dataset")
        if not rows:
            raise RequestError(f"{self.path}: holds no data set; run `s2r ingest`")
        if len(rows) > 1:
            raise RequestError(f"{self._index}: table dataset: more than one row; run `s2r verify`")
        return row_records.dataset(self._index, rows[0])

    @property
    def has_poses(self) -> bool:
        """Whether the instances have poses, depth and a map, or are images only."""
        return self.dataset.has_poses

    def require_poses(self, purpose: str) -> None:
        """Raise RequestError in a data set without poses; `purpose` begins the reason."""
        if not self.has_poses:
            raise RequestError(f"{self.path}: {NO_POSES}; {purpose} needs poses")

    @cached_property
    def trajectories(self) -> tuple[Trajectory, ...]:
        """In the order of their instances: of each part by name."""
        found = row_records.trajectories(self._index, self._rows("trajectory"))
        if len(self._stored_parts) > 1:
            query = "SELECT trajectory, min(iid) FROM instance GROUP BY trajectory"
            first_iids = {name: int(first) for name, first in self.execute(query)}
            found.sort(key=lambda each: first_iids.get(each.trajectory, 2**31))
        return tuple(found)

    @cached_property
    def rooms(self) -> tuple[Room, ...]:
        """Rectangles in order of precedence."""
        found = row_records.rooms(self._index, self._stored_rows("room"))
        displayed = {stored: name for name, stored in self.stored_rooms.items()}
        return tuple(replace(room, room=displayed[room.room]) for room in found)

    @cached_property
    def label_names(self) -> dict[int, str]:
        """The classes of objects by their values in label images; empty without labels."""
        found = row_records.labels(self._index, self._rows("label"))
        return {each.label: each.name for each in found}

    @cached_property
    def stored_rooms(self) -> dict[str, str]:
        """The displayed names of rooms, which users type, with those in the index, by precedence.

        They differ where a name holds characters that are not printable. Raises RequestError
        where two names are displayed alike.
        """
        names: dict[str, str] = {}
        for row in self._stored_rows("room"):
            displayed = printable(row["room"])
            if names.setdefault(displayed, row["room"]) != row["room"]:
                raise RequestError(
                    f'{self.path}: two rooms are both displayed as "{displayed}", because one name '
                    "holds control characters; rename it in the source and ingest again"
                )
        return names

    @cached_property
    def domains(self) -> dict[str, Domain]:
        rows = self._rows("domain")
        found = row_records.domains(self._index, rows, self._may_have_cameras)
        return {each.domain: each for each in found}

    @property
    def _may_have_cameras(self) -> bool:
        """False in a data set without poses; an index without a data set has no such fact."""
        return not self.execute("SELECT 1 FROM dataset LIMIT 1") or self.has_poses

    def domain(self, name: str) -> Domain:
        """Raises RequestError with the known names."""
        if name not in self.domains:
            known = ", ".join(self.domains)
            raise RequestError(f"domain {name!r}: not in {self.path} (domains: {known})")
        return self.domains[name]

    @cached_property
    def parts(self) -> tuple[Part, ...]:
        """In order of their instances; one part where nothing was appended."""
        return self._stored_parts or (Part(0, 0, self._count, self.dataset.hash),)

    @cached_property
    def _stored_parts(self) -> tuple[Part, ...]:
        """Those of table `part`, which is empty where nothing was appended."""
        return tuple(row_records.parts(self._index, self._rows("part"), self._count))

    @cached_property
    def _count(self) -> int:
        ((count,),) = self.execute("SELECT count(*) FROM instance")
        return int(count)

    @property
    def identity(self) -> str:
        """The hash of the first part, which stays the same when instances are appended.

        Stores of one identity agree on the iids of the first part; `dataset.hash` covers all parts.
        """
        return self.parts[0].hash

    @cached_property
    def models(self) -> dict[str, Model]:
        return {each.model: each for each in row_records.models(self._index, self._rows("model"))}

    @cached_property
    def translators(self) -> dict[str, TranslatorRecord]:
        """In order of creation."""
        found = row_records.translators(self._index, self._rows("translator"))
        return {each.translator: each for each in found}

    def translator(self, name: str) -> TranslatorRecord:
        """Raises RequestError with the known names."""
        if name not in self.translators:
            known = ", ".join(self.translators) or "none"
            raise RequestError(f"translator {name!r}: not in {self.path} (translators: {known})")
        return self.translators[name]

    @cached_property
    def runs(self) -> dict[str, Run]:
        """In order of creation."""
        found = row_records.runs(self._index, self._rows("run"))
        if found and not self.has_poses:
            raise RequestError(
                f"{self._index}: table run: {found[0].run!r} in a data set without poses; "
                "run `s2r verify`"
            )
        return {each.run: each for each in found}

    def run(self, name: str | None = None) -> Run:
        """The named run, by default the first computed one.

        Raises RequestError with the known names, or because there are no poses.
        """
        self.require_poses("a run")
        if name is None:
            computed = [run for run in self.runs.values() if run.key]
            if not computed:
                raise RequestError(f"{self.path}: {self.no_run}")
            return computed[0]
        if name not in self.runs:
            known = ", ".join(self.runs) or "none"
            raise RequestError(f"run {name!r}: not in {self.path} (runs: {known})")
        return self.runs[name]

    @property
    def has_computed_run(self) -> bool:
        """Whether a run has predictions."""
        return any(run.key for run in self.runs.values())

    @property
    def no_run(self) -> str:
        """What to do about a store without a computed run."""
        if self.runs:
            names = ", ".join(self.runs)
            return f"no run is computed ({names}); `s2r precompute {self.path}` computes them"
        model = next(iter(self.models), None)
        if model is None:
            return (
                "no run; train a model (`s2r train`) or add one (`s2r model add`, then `s2r run "
                "add` and `s2r precompute`), or import predictions (`s2r run import`)"
            )
        return (
            f"no run; register one of a model (`s2r run add NAME --model {model}`, then `s2r "
            "precompute`), or import predictions (`s2r run import`)"
        )

    @property
    def missing_run(self) -> str:
        """Why there are no predictions, and what to do; empty where a run is computed."""
        if not self.has_poses:
            return NO_POSES
        return "" if self.has_computed_run else self.no_run

    def displayed_run(self, name: str) -> Run:
        """As `run`; for `NO_RUN` a record of the first domain of each kind, without a model."""
        if name != NO_RUN:
            return self.run(name)
        sim, real = (
            next((d.domain for d in self.domains.values() if d.kind == kind), "") for kind in SIDES
        )
        return Run(NO_RUN, None, sim, real, [], [], None, None, "")

    def run_name(self, name: str | None = None) -> str:
        """The name of a run as `run` finds it; `NO_RUN` where there are no poses and no name.

        `NO_RUN` is itself a name where no run is computed: that of instances without predictions.
        """
        if not name and not self.has_poses:
            return NO_RUN
        return NO_RUN if name == NO_RUN and not self.has_computed_run else self.run(name).run

    def provenance(self, what: str) -> dict[str, str]:
        """Facts about how `what` came to be, such as `dataset` or `model:NAME`."""
        if what not in self._provenance:
            query = "SELECT key, value FROM provenance WHERE what = ? ORDER BY key"
            rows = self.execute(query, [what])
            self._provenance[what] = {printable(key): printable_lines(value) for key, value in rows}
        return dict(self._provenance[what])

    @cached_property
    def checksums(self) -> dict[str, str]:
        """SHA-256 of files by their paths inside the store."""
        return self.provenance(schema.CHECKSUMS)

    def provenance_object(self, what: str, key: str) -> dict[str, Any]:
        """A fact that is a JSON object; empty where it was not recorded. Raises RequestError."""
        text = self.provenance(what).get(key, "{}")
        return parse_object(text, f"{self.path}: provenance of {what}: {key}")

    @cached_property
    def score_report(self) -> dict[str, Any]:
        """The report of `s2r score` with printable texts; empty where none was stored.

        Raises RequestError.
        """
        report: dict[str, Any] = printable_values(self.provenance_object("score", "report"))
        return report

    def rig_offset(self, sim: str, real: str) -> RigOffset | None:
        """Offset of the declared real rig, as calibrated; None where it was not calibrated."""
        noted = self.provenance(f"alignment:{sim}|{real}")
        try:
            if not noted:
                return None
            offset = RigOffset(float(noted["height"]), float(noted["zoom"]))
            if not (abs(offset.height) < 10 and 0.1 < offset.zoom < 10):
                raise ValueError("out of range")
            return offset
        except (KeyError, ValueError) as error:
            message = f"{self.path}: the calibration of {sim} and {real} is invalid"
            raise RequestError(f"{message}; run `s2r precompute` again") from error

    @cached_property
    def _array_records(self) -> dict[str, list[ArrayRecord]]:
        grouped: dict[str, list[ArrayRecord]] = {}
        for record in row_records.arrays(self._index, self._rows("zarr_array")):
            grouped.setdefault(record.run, []).append(record)
        return grouped

    @cached_property
    def array_paths(self) -> frozenset[str]:
        """The paths of all published arrays inside runs.zarr."""
        records = self._array_records.values()
        return frozenset(record.path for listed in records for record in listed)

    def array_parts(self, run: str) -> list[ArrayRecord]:
        """The published arrays of a run, one for each part of the data set that is computed."""
        return list(self._array_records.get(self.run(run).run, ()))

    def array_kinds(self, run: str) -> list[ArrayRecord]:
        """What is published of a run: the first array of each kind, side and mode.

        `array_parts` gives all arrays, one for each part of the data set.
        """
        records: dict[tuple[str, str | None, str | None], ArrayRecord] = {}
        for record in sorted(self.array_parts(run), key=lambda record: record.first_iid):
            records.setdefault((record.kind, record.side, record.mode), record)
        return list(records.values())

"""Check that a store holds every file of its published generation, undamaged.

Every file that can change a figure or an image is compared with a checksum: shards against the
ledger; metadata of arrays, weights, floor plan, drives and files of rows against the index; the
index against `CURRENT.json`; the gap history against the checksums of its blocks. Stores of version
0.1.0 have only some of the checksums: there the structure of arrays and floor plan is checked, with
a note.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from functools import partial
from itertools import product
from pathlib import Path

import duckdb

from s2rstore.arrays import stored_array
from s2rstore.arrays.stored_array import StoredArray
from s2rstore.errors import RequestError, first_line
from s2rstore.files import atomic_writes, layout, safe_files
from s2rstore.files.image_header import floor_plan_bytes
from s2rstore.files.ingest_folder import appending_folders, building_folders
from s2rstore.files.ledger import Ledger
from s2rstore.gap_history import reader
from s2rstore.index import locked_connection, row_files, schema
from s2rstore.metrics.pose_metrics import LOSS_GAMMA
from s2rstore.reader import Store
from s2rstore.records import SIDES, Coverage

_FAILURES = (
    RequestError, duckdb.Error, OSError, ValueError, TypeError, KeyError, AttributeError,
    OverflowError, RecursionError,
)  # fmt: skip
_MAX_NAMED = 3


@dataclass(frozen=True, slots=True)
class Damage:
    """A file or table that is not as published, with a description of the difference."""

    where: str
    what: str


@dataclass(frozen=True, slots=True)
class VerifyReport:
    """The damage in a store, and notes on other things that the user should know."""

    damages: tuple[Damage, ...]
    notes: tuple[str, ...] = ()


def verify(root: Path) -> list[Damage]:
    """The damage in the published generation; an empty list where none was found.

    Raises RequestError where there is no store at all, or none that DuckDB can open.
    """
    return list(check(root).damages)


def check(root: Path) -> VerifyReport:
    """The damage in the published generation, with notes on unfinished and unchecked files.

    Raises RequestError where there is no store at all, or none that DuckDB can open.
    """
    locked_connection.literal_path(root)
    try:
        current = layout.read_current(root)
    except RequestError as error:
        if safe_files.kind(root, layout.CURRENT) is None:
            raise
        return VerifyReport((Damage(layout.CURRENT, str(error)),))
    foreign, notes = list(_foreign_files(root)), list(_leftovers(root))
    try:
        damage = _index_damage(root, current)
        if damage is not None:
            return VerifyReport((*foreign, damage), tuple(notes))
        damaged = _damaged_row_files(root, current)
        with Store(root, left_out=damaged) as store:
            verification = _Verification(root, store, current)
            verification.damages += damaged.values()
            verification.run()
    except _FAILURES as error:
        return VerifyReport((*foreign, Damage(current.index, first_line(error))), tuple(notes))
    return VerifyReport((*foreign, *verification.damages), (*notes, *verification.all_notes()))


def _foreign_files(root: Path) -> Iterator[Damage]:
    """Links, pipes and devices: a store holds files and folders alone."""
    for entry in safe_files.walk(root):
        if entry.kind == "link":
            yield Damage(entry.path, "a symbolic link, which is never followed; remove it")
        elif entry.kind == "other":
            yield Damage(entry.path, "a pipe or a device; remove it")


def _leftovers(root: Path) -> Iterator[str]:
    appending = appending_folders(root)
    for entry in atomic_writes.partial_files(root):
        if any(entry.path.startswith(f"{folder.path.name}/") for folder in appending):
            continue
        yield (
            f"{entry.path}: unfinished; unless something is being written now, a killed write left "
            "it and `s2r prune` removes it"
        )
    for entry in safe_files.names(root, layout.UNITS):
        yield (
            f"{entry.path}: results of a run that is not completely computed; `s2r precompute` "
            "uses them, `s2r prune` removes them"
        )
    for folder in (*building_folders(root), *appending):
        if folder.is_abandoned:
            yield f"{folder.path}: left by an ingest that was killed; `s2r prune` removes it"


def _index_damage(root: Path, current: layout.Current) -> Damage | None:
    try:
        size = safe_files.size(root, current.index)
        if size == current.bytes and safe_files.sha256(root, current.index) == current.sha256:
            return None
    except FileNotFoundError:
        return Damage(current.index, "missing")
    return Damage(current.index, "its size or checksum is not the published one")


def _damaged_row_files(root: Path, current: layout.Current) -> dict[str, Damage]:
    """The listed files of rows that are not as published, by their paths beside the index."""
    index = safe_files.checked_path(root, current.index)
    with locked_connection.connect(index, with_row_files=False) as connection:
        listed = row_files.listed(connection, index)
    damaged = {}
    for file in (file for files in listed.values() for file in files):
        path = f"{layout.INDEX}/{file.path}"
        what = row_files.problem(root, layout.INDEX, file)
        if not what and safe_files.sha256(root, path) != file.sha256:
            what = "its checksum is not the published one"
        if what:
            damaged[file.path] = Damage(path, what)
    return damaged


@dataclass
class _Verification:
    """The checks of an open store; they add to `damages` and `notes`.

    `uncovered` names the kinds of files without a checksum.
    """

    root: Path
    store: Store
    current: layout.Current
    damages: list[Damage] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)
    uncovered: dict[str, None] = field(default_factory=dict)

    def run(self) -> None:
        self._ledger = Ledger(self.root)
        self._entries = self._ledger.by_path()
        for where, check_part in (
            (self.current.index, self._check_tables), (self.current.index, self._check_runs),
            (layout.MODELS, self._check_weights), (layout.TRANSLATORS, self._check_translators),
            (layout.FRAMES, self._check_frames), (layout.RUNS, self._check_arrays),
            (layout.ASSETS, self._check_floor_plan), (layout.DRIVES, self._check_drives),
            (schema.CHECKSUMS, self._check_listed_files), (layout.HISTORY, self._check_history),
            (layout.LEDGER, self._check_ledger_lines),
        ):  # fmt: skip
            try:
                check_part()
            except _FAILURES as error:
                self._add(where, first_line(error))

    def all_notes(self) -> list[str]:
        if not self.uncovered:
            return self.notes
        return [
            f"the store carries no checksums of {', '.join(self.uncovered)} "
            "(version 0.1.0 wrote none); damage in them is found only where it breaks a format",
            *self.notes,
        ]

    def _add(self, where: str, what: str) -> None:
        self.damages.append(Damage(where, what))

    def _check_tables(self) -> None:
        self.damages.extend(_table_damages(self.store, self.current))

    def _check_runs(self) -> None:
        self.damages.extend(_incomplete_runs(self.store))
        self.notes.extend(_uncomputed_parts(self.store))

    def _check_weights(self) -> None:
        """Compare each model's file with the checksum of the index, or else of the ledger."""
        files = {e.path for e in safe_files.names(self.root, layout.MODELS) if e.kind == "file"}
        known = files | self._entries.keys() | self.store.checksums.keys()
        for model in self.store.models.values():
            start = f"{layout.MODELS}/{model.sha256}."
            paths = sorted(path for path in known if path.startswith(start))
            if not paths:
                self.notes.append(f"model {model.model}: no weights in the store")
            for path in paths:
                self._check_weights_file(path, model.sha256)

    def _check_translators(self) -> None:
        """The file of every translator is listed and exists; its content is a listed file's."""
        for record in self.store.translators.values():
            path = f"{layout.TRANSLATORS}/{record.sha256}.safetensors"
            if self.store.checksums.get(path) != record.sha256:
                self._add(path, f"translator {record.translator}: no checksum proves its file")

    def _check_weights_file(self, path: str, sha256: str) -> None:
        expected = self.store.checksums.get(path)
        if expected is not None:
            self._check_file(path, expected, "not the registered weights")
            return
        self.uncovered["weights"] = None
        entries = self._entries.get(path, [])
        if safe_files.kind(self.root, path) is None:
            self._add(path, "missing")
        elif not self._ledger.proves(entries) and (
            entries or safe_files.sha256(self.root, path) != sha256
        ):
            self._add(path, "not the registered weights")

    def _check_file(self, path: str, expected: str, difference: str) -> None:
        """Compare a file with its checksum; links are reported among the foreign files, too."""
        try:
            if safe_files.sha256(self.root, path) != expected:
                self._add(path, difference)
        except FileNotFoundError:
            self._add(path, "missing")
        except (RequestError, OSError) as error:
            self._add(path, first_line(error))

    def _check_frames(self) -> None:
        images = ("rgb", "depth") if self.store.has_poses else ("rgb",)
        imaged = self.store.imaged_trajectories
        pairs = ((domain, name) for domain in imaged for name in sorted(imaged[domain]))
        for names in ((*pair, image) for pair, image in product(pairs, images)):
            relative = "/".join((layout.FRAMES, *names))
            is_covered = f"{relative}/{stored_array.METADATA}" in self.store.checksums
            if not is_covered:
                self.uncovered["the metadata of frames"] = None
            self._check_array(relative, partial(self.store.frames_array, *names), is_covered)

    def _check_arrays(self) -> None:
        for run in self.store.runs:
            for record in self.store.array_parts(run):
                is_covered = record.metadata_sha256 is not None
                if not is_covered:
                    self.uncovered["the metadata of computed arrays"] = None
                relative = f"{layout.RUNS}/{record.path}"
                self._check_array(relative, partial(self.store.stored, record), is_covered)

    def _check_array(
        self, relative: str, open_array: Callable[[], StoredArray], is_covered: bool
    ) -> None:
        """Every shard must have an intact entry in the ledger."""
        try:
            array = open_array()
        except _FAILURES as error:
            self._add(relative, first_line(error))
            return
        for shard in range(array.layout.shards):
            path, rows = array.file(shard), array.rows_in(shard)
            entries = self._entries.get(path)
            if safe_files.kind(self.root, path) is None:
                self._add(path, "missing")
            elif entries is None:
                self._add(path, "no ledger entry proves it")
            elif not self._ledger.proves(entries):
                self._add(path, "its checksum is not the ledger's")
            elif not any(entry.count == rows for entry in entries):
                self._add(path, f"the ledger counts {entries[0].count} rows, not {rows}")
            elif not is_covered:
                try:
                    array.check(shard)
                except RequestError as error:
                    self._add(path, first_line(error))

    def _check_floor_plan(self) -> None:
        """Check the format of a floor plan that has no checksum."""
        name = self.store.dataset.floor_plan
        if name is None or name in self.store.checksums:
            return
        self.uncovered["the floor plan"] = None
        path = safe_files.checked_path(self.root, name)
        if not path.exists():
            self._add(name, "the floor plan is missing")
            return
        try:
            floor_plan_bytes(path)
        except RequestError as error:
            self._add(name, str(error))

    def _check_drives(self) -> None:
        """Note the drives that no checksum covers; the others are checked as listed files."""
        files = [e.path for e in safe_files.walk(self.root, layout.DRIVES) if e.kind == "file"]
        unlisted = [path for path in files if path not in self.store.checksums]
        if unlisted and len(unlisted) == len(files):
            self.uncovered["drives"] = None
        elif unlisted:
            more = len(unlisted) - _MAX_NAMED
            listed = ", ".join(unlisted[:_MAX_NAMED]) + (f" and {more} more" if more > 0 else "")
            self.notes.append(f"{listed}: added later, no checksum covers it")

    def _check_listed_files(self) -> None:
        """Check the files whose checksums the index lists and that no other check reads."""
        for path, expected in self.store.checksums.items():
            if not path.startswith((f"{layout.FRAMES}/", f"{layout.MODELS}/")):
                self._check_file(path, expected, "its checksum is not the published one")

    def _check_history(self) -> None:
        path = reader.history_path(self.root)
        relative = path.relative_to(self.root)
        if safe_files.kind(self.root, relative) is not None:
            try:
                reader.check(path)
            except RequestError as error:
                self._add(relative.as_posix(), first_line(error))

    def _check_ledger_lines(self) -> None:
        count = self._ledger.unreadable_lines()
        if count:
            lines = "1 line" if count == 1 else f"{count} lines"
            self.notes.append(
                f"{layout.LEDGER}: {lines} cannot be read (cut by a killed write, or damaged); "
                "they prove nothing"
            )


_POSE_RULE = (
    "instance",
    "pose is NULL or not finite",
    "x IS NULL OR y IS NULL OR heading IS NULL OR "
    "NOT isfinite(x) OR NOT isfinite(y) OR NOT isfinite(heading)",
)
_IMAGE_RULES = (
    (
        "instance",
        "a pose in a data set without poses",
        "x IS NOT NULL OR y IS NOT NULL OR heading IS NOT NULL OR room IS NOT NULL",
    ),
    ("instance", "no image in any domain", "iid NOT IN (SELECT iid FROM frame)"),
    ("frame", "no such instance", "iid NOT IN (SELECT iid FROM instance)"),
    ("frame", "domain without a row in domain", "domain NOT IN (SELECT domain FROM domain)"),
    ("run", "a run in a data set without poses", "true"),
)
"""Rules of a data set without poses, in place of `_POSE_RULE`."""
_PARTLY_IMAGED = """
    SELECT count(*) FROM (
        SELECT domain, trajectory, count(DISTINCT iid) AS imaged, count(*) AS n
        FROM frame JOIN instance USING (iid) GROUP BY domain, trajectory) f
    JOIN trajectory t USING (trajectory) WHERE imaged <> t.instances OR n <> t.instances
"""
_RULES = (
    (
        "prediction",
        "a NaN where NULL belongs",
        "isnan(x) OR isnan(y) OR isnan(heading) OR "
        "isnan(error) OR isnan(heading_error) OR isnan(loss) OR isnan(accuracy)",
    ),
    (
        "instance",
        "room without a row in room",
        "room IS NOT NULL AND room NOT IN (SELECT room FROM room)",
    ),
    (
        "run",
        "domain without a row in domain",
        "sim_domain NOT IN (SELECT domain FROM domain) "
        "OR real_domain NOT IN (SELECT domain FROM domain)",
    ),
    ("prediction", "no such instance", "iid NOT IN (SELECT iid FROM instance)"),
    (
        "prediction",
        "unknown side or split",
        "side NOT IN ('sim', 'real') OR split NOT IN ('train', 'validation', 'test', 'unseen')",
    ),
    ("prediction", "run without a row in run", "run NOT IN (SELECT run FROM run)"),
    ("run", "model without a row in model", "model NOT IN (SELECT model FROM model)"),
    *(
        (
            name,
            "duplicate name",
            f"{name} IN (SELECT {name} FROM {name} GROUP BY 1 HAVING count(*) > 1)",
        )
        for name in ("run", "model")
    ),
)

# Readers find an instance's row in the frames of its trajectory by this order.
_ORDER = """
    SELECT count(*) FROM (
        SELECT trajectory, count(*) AS n, max(iid) - min(iid) + 1 AS span,
               min(seq) AS first, max(seq) AS last, count(DISTINCT seq) AS seqs
        FROM instance GROUP BY trajectory) i
    LEFT JOIN trajectory t USING (trajectory)
    WHERE t.instances IS DISTINCT FROM n OR span <> n OR first < 0 OR seqs <> n
"""

_OUTLIER_RULE = ("prediction", "outlier is no distance", "isnan(outlier) OR outlier < 0")

_FORMULAS = (
    ("error is not the distance to the truth", "error", "sqrt(dx * dx + dy * dy)"),
    (
        "loss is not that of its errors",
        "loss",
        f"{1 - LOSS_GAMMA} * error * error + {LOSS_GAMMA} * turn",
    ),
    ("accuracy is not that of its error", "accuracy", "greatest(0, 1 - error / scale)"),
)
_TOLERANCE = 1e-9
"""Relative; absolute for figures below 1."""
_FIGURES = """WITH figures AS (
    SELECT p.error, p.loss, p.accuracy, p.rank, p.heading_error AS turn,
           p.x - i.x AS dx, p.y - i.y AS dy, (SELECT accuracy_scale FROM dataset) AS scale,
           CASE WHEN p.error IS NOT NULL THEN row_number() OVER (
               PARTITION BY p.side ORDER BY p.error NULLS LAST, p.iid) END AS place
    FROM prediction p JOIN instance i USING (iid) WHERE p.run = ?)
    SELECT """


def _table_damages(store: Store, current: layout.Current) -> Iterator[Damage]:
    rules = [*((_POSE_RULE,) if store.has_poses else _IMAGE_RULES), *_RULES]
    if "outlier" not in store.missing_columns("prediction"):
        rules.append(_OUTLIER_RULE)
    for name, what, condition in rules:
        count = store.execute(f'SELECT count(*) FROM "{name}" WHERE {condition}')[0][0]
        if count:
            yield Damage(f"table {name}", f"{count} rows: {what}")
    total, least, most, distinct = store.execute(
        "SELECT count(*), min(iid), max(iid), count(DISTINCT iid) FROM instance"
    )[0]
    if total and (least, most, distinct) != (0, total - 1, total):
        yield Damage("table instance", f"iid is not 0 .. {total - 1}, each once")
    (unordered,) = store.execute(_ORDER)[0]
    if unordered:
        yield Damage("table instance", f"{unordered} trajectories: not the stated rows in order")
    if not store.has_poses and (count := store.execute(_PARTLY_IMAGED)[0][0]):
        yield Damage("table frame", f"{count} trajectories: a domain images a part of them")
    stated = sum(trajectory.instances for trajectory in store.trajectories)
    if stated != total:
        yield Damage("table trajectory", f"states {stated} instances, there are {total}")
    comparisons = [
        *((what, _differs(name, formula)) for what, name, formula in _FORMULAS),
        ("rank is not that of its error", "rank IS DISTINCT FROM place"),
    ]
    counts = ", ".join(f"count(*) FILTER ({condition})" for _, condition in comparisons)
    for run in store.runs:  # one at a time: ranks of all runs would not fit into DuckDB's memory
        row = store.execute(f"{_FIGURES} {counts} FROM figures", [run])[0]
        for count, (what, _) in zip(row, comparisons, strict=True):
            if count:
                yield Damage("table prediction", f"run {run}: {count} rows: {what}")
    if store.dataset.hash != current.dataset_hash:
        yield Damage(layout.CURRENT, "names another data set than the index")
    for table in schema.TABLES:
        if table.optional and not store.has_table(table.name):
            continue
        missing = store.missing_columns(table.name)
        names = ", ".join(name for name in table.column_names if name not in missing)
        store.execute(f'SELECT {names} FROM "{table.name}" LIMIT 0')


def _differs(name: str, formula: str) -> str:
    """The condition that a figure and its formula differ; NULL where one of them is NULL."""
    near = f"abs({name} - ({formula})) <= {_TOLERANCE} * greatest(1, abs({formula}))"
    return f"NOT ({name} = ({formula}) OR {near})"


def _incomplete_runs(store: Store) -> Iterator[Damage]:
    """Every computed run has one prediction per side and instance of each part it covers.

    It covers the first part, and some or all of those that were appended later.
    """
    query = """
        SELECT run, side, first, count(DISTINCT iid) FROM prediction
        ASOF JOIN (SELECT unnest(?::INTEGER[]) AS first) ON iid >= first GROUP BY ALL
    """
    rows = store.execute(query, [[part.first_iid for part in store.parts]])
    counts = {tuple(key): count for *key, count in rows}
    for part in store.parts:
        for name, run in store.runs.items():
            sides = [(name, side, part.first_iid) for side in SIDES] if run.key else []
            found = [counts.get(key, 0) for key in sides]
            if part.part > 0 and not any(found):
                continue
            for (_, side, _), count in zip(sides, found, strict=True):
                if count != part.instances:
                    what = f"run {name}: {count} of {part.instances} {side} rows"
                    yield Damage("table prediction", what)


def _uncomputed_parts(store: Store) -> Iterator[str]:
    """Notes on runs that are not computed for instances that were appended."""
    if len(store.parts) == 1:
        return
    query = "SELECT run, count(DISTINCT iid) FROM prediction GROUP BY run"
    counts = dict(store.execute(query))
    total = len(store.instances)
    for name, run in store.runs.items():
        if note := Coverage(name, counts.get(name, 0), total).note if run.key else "":
            yield note
        rows: dict[str, int] = {}
        for record in store.array_parts(name):
            if record.axes[:1] == ("iid",) and record.kind != "prediction":
                label = " ".join(filter(None, (record.kind, record.mode, record.side)))
                rows[label] = rows.get(label, 0) + record.shape[0]
        partial = [label for label, count in rows.items() if count < counts.get(name, 0)]
        if partial:
            yield f"run {name}: computed for some instances only: {', '.join(sorted(partial))}"

"""Check that a store holds every file of its published generation, undamaged.

Every file that can change a figure or an image is compared with a checksum: shards against the
ledger; metadata of arrays, weights, floor plan, drives and files of rows against the index; the
index against `CURRENT.json`; the gap history against the checksums of its lines.
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
from s2rstore.dataset_reader import SOURCE_IMAGES
from s2rstore.errors import RequestError, counted, first_line
from s2rstore.files import atomic_writes, layout, safe_files
from s2rstore.files.ingest_folder import append_staging_folders, staging_folders
from s2rstore.files.ledger import LedgerReader
from s2rstore.files.store_files import LocalFiles, StoreFiles
from s2rstore.gap_history import reader
from s2rstore.index import locked_connection, row_files, schema
from s2rstore.maintenance.table_rules import (
    Damage,
    incomplete_runs,
    table_damages,
    uncomputed_parts,
)
from s2rstore.reader import Store
from s2rstore.remote.open_files import open_files

_FAILURES = (
    RequestError, duckdb.Error, OSError, ValueError, TypeError, KeyError, AttributeError,
    OverflowError, RecursionError,
)  # fmt: skip
_MAX_NAMED = 3


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


def check(path: str | Path) -> VerifyReport:
    """The damage in the published generation, with notes on unfinished and unchecked files.

    `path` is a folder or a URL. Raises RequestError where there is no store at all, or none that
    DuckDB can open, UnreachableStoreError where a server does not give a file.
    """
    files = open_files(path)
    try:
        current = layout.current_of(files)
    except RequestError as error:
        if files.kind(layout.CURRENT) is None:
            raise
        return VerifyReport((Damage(layout.CURRENT, str(error)),))
    foreign, notes = list(_foreign_files(files)), list(_leftovers(files))
    try:
        damage = _index_damage(files, current)
        if damage is not None:
            return VerifyReport((*foreign, damage), tuple(notes))
        damaged = _damaged_row_files(files, current)
        with Store(files, left_out=damaged) as store:
            verification = _Verification(files, store, current)
            verification.damages += damaged.values()
            verification.run()
    except _FAILURES as error:
        return VerifyReport((*foreign, Damage(current.index, first_line(error))), tuple(notes))
    return VerifyReport((*foreign, *verification.damages), (*notes, *verification.all_notes()))


def _foreign_files(files: StoreFiles) -> Iterator[Damage]:
    """Links, pipes and devices: a store holds files and folders alone. A server has only files."""
    for entry in () if files.is_remote else files.walk():
        if entry.kind == "link":
            yield Damage(entry.path, "a symbolic link, which is never followed; remove it")
        elif entry.kind == "other":
            yield Damage(entry.path, "a pipe or a device; remove it")


def _leftovers(files: StoreFiles) -> Iterator[str]:
    """Notes on what unfinished commands have left, which happens in folders only."""
    if files.is_remote:
        return
    root = files.path
    appending = append_staging_folders(root)
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
    for folder in (*staging_folders(root), *appending):
        if folder.is_abandoned:
            yield f"{folder.path}: left by an ingest that was killed; `s2r prune` removes it"


def _index_damage(files: StoreFiles, current: layout.Current) -> Damage | None:
    try:
        size = files.size(current.index)
        if size == current.bytes and files.sha256(current.index) == current.sha256:
            return None
    except FileNotFoundError:
        return Damage(current.index, "missing")
    return Damage(current.index, "its size or checksum is not the published one")


def _damaged_row_files(files: StoreFiles, current: layout.Current) -> dict[str, Damage]:
    """The listed files of rows that are not as published, by their paths beside the index."""
    index = files.index_file(current.index, current.sha256, current.bytes)
    with locked_connection.connect(index, with_row_files=False) as connection:
        listed = row_files.listed(connection, index)
    damaged = {}
    for file in (file for files in listed.values() for file in files):
        path = f"{layout.INDEX}/{file.path}"
        what = row_files.problem(files, layout.INDEX, file)
        if not what and files.sha256(path) != file.sha256:
            what = "its checksum is not the published one"
        if what:
            damaged[file.path] = Damage(path, what)
    return damaged


@dataclass
class _Verification:
    """The checks of an open store; they add to `damages` and `notes`.

    `uncompared` counts the shards whose checksum is not known because the server lists no files.
    """

    files: StoreFiles
    store: Store
    current: layout.Current
    damages: list[Damage] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)
    uncompared: int = 0

    def run(self) -> None:
        self._ledger = LedgerReader(self.files)
        self._entries = self._ledger.by_path()
        for where, check_part in (
            (self.current.index, self._check_tables), (self.current.index, self._check_runs),
            (layout.MODELS, self._check_weights), (layout.TRANSLATORS, self._check_translators),
            (layout.FRAMES, self._check_frames), (layout.RUNS, self._check_arrays),
            (layout.ASSETS, self._check_floor_plan), (layout.DRIVES, self._check_drives),
            (schema.CHECKSUMS, self._check_listed_files), (layout.HISTORY, self._check_history),
            (layout.LEDGER, self._check_ledger_lines),
            (schema.CONVENTIONS, self._note_conventions),
        ):  # fmt: skip
            try:
                check_part()
            except _FAILURES as error:
                self._add(where, first_line(error))

    def all_notes(self) -> list[str]:
        notes = list(self.notes)
        if self.uncompared:
            notes.insert(
                0,
                f"the server lists no files, so the checksums of {self.uncompared} shards are not "
                "known; damage in them is found only where it breaks a format. `s2r push` writes "
                "a list",
            )
        return notes

    def _add(self, where: str, what: str) -> None:
        self.damages.append(Damage(where, what))

    def _check_tables(self) -> None:
        self.damages.extend(table_damages(self.store, self.current))

    def _check_runs(self) -> None:
        self.damages.extend(incomplete_runs(self.store))
        self.notes.extend(uncomputed_parts(self.store))

    def _check_weights(self) -> None:
        """Compare each model's file with the checksum of the index."""
        files = {e.path for e in self.files.names(layout.MODELS) if e.kind == "file"}
        known = files | self.store.checksums.keys()
        for model in self.store.models.values():
            start = f"{layout.MODELS}/{model.sha256}."
            paths = sorted(path for path in known if path.startswith(start))
            if not paths:
                self.notes.append(f"model {model.model}: no weights in the store")
            for path in paths:
                self._check_file(path, "not the registered weights")

    def _check_translators(self) -> None:
        """The file of every translator is listed and exists; its content is a listed file's."""
        for record in self.store.translators.values():
            path = f"{layout.TRANSLATORS}/{record.sha256}.safetensors"
            if self.store.checksums.get(path) != record.sha256:
                self._add(path, f"translator {record.translator}: no checksum proves its file")

    def _check_file(self, path: str, difference: str) -> None:
        """Compare a file with its checksum; links are reported among the foreign files, too."""
        expected = self.store.checksums.get(path)
        try:
            if expected is None:
                self._add(path, "no checksum proves it")
            elif self.files.sha256(path) != expected:
                self._add(path, difference)
        except FileNotFoundError:
            self._add(path, "missing")
        except (RequestError, OSError) as error:
            self._add(path, first_line(error))

    def _check_frames(self) -> None:
        imaged = self.store.imaged_parts
        for domain, part in product(imaged, self.store.trajectory_parts):
            if part not in imaged[domain]:
                continue
            for image in ("rgb", "depth") if self.store.domain(domain).has_depth else ("rgb",):
                relative = f"{layout.FRAMES}/{domain}/{part.folder}/{image}"
                self._check_array(relative, partial(self.store.frames_array, domain, part, image))
            if folder := self.store.labels_folder(domain, part):
                self._check_array(folder, partial(self.store.labels_array, part, folder))
            for image, array in SOURCE_IMAGES.items():
                relative = f"{layout.FRAMES}/{domain}/{part.folder}/{array}"
                if f"{relative}/{stored_array.METADATA}" in self.store.checksums:
                    open_array = partial(self.store.source_array, domain, part, image)
                    self._check_array(relative, open_array)

    def _check_arrays(self) -> None:
        """Check every array once; several runs may list one."""
        checked: set[str] = set()
        for run in self.store.runs:
            for record in self.store.array_parts(run):
                if record.path in checked:
                    continue
                checked.add(record.path)
                relative = f"{layout.RUNS}/{record.path}"
                self._check_array(relative, partial(self.store.stored, record))

    def _check_array(self, relative: str, open_array: Callable[[], StoredArray]) -> None:
        """Every shard must have an intact entry in the ledger."""
        try:
            array = open_array()
        except _FAILURES as error:
            reason = first_line(error).removesuffix("; run `s2r verify`")
            self._add(relative, f"{reason}; {self._cure(relative)}")
            return
        for shard in range(array.layout.shards):
            path, rows = array.file(shard), array.rows_in(shard)
            entries = self._entries.get(path)
            if self.files.kind(path) is None:
                self._add(path, f"missing; {self._cure(path)}")
            elif entries is None and not self.files.lists_files:
                self.uncompared += 1
                self._check_structure(array, shard)
            elif entries is None:
                self._add(path, "no ledger entry proves it")
            elif not self._ledger.proves(entries):
                self._add(
                    path, f"its checksum is not the ledger's; remove it, and {self._cure(path)}"
                )
            elif not any(entry.count == rows for entry in entries):
                self._add(path, f"the ledger counts {entries[0].count} rows, not {rows}")

    def _cure(self, path: str) -> str:
        """How a missing array, or a missing file of one, is replaced."""
        if not isinstance(self.files, LocalFiles):
            return "push the store again"
        if path.startswith(f"{layout.RUNS}/"):
            return "run `s2r precompute`"
        return "restore it from a copy of the store, or ingest again"

    def _check_structure(self, array: StoredArray, shard: int) -> None:
        try:
            array.check(shard)
        except RequestError as error:
            self._add(array.file(shard), first_line(error))

    def _check_floor_plan(self) -> None:
        """The floor plan has a checksum, by which it is compared among the listed files."""
        name = self.store.dataset.floor_plan
        if name is not None and name not in self.store.checksums:
            self._add(name, "no checksum proves the floor plan")

    def _note_conventions(self) -> None:
        """Note the domains whose conventions the ingest found doubtful."""
        names = {domain: domain for domain in self.store.domains} | {
            f"{domain}@{part.part}": f"{domain}, instances from iid {part.first_iid} on"
            for domain in self.store.domains
            for part in self.store.parts[1:]
        }
        for key, name in names.items():
            check = self.store.provenance_object(schema.CONVENTIONS, key)
            if check.get("verdict") == "doubtful":
                picture = f"; see {check['picture']}" if "picture" in check else ""
                self.notes.append(
                    f"domain {name}: depth is sharper on the floor with other conventions than "
                    f"declared{picture}"
                )

    def _check_drives(self) -> None:
        """Note the drives that no checksum covers; the others are checked as listed files."""
        files = [e.path for e in self.files.walk(layout.DRIVES) if e.kind == "file"]
        unlisted = [path for path in files if path not in self.store.checksums]
        if unlisted:
            more = len(unlisted) - _MAX_NAMED
            listed = ", ".join(unlisted[:_MAX_NAMED]) + (f" and {more} more" if more > 0 else "")
            self.notes.append(f"{listed}: added later, no checksum covers it")

    def _check_listed_files(self) -> None:
        """Check the files whose checksums the index lists and that no other check reads."""
        for path in self.store.checksums:
            if not path.startswith((f"{layout.FRAMES}/", f"{layout.MODELS}/")):
                self._check_file(path, "its checksum is not the published one")

    def _check_history(self) -> None:
        if self.files.kind(layout.GAP_HISTORY) is not None:
            try:
                reader.read(self.files.local_file(layout.GAP_HISTORY))
            except RequestError as error:
                self._add(layout.GAP_HISTORY, first_line(error))

    def _check_ledger_lines(self) -> None:
        count = self._ledger.unreadable_lines()
        if count:
            lines = counted(count, "line")
            self.notes.append(
                f"{layout.LEDGER}: {lines} cannot be read (cut by a killed write, or damaged); "
                "they prove nothing"
            )

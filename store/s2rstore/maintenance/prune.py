"""Remove the files that no remaining generation needs, and those that killed writes have left.

Outside the store, only folders are removed that an interrupted `s2r ingest` has left beside it.
Links are neither followed nor removed, but reported.
"""

from __future__ import annotations

import re
import shutil
from collections.abc import Collection, Iterator
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path

import duckdb

from s2rstore.errors import RequestError
from s2rstore.files import atomic_writes, layout, locks, safe_files
from s2rstore.files.ingest_folder import append_staging_folders, staging_folders
from s2rstore.files.ledger import Ledger
from s2rstore.files.safe_files import FolderEntry
from s2rstore.index import locked_connection, row_files, schema
from s2rstore.index.trajectory_parts import trajectory_parts

_IN_HISTORY = re.compile(rf"{layout.HISTORY}/\.(?P<name>[^/]*\.jsonl)(\.lock)?\.[^/]+\.partial")
"""An unfinished file of a gap history or its lock, with the name of the history's file."""
_ROWS = f"{layout.INDEX}/{row_files.FOLDER}"
KEPT = 3
"""How many of the newest generations stay where no other number is given."""


@dataclass(frozen=True, slots=True)
class PruneResult:
    """The removed paths inside the store, and how many bytes that freed.

    `links` are symbolic links, which are left alone, as are their targets.
    """

    paths: tuple[str, ...]
    bytes: int
    links: tuple[str, ...] = ()


def prune(root: Path, keep: int = KEPT, dry_run: bool = False) -> PruneResult:
    """Keep the newest `keep` generations and what they reference; remove the rest.

    Takes the compute lock and the publish lock, so that no half-written file is removed. Where
    there is no store, only the folders that an interrupted ingest has left beside it are removed.
    Raises StoreBusyError while a precompute runs, RequestError for a store that another release
    wrote or whose published index is missing.
    """
    beside = [folder.path for folder in staging_folders(root) if folder.is_abandoned]
    if beside and not root.exists():
        return _with_beside(PruneResult((), 0), beside, dry_run)
    layout.read_current(root)
    with (
        locks.compute_lock(root) as computing,
        locks.publish_lock(root) as publishing,
        _locked_histories(root) as histories,
    ):
        current = layout.read_current(root)
        if current.schema != schema.VERSION:
            raise RequestError(f"{root}: schema {current.schema}; prune it with its own release")
        path = safe_files.checked_path(root, current.index)
        if safe_files.kind(root, current.index) is None:
            raise RequestError(f"{path}: the published index is missing")
        if safe_files.sha256(root, current.index) != current.sha256:
            raise RequestError(f"{path}: not what was published; run `s2r verify`, and restore it")
        indexes = _indexes(root)
        needed = _newest(indexes, current, keep)
        removed = [path for number, path in indexes if number not in needed]
        removed += _unreferenced(root, [path for number, path in indexes if number in needed])
        appending = {
            folder.path.name: folder.is_abandoned for folder in append_staging_folders(root)
        }
        removed += [path for path, is_abandoned in appending.items() if is_abandoned]
        unfinished = [
            path for path in _unfinished(root, histories) if not _is_in(path, [*appending])
        ]
        removed += [path for path in unfinished if not _is_in(path, removed)]
        files = {path: _files_below(root, path) for path in removed}
        size = sum(entry.bytes for entries in files.values() for entry in entries)
        links = tuple(entry.path for entry in safe_files.walk(root) if entry.kind == "link")
        if not dry_run:
            computing.check()
            publishing.check()
            _remove(root, files)
    return _with_beside(PruneResult(tuple(removed), size, links), beside, dry_run)


def remove_superseded(root: Path, generations: Collection[int]) -> None:
    """Remove those of some generations that are not among the newest `KEPT` of the store.

    Stores that have one of them open can be read all the same: only indexes are removed, which are
    open; files of rows and arrays stay until `prune`. Writers use the newest one alone.
    """
    indexes = _indexes(root)
    kept = _newest(indexes, layout.read_current(root), KEPT)
    for number, path in indexes:
        if number in generations and number not in kept:
            atomic_writes.remove(root, path)


def _newest(indexes: list[tuple[int, str]], current: layout.Current, keep: int) -> list[int]:
    """The newest `keep` of the published generations, one at least."""
    published = sorted({number for number, _ in indexes if number <= current.generation})
    return published[-max(1, keep) :]


def _indexes(root: Path) -> list[tuple[int, str]]:
    """The generations whose index exists, oldest first, with its path.

    Raises RequestError for one that is not a regular file: files that it references must stay.
    """
    paths = []
    for entry in safe_files.names(root, layout.INDEX):
        number = layout.generation_of(Path(entry.path))
        if number is not None:
            safe_files.checked_path(root, entry.path)
            paths.append((number, entry.path))
    return sorted(paths)


def _entries(root: Path, folder: str, kind: safe_files.Kind) -> list[FolderEntry]:
    """The files or the folders in a folder; none where it is missing or no folder."""
    if safe_files.kind(root, folder) != "folder":
        return []
    return [entry for entry in safe_files.names(root, folder) if entry.kind == kind]


def _unreferenced(root: Path, indexes: list[str]) -> list[str]:
    frames: set[str] = set()
    labels: set[str] = set()
    arrays: set[str] = set()
    weights: set[str] = set()
    translators: set[str] = set()
    rows: set[str] = set()
    for index in indexes:
        path = safe_files.checked_path(root, index)
        with locked_connection.connect(path, with_row_files=False) as connection:
            for files in row_files.listed(connection, path).values():
                rows.update(f"{layout.INDEX}/{file.path}" for file in files)
            for query, values in (
                ("SELECT path FROM zarr_array", arrays), ("SELECT sha256 FROM model", weights),
            ):  # fmt: skip
                values.update(row[0] for row in connection.execute(query).fetchall())
            frames |= frame_folders(connection)
            labels |= _label_arrays(connection)
            translators |= _used_translators(connection)
    used = {f"{layout.RUNS}/{'/'.join(path.split('/')[:2])}" for path in arrays}
    unused = [
        key.path
        for run in _entries(root, layout.RUNS, "folder")
        for key in _entries(root, run.path, "folder")
        if key.path not in used
    ]
    unused += [
        folder.path
        for domain in _entries(root, layout.FRAMES, "folder")
        for folder in _entries(root, domain.path, "folder")
        if folder.path not in frames
    ]
    unused += [
        array.path
        for folder in frames
        for array in _entries(root, folder, "folder")
        if array.name.startswith(layout.LABEL_IMAGES) and array.path not in labels
    ]
    unused += [
        entry.path
        for entry in safe_files.walk(root, _ROWS)
        if entry.kind == "file" and entry.path not in rows
    ]
    models = _entries(root, layout.MODELS, "file")
    unused += [entry.path for entry in models if entry.name.split(".")[0] not in weights]
    unused += [entry.path for entry in _entries(root, layout.UNITS, "folder")]
    fitted = _entries(root, layout.TRANSLATORS, "file")
    return unused + [entry.path for entry in fitted if entry.name.split(".")[0] not in translators]


def frame_folders(connection: duckdb.DuckDBPyConnection) -> set[str]:
    """The folders in which the frames of an index may lie.

    There is one for each domain and trajectory, and one for each later part of a trajectory.
    """
    parts = trajectory_parts(lambda query: connection.execute(query).fetchall())
    rows = connection.execute("SELECT trajectory FROM trajectory").fetchall()
    folders = {row[0] for row in rows} | {part.folder for part in parts}
    domains = connection.execute("SELECT domain FROM domain").fetchall()
    return {f"{layout.FRAMES}/{domain}/{folder}" for (domain,) in domains for folder in folders}


def _label_arrays(connection: duckdb.DuckDBPyConnection) -> set[str]:
    """The folders of the label images that an index lists."""
    query = "SELECT key FROM provenance WHERE what = ?"
    listed = connection.execute(query, [schema.CHECKSUMS]).fetchall()
    return {str(Path(path).parent) for (path,) in listed if f"/{layout.LABEL_IMAGES}" in path}


def _used_translators(connection: duckdb.DuckDBPyConnection) -> set[str]:
    """Hashes of the translators that are listed, or that a run applies."""
    query = (
        "SELECT unnest(regexp_extract_all(sim_adjustments || real_adjustments, "
        '\'"sha256":"([0-9a-f]{64})"\', 1)) FROM run'
    )
    used = {row[0] for row in connection.execute(query).fetchall()}
    return used | {row[0] for row in connection.execute("SELECT sha256 FROM translator").fetchall()}


@contextmanager
def _locked_histories(root: Path) -> Iterator[set[str]]:
    """Hold the locks of the gap histories with unfinished files; yield the names of their files.

    A history whose lock another process holds is left out: its files may be in use.
    """
    entries = atomic_writes.partial_files(root)
    named = {match["name"] for e in entries if (match := _IN_HISTORY.fullmatch(e.path))}
    locked = set()
    with ExitStack() as stack:
        for name in sorted(named):
            with suppress(RequestError):
                stack.enter_context(locks.file_lock(root / layout.HISTORY / name, timeout=0.0))
                locked.add(name)
        yield locked


def _unfinished(root: Path, histories: set[str]) -> list[str]:
    """Files that killed writes have left: all, as far as this process holds the locks."""
    paths = []
    for entry in atomic_writes.partial_files(root):
        of_history = _IN_HISTORY.fullmatch(entry.path)
        is_elsewhere = not entry.path.startswith(f"{layout.HISTORY}/")
        if of_history["name"] in histories if of_history else is_elsewhere:
            paths.append(entry.path)
    return paths


def _is_in(path: str, removed: list[str]) -> bool:
    return any(path == other or path.startswith(f"{other}/") for other in removed)


def _files_below(root: Path, path: str) -> list[FolderEntry]:
    """The files at and below a path."""
    if safe_files.kind(root, path) == "folder":
        return [entry for entry in safe_files.walk(root, path) if entry.kind == "file"]
    return [FolderEntry(path, "file", safe_files.size(root, path))]


def _remove(root: Path, files: dict[str, list[FolderEntry]]) -> None:
    for path in files:
        atomic_writes.remove(root, path)
    Ledger(root).remove_entries({entry.path for entries in files.values() for entry in entries})
    tables = _entries(root, _ROWS, "folder")
    of_runs = [run for table in tables for run in _entries(root, table.path, "folder")]
    for folder in (*_entries(root, layout.RUNS, "folder"), *of_runs):
        if not safe_files.names(root, folder.path):
            atomic_writes.remove(root, folder.path)


def _with_beside(pruned: PruneResult, folders: list[Path], dry_run: bool) -> PruneResult:
    """With the folders that interrupted ingests have left beside the store."""
    size = sum(entry.bytes for folder in folders for entry in safe_files.walk(folder))
    if not dry_run:
        for folder in folders:
            shutil.rmtree(folder, ignore_errors=True)
    paths = (*pruned.paths, *(f"../{folder.name}" for folder in folders))
    return PruneResult(paths, pruned.bytes + size, pruned.links)

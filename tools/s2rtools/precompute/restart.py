"""Begin arrays again that are incomplete, as for another machine or other libraries."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from s2rstore.errors import RequestError
from s2rstore.files import atomic_writes, layout, locks, safe_files
from s2rstore.files.ledger import Ledger
from s2rstore.index.transaction import edit
from s2rstore.reader import Store
from s2rtools.precompute import unit_results
from s2rtools.precompute.publish_results import ARRAY_FACTS
from s2rtools.precompute.work_units import ArraySpec, Stage


def discard_incomplete(store: Store, stages: Sequence[Stage], check: Callable[[], None]) -> None:
    """Remove what is incomplete of some stages: all arrays of each key, and results of units.

    An array is complete if it is published and no file of it is missing. Keys that were published
    lose their provenance in all runs, so that it is recorded again; readers miss these arrays until
    they are computed. `check` is called before anything is removed or published, see `edit`. Raises
    OSError where a file can neither be found nor is missing.
    """
    root, folders = store.path, set[str]()
    check()
    for stage in stages:
        atomic_writes.remove(root, unit_results.folder(stage))
        for spec in stage.specs:
            if not is_complete(store, stage.run, spec):
                folders.add(spec.folder(stage.run))
    _forget_provenance(store, folders, check)
    ledger, removed = Ledger(root), set[str]()
    for folder in folders:
        check()
        removed |= ledger.array_entries(folder).keys()
        path = f"{layout.RUNS}/{folder}"
        if safe_files.kind(root, path) is not None:
            removed |= {entry.path for entry in safe_files.walk(root, path)}
            atomic_writes.remove(root, path)
    if removed:
        with locks.publish_lock(root) as publishing:  # appends and registrations add lines under it
            check()
            publishing.check()
            ledger.remove_entries(removed)


def is_complete(store: Store, run: str, spec: ArraySpec) -> bool:
    """Whether an array is published and has all files. OSError where they cannot be examined."""
    if spec.path(run) not in store.array_paths:
        return False
    try:
        array = spec.open_array(store.path, run)
        for number in range(array.layout.shards):
            safe_files.size(store.path, array.file(number))
    except FileNotFoundError:
        return False
    except RequestError as error:  # of the metadata
        cause = error.__cause__
        if isinstance(cause, OSError) and not isinstance(cause, FileNotFoundError):
            raise
        return False
    return True


def _forget_provenance(store: Store, folders: set[str], check: Callable[[], None]) -> None:
    """Remove what the provenance of runs says of the arrays in some folders of runs.zarr."""
    changed = {}
    for run in store.runs:
        facts = store.provenance_object(f"run:{run}", ARRAY_FACTS)
        kept = {
            key: value
            for key, value in facts.items()
            if folders.isdisjoint({f"{run}/{key}", f"{layout.SHARED_ARRAYS}/{key}"})
        }
        if kept != facts:
            changed[run] = kept
    if changed:
        with edit(store.path, check) as draft:
            for run, facts in changed.items():
                draft.set_provenance(f"run:{run}", {ARRAY_FACTS: facts})

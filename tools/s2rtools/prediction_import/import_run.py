"""Publish predictions that another program made as a run without a network."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

import s2rstore
from s2rstore.errors import RequestError
from s2rstore.files.input_files import sha256
from s2rstore.files.layout import checked_name
from s2rstore.index.transaction import IndexTransaction, check_writable, edit
from s2rstore.reader import Store
from s2rstore.records import SIDES, Side
from s2rtools.common.input_issue import InputIssue
from s2rtools.precompute.imported_arrays import imported_specs, write_arrays
from s2rtools.precompute.prediction_rows import (
    NOT_ATTEMPTED,
    UNSEEN,
    encode_split,
    prediction_columns,
    ranked_instances,
)
from s2rtools.precompute.publish_results import array_row, run_key
from s2rtools.precompute.run_registration import find_domain, insert_run
from s2rtools.precompute.segment_plan import segments
from s2rtools.precompute.work_units import ArraySpec
from s2rtools.prediction_import.file_predictions import ReadingOptions, read_predictions
from s2rtools.prediction_import.instance_matching import ImportTarget
from s2rtools.prediction_import.prediction_table import read_table
from s2rtools.prediction_import.sided_files import (
    InstanceEmbeddings,
    PredictionFile,
    SidedFile,
    read_embeddings,
)

_TABLES = ("prediction", "projection", "zarr_array", "run")

FAILURE, IGNORE = ABSENT = ("failure", "ignore")
"""What instances without a row are: not localised, or not attempted."""

Poses = dict[Side, NDArray[np.float64]]
Splits = dict[Side, NDArray[np.int8]]
Sigmas = dict[Side, NDArray[np.float64]]


@dataclass(frozen=True, slots=True)
class ImportRequest:
    """Files of predictions and embeddings, the domains of both sides, and how to read the files.

    Domains are those of `run_registration.find_domain` where None. `command` is for the provenance.
    `absent` is one of `ABSENT`: what instances without a row are, in the trajectories of which the
    files have rows.
    """

    predictions: Sequence[SidedFile]
    embeddings: Sequence[SidedFile] = ()
    sim: str | None = None
    real: str | None = None
    reading: ReadingOptions = field(default_factory=ReadingOptions)
    command: str = ""
    absent: str = FAILURE


@dataclass(frozen=True, slots=True)
class ImportReport:
    """What was imported: a line about each file, warnings, and the rows that were not used.

    `counts` are the instances with a pose by side and, as `both`, on both sides; those that the
    other program attempted on both sides (`attempted`), those of them without a pose on one side
    (`not_localised`), and those of these without any row on a side (`absent`). `instances` are
    those of the store, `width` the numbers of an embedding. `is_new` is false where an earlier
    import was replaced.
    """

    lines: tuple[str, ...]
    warnings: tuple[str, ...]
    issues: Sequence[InputIssue]
    counts: Mapping[str, int]
    instances: int
    width: int | None
    is_new: bool


def import_run(root: Path, name: str, request: ImportRequest) -> ImportReport:
    """Publish a run of imported predictions; one of the same name is replaced.

    Raises RequestError, also where the name is that of a run with a model, and where no instance
    has a prediction on both sides. Nothing is published then.
    """
    checked_name(name, "run")
    check_writable(root)
    with s2rstore.open(root) as store:
        store.require_poses("a run")
        if name in store.runs and not store.runs[name].is_imported:
            raise RequestError(f"run {name!r}: a run of a model; choose another name")
        target = ImportTarget(store, {
            "sim": find_domain(store, "sim", request.sim),
            "real": find_domain(store, "real", request.real),
        })  # fmt: skip
        files = [
            PredictionFile(
                file,
                read_predictions(
                    read_table(file.path), file.side, target, request.reading, file.trajectory
                ),
            )
            for file in request.predictions
        ]
        issues, poses, splits, sigmas = _combined(files, len(store.instances))
        without_row = [splits[side] == NOT_ATTEMPTED for side in SIDES]
        if request.absent == FAILURE:
            _add_absent(splits, store.instances.trajectory)
        counts = _counts(poses, splits, without_row[0] | without_row[1])
        if not counts["both"]:
            raise _no_pairs(files, counts)
        embeddings = read_embeddings(request.embeddings, files, len(store.instances))
        facts = _facts(request, files, counts, len(store.instances))
        is_new = _publish(root, name, target, poses, splits, sigmas, embeddings, facts)
    return ImportReport(
        tuple(file.predictions.summary for file in files),
        tuple(warning for file in files for warning in file.predictions.warnings),
        issues,
        counts,
        len(poses["sim"]),
        embeddings["sim"].shape[1] if embeddings else None,
        is_new,
    )


def _no_pairs(files: Sequence[PredictionFile], counts: Mapping[str, int]) -> RequestError:
    """Why no instance has a prediction on both sides."""
    found = ", ".join(f"{side} {counts[side]}" for side in SIDES)
    missing = [side for side in SIDES if not counts[side]]
    reasons = [
        f"{side}: {each.predictions.without_numbers[side]}"
        for side in missing
        for each in files
        if side in each.predictions.without_numbers
    ]
    if not reasons:
        advice = " and ".join(f"add the file of that side as {side}:FILE" for side in missing)
        reasons = [advice or "the instances of both sides differ"]
    return RequestError(
        f"--predictions: no instance has a prediction on both sides ({found}); {'; '.join(reasons)}"
    )


def _combined(
    files: Sequence[PredictionFile], count: int
) -> tuple[list[InputIssue], Poses, Splits, Sigmas]:
    """Combine files: all issues, then poses (N, 3), splits (N,) and sigmas (N,) of each side.

    Missing poses and sigmas are NaN. The split of an instance without a row is `NOT_ATTEMPTED`.
    Where two files predict the same, the first counts.
    """
    issues: list[InputIssue] = []
    poses: Poses = {side: np.full((count, 3), np.nan) for side in SIDES}
    splits: Splits = {side: np.full(count, NOT_ATTEMPTED, dtype=np.int8) for side in SIDES}
    sigmas: Sigmas = {side: np.full(count, np.nan) for side in SIDES}
    for each in files:
        file = each.predictions
        issues += file.table.issues
        for code, side in enumerate(SIDES):
            chosen = np.flatnonzero(file.sides == code)
            is_repeated = splits[side][file.iids[chosen]] != NOT_ATTEMPTED
            for k in chosen[is_repeated].tolist():
                place, iid = file.table.place(file.rows[k]), file.iids[k]
                reason = f"({side}) instance {iid} is in an earlier file, which is used"
                issues.append(InputIssue("duplicate row", place, reason))
            chosen = chosen[~is_repeated]
            poses[side][file.iids[chosen]] = file.poses[chosen]
            splits[side][file.iids[chosen]] = file.splits[chosen]
            sigmas[side][file.iids[chosen]] = file.sigmas[chosen]
    return issues, poses, splits, sigmas


def _add_absent(splits: Splits, trajectories: NDArray[np.int32]) -> None:
    """Count instances without a row as attempted, in the trajectories in which a side has rows.

    `trajectories` (N,) are codes. Their split is `unseen`.
    """
    for codes in splits.values():
        is_covered = np.isin(trajectories, trajectories[codes != NOT_ATTEMPTED])
        codes[is_covered & (codes == NOT_ATTEMPTED)] = UNSEEN


def _counts(poses: Poses, splits: Splits, without_row: NDArray[np.bool_]) -> dict[str, int]:
    """See `ImportReport`; `without_row` (N,) marks the instances without a row on some side."""
    known = {side: np.isfinite(poses[side]).all(axis=1) for side in SIDES}
    counts = {str(side): int(known[side].sum()) for side in SIDES}
    both = known["sim"] & known["real"]
    attempted = (splits["sim"] != NOT_ATTEMPTED) & (splits["real"] != NOT_ATTEMPTED)
    marked = {"both": both, "attempted": attempted, "not_localised": attempted & ~both,
              "absent": attempted & without_row}  # fmt: skip
    return counts | {name: int(mask.sum()) for name, mask in marked.items()}


def _facts(
    request: ImportRequest, files: Sequence[PredictionFile], counts: Mapping[str, int], n: int
) -> dict[str, Any]:
    """The provenance of the import."""
    predictions = [
        {**each.predictions.facts, "sha256": sha256(each.file.path),
         "side": each.file.side or "both"}
        for each in files
    ]  # fmt: skip
    embeddings = [
        {"file": each.path.name, "sha256": sha256(each.path), "side": each.side or "both"}
        for each in request.embeddings
    ]
    return {
        "imported predictions": predictions,
        "imported embeddings": embeddings,
        "imported instances": {**counts, "store": n},
        "absent instances": request.absent,
        "imported at": datetime.now(UTC).isoformat(timespec="seconds"),
        "command": request.command,
    }


def _publish(
    root: Path,
    name: str,
    target: ImportTarget,
    poses: Poses,
    splits: Splits,
    sigmas: Sigmas,
    embeddings: Mapping[Side, InstanceEmbeddings],
    facts: Mapping[str, Any],
) -> bool:
    """Publish the run in the place of an earlier import; false where there was one.

    The arrays are written under the publish lock, so that no `s2r prune` removes them.
    """
    store = target.store
    stated = sigmas if any(np.isfinite(values).any() for values in sigmas.values()) else {}
    with edit(root) as draft:
        created_at = _created_at(draft, store, name)
        specs: list[ArraySpec] = []
        for iids in segments([part.iids for part in store.parts]):
            of_segment = imported_specs(iids, poses, embeddings, stated)
            write_arrays(root, name, of_segment, poses, embeddings)
            specs += of_segment
        for table in _TABLES:
            draft.delete(table, run=name)
        draft.delete("provenance", what=f"run:{name}")
        insert_run(draft, name, None, (target.domains["sim"], target.domains["real"]))
        changes = {"key": run_key(specs), **({"created_at": created_at} if created_at else {})}
        draft.update("run", {"run": name}, changes)
        scale, no_scores = store.dataset.accuracy_scale, np.full(len(store.instances), np.nan)
        paired = store.imaged(*target.domains.values())
        ranked = ranked_instances(paired, *poses.values())
        for side in SIDES:
            columns = prediction_columns(
                name,
                side,
                poses[side],
                store.poses(target.domains[side]),
                scale,
                splits[side],
                no_scores,
                ranked,
                sigmas=sigmas[side],
            )
            draft.insert("prediction", columns)
        for spec in specs:
            draft.insert_row("zarr_array", array_row(root, name, spec))
        encoded = {f"split:{target.domains[side]}": encode_split(splits[side]) for side in SIDES}
        draft.set_provenance(f"run:{name}", {**facts, **encoded})
    return created_at is None


def _created_at(draft: IndexTransaction, store: Store, name: str) -> str | None:
    """When the run that is replaced was made; None where there is none.

    Raises RequestError where the store has changed since the files were matched with it.
    """
    (count,) = draft.rows("SELECT count(*) FROM instance")[0]
    if count != len(store.instances):
        raise RequestError(f"{store.path}: instances were added meanwhile; run the command again")
    rows = draft.rows("SELECT model, created_at FROM run WHERE run = ?", [name])
    if rows and rows[0][0] is not None:
        raise RequestError(f"run {name!r}: another process has just used the name; choose another")
    return str(rows[0][1]) if rows else None

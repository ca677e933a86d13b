"""Golden runs: compare the real errors with those of an accepted run, instance by instance.

A reference limits how bad a state may be; a golden run detects that errors grew since it was
stored. Paired differences have far narrower intervals than two separate means.
"""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import numpy as np
from msgspec import Meta, Struct, structs

from s2rstore.errors import InconclusiveError, RequestError
from s2rstore.files.documents import read_json
from s2rstore.gap_history.gate_status import outcome_of
from s2rstore.intervals import MIN_DIFFERENCE, Interval, paired_difference
from s2rstore.intervals.verdict import Outcome
from s2rtools.common.typed_documents import convert
from s2rtools.gap import instance_selection
from s2rtools.gap.axes import MARGIN
from s2rtools.gap.axis import Evidence, GapSettings
from s2rtools.gap.gate.verdict import NOTHING

FORMAT = 1
_MAX_BYTES = 256 << 20
"""Largest golden run that is read, in bytes; an instance takes about 31."""
_MAX_MISSING = 0.1
"""Largest share of the golden run that may be missing in a PASS."""
Error = Annotated[float, Meta(ge=0, le=1e12)]


class GoldenRun(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """The JSON file of a golden run: real errors (m) of an accepted run by iid.

    `poses` is `instance_selection.poses_sha256`: other images of the same poses can be compared
    with it, such as those of a newer simulator.
    """

    format: int = FORMAT
    poses: str
    run: str
    expression: str
    errors: dict[int, Error]


@dataclass(frozen=True, slots=True)
class GoldenComparison:
    """Change of the mean real error since the golden run, over `n` common instances, in metres.

    `missing` counts instances of the golden run that can no longer be compared.
    """

    outcome: Outcome
    change: Interval
    n: int
    margin: float
    missing: int
    reason: str


def take(evidence: Evidence) -> GoldenRun:
    """A golden run of the present state. Raises InconclusiveError for too few instances."""
    errors = _errors(evidence)
    if len(errors) < MIN_DIFFERENCE:
        raise InconclusiveError(
            f"a golden run needs {MIN_DIFFERENCE} held-out instances, not {len(errors)}"
        )
    return GoldenRun(
        poses=instance_selection.poses_sha256(evidence.store),
        run=evidence.run,
        expression=evidence.expression,
        errors=errors,
    )


def text(golden: GoldenRun) -> str:
    """The content of the file of a golden run."""
    return json.dumps(structs.asdict(golden), sort_keys=True) + "\n"


def read(path: Path) -> GoldenRun:
    """Read a golden run. Raises RequestError where it is missing, invalid, or of another format."""
    content = read_json(path, _MAX_BYTES)
    if not isinstance(content, dict) or "errors" not in content:
        raise RequestError(f"{path}: not a golden run; `s2r gap --freeze-golden` writes one")
    if content.get("format") != FORMAT:
        raise RequestError(
            f"{path}: format {content.get('format')}, this version reads {FORMAT}; write a new one "
            "with `s2r gap --freeze-golden`"
        )
    golden = convert(content, GoldenRun, str(path), check=False)
    if not golden.errors:
        raise RequestError(f"{path}: errors: empty; write a new golden run")
    return golden


def compare(
    evidence: Evidence, golden: GoldenRun, settings: GapSettings, margin: float = MARGIN
) -> GoldenComparison:
    """PASS where the interval of the change is below the margin, FAIL where it is above.

    INCONCLUSIVE where too few instances of the golden run remain, for example because a newer model
    was trained on them. Raises RequestError for other poses or another selection.
    """
    if golden.poses != instance_selection.poses_sha256(evidence.store):
        raise RequestError(
            f"{evidence.store.path}: holds other poses than the golden run; "
            "write a new one with `s2r gap --freeze-golden`"
        )
    if golden.expression != evidence.expression:
        raise RequestError(
            f"the golden run is of {golden.expression!r}, not of {evidence.expression!r}; select "
            "the same instances with --select"
        )
    now = _errors(evidence)
    common = np.array([*(now.keys() & golden.errors.keys())], dtype=np.int64)
    shared = evidence.store.in_recording_order(common)
    missing = len(golden.errors) - shared.size
    if shared.size < MIN_DIFFERENCE:
        reason = f"{shared.size} instances are common to both runs, {MIN_DIFFERENCE} are needed"
        return GoldenComparison("INCONCLUSIVE", NOTHING, shared.size, margin, missing, reason)
    changes = np.array([now[iid] - golden.errors[iid] for iid in shared.tolist()])
    trajectories = evidence.store.instances.trajectory[shared]
    change = paired_difference(changes, trajectories, level=settings.level)
    outcome, reason = outcome_of(change, margin), change.reason
    if outcome == "FAIL" and settings.fail_level is not None:
        at_fail_level = paired_difference(changes, trajectories, level=settings.fail_level)
        if not at_fail_level.low > margin:
            outcome = "INCONCLUSIVE"
            reason = (
                f"above the margin at {100 * settings.level:g} %, not at "
                f"{100 * settings.fail_level:.6g} %, the level of a FAIL"
            )
    if outcome == "PASS" and missing > _MAX_MISSING * len(golden.errors):
        outcome = "INCONCLUSIVE"
        reason = f"{missing} of {len(golden.errors)} are no longer comparable"
    return GoldenComparison(outcome, change, shared.size, margin, missing, reason)


def _errors(evidence: Evidence) -> dict[int, float]:
    real = evidence.store.run_columns(evidence.run).real.error
    return {int(iid): round(float(real[iid]), 9) for iid in instance_selection.held_out(evidence)}

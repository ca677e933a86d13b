"""Golden runs: no worse than an accepted state, instance by instance.

An anchor says how bad things may become; a golden run says that they did not become worse since the
day it was stored. Paired differences are far surer than two separate means.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from s2rstore.errors import InconclusiveError, RequestError
from s2rstore.files.input_files import read_json
from s2rstore.gap_history.gate_status import Outcome, outcome_of
from s2rstore.metrics.bootstrap import (
    Blocks,
    Interval,
    mean_replicates,
    percentile_interval,
    split_into_blocks,
)
from s2rtools.gap import defaults, instance_selection
from s2rtools.gap.axis_result import Evidence, GapSettings
from s2rtools.gap.gate.verdict import NOTHING

FORMAT = 1
_FEWEST = 20
_FEWEST_BLOCKS = 4
_MOST_BYTES = 256 << 20
"""Largest golden run that is read, in bytes; an instance takes about 31."""
_FARTHEST = 1e12
"""m"""
_MOST_MISSING = 0.1
"""Share of the golden run that may be missing from a PASS."""


@dataclass(frozen=True, slots=True)
class Golden:
    """The real errors (m) of an accepted run, by iid; `poses` is `population.poses`.

    Other images of the same poses, such as a newer simulator's, are compared.
    """

    poses: str
    run: str
    expression: str
    errors: Mapping[int, float]


@dataclass(frozen=True, slots=True)
class Compared:
    """Mean real error now minus then, over the `n` instances of both, in metres.

    `missing` counts those of the golden run that cannot be compared any more.
    """

    outcome: Outcome
    change: Interval
    n: int
    margin: float
    missing: int
    reason: str


def take(evidence: Evidence) -> Golden:
    """The state to compare with later; raises InconclusiveError where there is too little of it."""
    errors = _errors(evidence)
    count = _blocks(evidence, np.array(sorted(errors), dtype=np.int64)).count
    if len(errors) < _FEWEST or count < _FEWEST_BLOCKS:
        raise InconclusiveError(
            f"a golden run needs {_FEWEST} held-out instances in {_FEWEST_BLOCKS} blocks, not "
            f"{len(errors)} in {count}"
        )
    return Golden(
        instance_selection.poses_sha256(evidence.store), evidence.run, evidence.expression, errors
    )


def text(golden: Golden) -> str:
    """The file of a golden run."""
    return json.dumps({"format": FORMAT, **asdict(golden)}, sort_keys=True) + "\n"


def read(path: Path) -> Golden:
    """Raises RequestError where the file is missing or no golden run."""
    content = read_json(path, _MOST_BYTES)
    try:
        if content["format"] != FORMAT:
            raise RequestError(f"{path}: format {content['format']}, this version reads {FORMAT}")
        errors = {int(iid): float(value) for iid, value in content["errors"].items()}
        poses, run, told = (str(content[key]) for key in ("poses", "run", "expression"))
    except (KeyError, TypeError, ValueError, AttributeError, OverflowError) as error:
        message = f"{path}: no golden run; `s2r gap --freeze-golden` writes one"
        raise RequestError(message) from error
    if not errors or not all(0 <= value <= _FARTHEST for value in errors.values()):
        raise RequestError(f"{path}: errors must be 0 .. {_FARTHEST:g} m, and at least one")
    return Golden(poses, run, told, errors)


def compare(
    evidence: Evidence, golden: Golden, settings: GapSettings, margin: float = defaults.MARGIN
) -> Compared:
    """PASS where the change's interval is under the margin, FAIL where it is over it.

    INCONCLUSIVE where too few of the golden run's instances are left, for example because a newer
    model was trained on them. Raises RequestError for other poses or another selection.
    """
    if golden.poses != instance_selection.poses_sha256(evidence.store):
        raise RequestError(
            f"{evidence.store.path}: holds other poses than the golden run; "
            "`s2r gap --freeze-golden` accepts a new one"
        )
    if golden.expression != evidence.expression:
        raise RequestError(
            f"the golden run is of {golden.expression!r}, not of {evidence.expression!r}; give it "
            "with --select"
        )
    now = _errors(evidence)
    shared = np.array(sorted(now.keys() & golden.errors.keys()), dtype=np.int64)
    missing = len(golden.errors) - shared.size
    blocks = _blocks(evidence, shared)
    if shared.size < _FEWEST or blocks.count < _FEWEST_BLOCKS:
        reason = (
            f"{shared.size} instances in {blocks.count} blocks are in both, {_FEWEST} in "
            f"{_FEWEST_BLOCKS} are needed"
        )
        return Compared("INCONCLUSIVE", NOTHING, shared.size, margin, missing, reason)
    changes = np.array([now[iid] - golden.errors[iid] for iid in shared.tolist()])
    replicates = mean_replicates(changes, blocks, settings)
    change = percentile_interval(float(changes.mean()), replicates, settings.level)
    outcome, reason = outcome_of(change, margin), ""
    if outcome == "PASS" and missing > _MOST_MISSING * len(golden.errors):
        outcome, reason = "INCONCLUSIVE", f"{missing} of {len(golden.errors)} are not comparable"
    return Compared(outcome, change, shared.size, margin, missing, reason)


def _blocks(evidence: Evidence, iids: NDArray[np.int64]) -> Blocks:
    return split_into_blocks(evidence.store.instances.trajectory[iids])


def _errors(evidence: Evidence) -> dict[int, float]:
    real = evidence.store.run_columns(evidence.run).real.error
    return {int(iid): round(float(real[iid]), 9) for iid in instance_selection.held_out(evidence)}

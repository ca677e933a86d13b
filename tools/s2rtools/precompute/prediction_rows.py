"""Index rows of predicted poses: errors, losses, accuracies, ranks and splits."""

from __future__ import annotations

import json
from typing import Any

import numpy as np
from numpy.typing import NDArray

from s2rstore.errors import RequestError
from s2rstore.files.documents import parse_json
from s2rstore.geometry import angles
from s2rstore.index.schema import GAP_SHARES
from s2rstore.metrics import pose_metrics
from s2rstore.records import SPLITS

UNSEEN = SPLITS.index("unseen")
NOT_ATTEMPTED = -1
"""Split code of an instance that a run was not applied to."""


def prediction_columns(
    run: str,
    side: str,
    poses: NDArray[np.float64],
    truth: NDArray[np.float64],
    accuracy_scale: float,
    split: NDArray[np.int8],
    outlier: NDArray[np.float64],
    ranked: NDArray[np.bool_],
    shares: NDArray[np.float32] | None = None,
    sigmas: NDArray[np.float64] | None = None,
) -> dict[str, Any]:
    """Columns of table `prediction` for one side.

    `poses` (n, 3) of the first n instances and `truth` (N, 3), as `Store.poses` gives it for the
    side's domain: x and y in metres, heading in radians. A pose that is not finite is a missing
    prediction: its metrics are NaN and its rank is 0 (both become NULL). The rank of instances that
    are not `ranked` (N,) is 0, too, see `ranked_instances`. `split` is -1 where the
    run was not applied to the instance; then it becomes NULL. `shares` (n, 5) of the gap
    by `records.GAP_FACTORS` in metres, where they are computed. `sigmas` (n,) in metres, where the
    predictions state them, NaN for instances without one; a missing prediction has none.
    """
    n = len(poses)
    known = np.isfinite(poses).all(axis=1, keepdims=True)
    poses = np.where(known, poses, np.nan)
    x, y, heading = poses.T
    dx, dy = x - truth[:n, 0], y - truth[:n, 1]
    error = np.sqrt(dx * dx + dy * dy)
    heading_error = angles.distance(heading, truth[:n, 2])
    rank = pose_metrics.rank(np.where(ranked[:n], error, np.nan))
    stated = np.full(n, np.nan) if sigmas is None else np.where(known.ravel(), sigmas, np.nan)
    return {
        "run": np.full(n, run, dtype=object),
        "iid": np.arange(n, dtype=np.int32),
        "side": np.full(n, side, dtype=object),
        "x": x,
        "y": y,
        "heading": heading,
        "sigma": stated,
        "error": error,
        "heading_error": heading_error,
        "loss": pose_metrics.pose_loss(error, heading_error),
        "accuracy": pose_metrics.accuracy(error, accuracy_scale),
        "rank": np.where(rank > 0, rank, np.nan),
        "split": np.array([*SPLITS, None], dtype=object)[split[:n]],
        "outlier": outlier,
        **_share_columns(shares, n),
    }


def ranked_instances(paired: NDArray[np.bool_], *poses: NDArray[np.float64]) -> NDArray[np.bool_]:
    """(N,) the instances whose errors are ranked: `paired` (N,), or predicted on both sides.

    So further images of one side do not change the ranks of pairs. `poses` (n, 3) of each side are
    those of the first n instances.
    """
    ranked = paired.copy()
    n = min(map(len, poses))
    known = [np.isfinite(of_side[:n]).all(axis=1) for of_side in poses]
    ranked[:n] |= np.logical_and.reduce(known)
    return ranked


def _share_columns(shares: NDArray[np.float32] | None, n: int) -> dict[str, Any]:
    if shares is None:
        shares = np.full((n, len(GAP_SHARES)), np.nan, dtype=np.float32)
    return dict(zip(GAP_SHARES, shares.T, strict=True))


def encode_split(codes: NDArray[np.int8]) -> str:
    """Run-length JSON `[[code, count], ...]` of split codes."""
    if codes.size == 0:
        return "[]"
    starts = np.flatnonzero(np.diff(codes, prepend=codes[0] - 1))
    counts = np.diff(starts, append=codes.size)
    return json.dumps([[int(codes[s]), int(c)] for s, c in zip(starts, counts, strict=True)])


def decode_split(text: str | None, n: int) -> NDArray[np.int8]:
    """Codes into `records.SPLITS`, shape (n,); all `unseen` if `text` is None.

    -1 stands for an instance that the run was not applied to. Instances beyond those of the split
    were appended to the store later: they are `unseen`. Raises RequestError for a malformed split,
    or one of more instances.
    """
    if text is None:
        return np.full(n, UNSEEN, dtype=np.int8)
    pairs = parse_json(text, "the model's split")
    try:
        runs = np.array(pairs, dtype=np.int64).reshape(-1, 2)
        codes, counts = runs.T
        if (
            (counts < 0).any()
            or ((codes < NOT_ATTEMPTED) | (codes >= len(SPLITS))).any()
            or counts.sum() > n
        ):
            size = int(counts.sum())
            raise RequestError(f"the model's split covers {size} instances, not {n}")
    except (ValueError, TypeError, OverflowError) as error:
        raise RequestError("the model's split is malformed; register the model again") from error
    split = np.full(n, UNSEEN, dtype=np.int8)
    split[: counts.sum()] = np.repeat(codes, counts)
    return split

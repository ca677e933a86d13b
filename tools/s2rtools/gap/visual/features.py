"""Features of sim and real images: a run's stored embeddings, or those of an image network.

The embeddings of a run represent what matters for its task. `feature_network` describes the file of
an image network.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from s2rstore.arrays import stored_array
from s2rstore.errors import RequestError
from s2rstore.reader import Store
from s2rstore.records import Run, Side
from s2rstore.run_inputs import run_domain, run_frames

Floats = NDArray[np.float64]
Iids = NDArray[np.int64]
Reader = Callable[[Side, Iids], Floats]

_CHUNK = 64
_MAX_LISTED = 8


@dataclass(frozen=True, slots=True, eq=False)
class FeatureSource:
    """`read(side, iids)` returns finite features (n, d), which depend on `identity` alone."""

    read: Reader
    identity: Mapping[str, str | int | float]


def feature_source(store: Store, run: str, description: Path | None) -> FeatureSource:
    """The embeddings of a run, or the network of a description file. Raises RequestError.

    Embeddings are comparable if they come from the same weights and precision. Of imported ones
    nothing is known but themselves, so they are comparable if they are equal.
    """
    record = store.run(run)
    if description is not None:
        return _network_source(store, record, description)

    def read(side: Side, iids: Iids) -> Floats:
        _, array = store.array(run, "embedding", side)
        if array.shape[0] != len(store.instances):
            raise RequestError(
                f"run {run!r}: the embedding has {array.shape[0]} rows for "
                f"{len(store.instances)} instances; run `s2r verify`"
            )
        rows = [stored_array.read_rows(array, a, b)[chosen] for a, b, chosen in _spans(iids)]
        return _finite(np.concatenate(rows).astype(np.float64), iids, run, side)

    if record.model is None:
        return FeatureSource(read, {"features": "imported embedding", "key": str(record.key)})
    identity: dict[str, str | int | float] = {
        "features": "embedding",
        "features_sha256": store.models[record.model].sha256,
        "precision": record.precision or "",
    }
    return FeatureSource(read, identity)


def _network_source(store: Store, run: Run, description: Path) -> FeatureSource:
    from s2rtools.adjustments import apply_chain
    from s2rtools.gap.visual.feature_network import read_network

    network = read_network(description)

    def read(side: Side, iids: Iids) -> Floats:
        domain, rows = run_domain(store, run, side), []
        for start, stop, chosen in _spans(iids):
            frames = run_frames(store, run, side, start, stop)
            depth = frames["depth"]
            valid = (depth >= domain.depth_raw_min) & (depth <= domain.depth_raw_max)
            rgb, _ = apply_chain(frames["rgb"], depth, valid, run.adjustments(side), store.path)
            rows.append(network.features(rgb[chosen]))
        return _finite(np.concatenate(rows), iids, run.run, side)

    return FeatureSource(read, network.identity)


def _spans(iids: Iids) -> Iterator[tuple[int, int, NDArray[Any]]]:
    """Ranges [start, stop) that contain the iids, in their order, and the chosen rows of each."""
    groups = np.split(iids, np.flatnonzero(np.diff(iids // _CHUNK)) + 1)
    for group in groups:
        yield int(group.min()), int(group.max()) + 1, group - group.min()


def _finite(values: Floats, iids: Iids, run: str, side: Side) -> Floats:
    broken = iids[~np.isfinite(values).all(axis=1)]
    if broken.size:
        named = ", ".join(map(str, broken[:_MAX_LISTED]))
        more = f" and {broken.size - _MAX_LISTED} more" if broken.size > _MAX_LISTED else ""
        raise RequestError(
            f"run {run!r}: {side} features of instances {named}{more} are not finite; "
            f"leave them out (--select '... - ids({named})'), or run `s2r verify`"
        )
    return values

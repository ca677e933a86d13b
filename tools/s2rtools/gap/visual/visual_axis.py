"""The visual axis: kernel distance (KID) of sim and real images in a feature space."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from s2rstore.arrays import stored_array
from s2rstore.errors import RequestError
from s2rstore.intervals import MIN_DIFFERENCE
from s2rstore.reader import Store
from s2rstore.records import Run, Side
from s2rstore.run_inputs import chain_text, run_domain, run_frames
from s2rtools.common.blocks import Blocks, split_into_blocks
from s2rtools.common.command_line import output
from s2rtools.gap import instance_selection
from s2rtools.gap.axis import (
    Anchor,
    Axis,
    AxisResult,
    Details,
    Evidence,
    GapSettings,
    Parser,
    whole_number,
)
from s2rtools.gap.visual.divergence import (
    bias_warning,
    prediction_samples,
    principal_components,
)
from s2rtools.gap.visual.feature_distances import KERNEL, block_mmd
from s2rtools.gap.visual.split_half_metrics import split_half_metrics

Floats = NDArray[np.float64]
Iids = NDArray[np.int64]
Reader = Callable[[Side, Iids], Floats]

_CHUNK = 64
_MAX_LISTED = 8
MAX_INSTANCES = 2000
_LISTED_DIMENSIONS = 3
_SEED = 7
_PERMUTATIONS = 999
_RAW_FID = (
    "FID depends on n (equal distributions of 1024 features gave 52 at n = 100): compare it with "
    "its noise floor, not with a threshold"
)


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


@dataclass(frozen=True, slots=True, eq=False)
class _Sample:
    """Features (n, d) of both sides for the same instances in recording order, and their blocks."""

    source: FeatureSource
    iids: NDArray[np.int64]
    blocks: Blocks
    sim: Floats
    real: Floats
    notes: tuple[str, ...]


class VisualAxis(Axis):
    """m = KID of sim images and real images of other poses, averaged over splits of the blocks.

    KID is the unbiased squared MMD with the cubic polynomial kernel. Between real images of
    different poses this average is 0 for every n, so the floor needs no measurement; the details
    list single splits. FID is biased and would need a measured floor. The anchor is the images
    before any adaptation.
    """

    parsers: ClassVar[Mapping[str, Parser]] = {"pca": whole_number(1, 50)}

    def __init__(self, pca: int = 3) -> None:
        """`pca`: principal components whose divergence the details report."""
        self.pca = pca

    def missing(self, evidence: Evidence) -> str | None:
        if evidence.features is not None:
            return None
        store, run = evidence.store, evidence.run
        reason = instance_selection.uncomputed_reason(evidence)
        if reason is None and not any(r.kind == "embedding" for r in store.array_kinds(run)):
            reason = f"run {run!r} has no embeddings; {store.run(run).embedding_command} makes them"
        return reason

    def measure(self, evidence: Evidence, settings: GapSettings) -> AxisResult:
        sample = _sample(evidence)
        pair = block_mmd(sample.sim, sample.real, sample.blocks)
        components = principal_components(sample.sim, sample.real, self.pca)
        predictions = prediction_samples(evidence.store, evidence.run, sample.iids)
        warning = bias_warning(components.periods.size)
        halves = split_half_metrics(
            sample.sim, sample.real, sample.blocks, settings.seed,
            {"pca": components, **predictions},
        )  # fmt: skip
        kid = halves["kid"]
        noise_floor = (
            f"check by {halves['splits']} random splits of the instances into two halves, "
            f"n = {halves['n']} each: KID {kid['value']:.3f} between sim images of one half and "
            f"real images of the other; noise floor {kid['floor']:.3f} (range "
            f"{kid['floor_low']:.3f} .. {kid['floor_high']:.3f}) between the real images of both "
            "halves"
        )
        return AxisResult(
            value=pair.value(),
            floor=0.0,
            n=sample.iids.size,
            bounds=pair.interval,
            fingerprint={
                **sample.source.identity,
                "poses": instance_selection.poses_sha256(evidence.store),
                "expression": evidence.expression,
                "dimensions": int(sample.real.shape[1]),
                "kernel": KERNEL,
                "scaling": "none",
                "n": int(sample.iids.size),
            },
            details={
                "blocks": pair.blocks.count,
                "kid_p": pair.swap_p(_PERMUTATIONS, settings.seed),
                "permutations": _PERMUTATIONS,
                "halves": halves,
            },
            notes=(
                *sample.notes,
                noise_floor,
                instance_selection.sample_note(pair.interval(settings.level)),
                _RAW_FID,
                *([f"PCA: {warning}"] if warning else []),
            ),
        )

    def anchor(self, evidence: Evidence, settings: GapSettings) -> Anchor:
        run = evidence.store.run(evidence.run)
        if evidence.anchor_run is not None:
            raw = _anchor_run(evidence, run)
            state = f"the sim images of run {raw.run}"
        else:
            raw = _unadapted_run(evidence, run)
            side, chain = _adapted_side(run)
            state = f"the {side} images before {chain_text(chain)} (run {raw.run})"
        sample = _sample(replace(evidence, run=raw.run), iids=_iids(evidence))
        pair = block_mmd(sample.sim, sample.real, sample.blocks)
        return Anchor(pair.interval(settings.level), state)

    def describe(self, details: Details) -> Iterator[str]:
        halves = details["halves"]
        rows = [
            (name, row["value"], _floor(row))
            for name, row in halves.items()
            if isinstance(row, dict) and "floor_low" in row
        ]
        yield f"permutation p value of the kernel distance: {details['kid_p']:.3g}"
        names = ("metric", "sim and real", "real and real (range over the splits)")
        yield (
            f"means over {halves['splits']} random splits of the instances into two halves, n = "
            f"{halves['n']} each: sim images of one half and real images of the other, and real "
            f"images of both halves\n{output.table(names, rows)}"
        )
        columns = halves["wasserstein_by_dimension"]
        largest = sorted(
            zip(columns["value"], columns["floor"], columns["dimension"], strict=True), reverse=True
        )[:_LISTED_DIMENSIONS]
        yield f"Wasserstein-1 of single features, the largest of {len(columns['value'])}:\n" + (
            output.table(
                ("dimension", "sim and real", "real and real (noise floor)"),
                [(dimension, value, floor) for value, floor, dimension in largest],
            )
        )


def _floor(row: Details) -> str:
    """Return the floor with four significant digits, because features have any scale."""
    value, low, high = (
        "-" if row[key] is None else f"{row[key]:.4g}"
        for key in ("floor", "floor_low", "floor_high")
    )
    return f"{value} ({low} .. {high})"


def _iids(evidence: Evidence) -> NDArray[np.int64]:
    """The instances to compare; for the embedding of a run, only held-out ones."""
    if evidence.features is None:
        return instance_selection.held_out(evidence)
    return instance_selection.selected(evidence)


def _sample(evidence: Evidence, iids: NDArray[np.int64] | None = None) -> _Sample:
    """Raises InconclusiveError where there are too few instances."""
    store = evidence.store
    iids = _iids(evidence) if iids is None else iids
    instance_selection.require_instances(evidence, iids, MIN_DIFFERENCE)
    blocks = split_into_blocks(store.instances.trajectory[iids])
    notes: tuple[str, ...] = ()
    if iids.size > MAX_INSTANCES:
        fine = split_into_blocks(store.instances.trajectory[iids], round(MAX_INSTANCES**0.5))
        rows, blocks = instance_selection.random_blocks(fine, MAX_INSTANCES, _SEED)
        notes = (f"{rows.size} of {iids.size} instances, a random sample of whole blocks",)
        iids = iids[rows]
    features = feature_source(store, evidence.run, evidence.features)
    sim, real = features.read("sim", iids), features.read("real", iids)
    return _Sample(features, iids, blocks, sim, real, notes)


def _anchor_run(evidence: Evidence, run: Run) -> Run:
    """The declared run whose sim images are the bad state; its features must fit those of `run`."""
    raw = evidence.store.run(evidence.anchor_run)
    if (raw.model is None or run.model is None) and raw != run and evidence.features is None:
        raise RequestError(
            f"--anchor-run {raw.run}: embeddings of different runs are comparable where one model "
            "made them, which is not known of imported predictions; use --features"
        )
    if raw.model != run.model and evidence.features is None:
        raise RequestError(
            f"--anchor-run {raw.run}: uses model {raw.model}, whose embedding differs from that of "
            f"{run.model}; name a run of {run.model}, or use --features"
        )
    if raw.key is None and evidence.features is None:
        raise RequestError(f"--anchor-run {raw.run}: not computed; run `s2r precompute`")
    return raw


def _adapted_side(run: Run) -> tuple[Side, list[dict[str, Any]]]:
    """The side whose images the run adapts to the other's, and its adjustments: sim before real.

    Raises RequestError where the run adapts neither: its images would be compared with themselves.
    """
    if run.sim_adjustments:
        return "sim", run.sim_adjustments
    if run.real_adjustments:
        return "real", run.real_adjustments
    raise RequestError(
        f"visual: run {run.run} adapts no images, so that no bad state is known to compare them "
        "with; name a run whose sim images are the bad state (--anchor-run), or leave this axis "
        "out (name the others by --axis)"
    )


def _unadapted_run(evidence: Evidence, run: Run) -> Run:
    """A run of the same model and domains without the adjustments of the adapted side."""
    side, _ = _adapted_side(run)
    real_adjustments = run.real_adjustments if side == "sim" else []
    for other in evidence.store.runs.values():
        same = (other.model, other.sim_domain, other.real_domain, other.real_adjustments)
        required = (run.model, run.sim_domain, run.real_domain, real_adjustments)
        usable = other.key is not None or evidence.features is not None
        if not other.sim_adjustments and same == required and usable:
            return other
    raise RequestError(
        f"run {run.run!r}: nothing to compare its adapted {side} images with; add a run of model "
        f"{run.model!r} without --adjust {side}:..., and run `s2r precompute`"
    )

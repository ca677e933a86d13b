"""The visual axis: the kernel distance of sim and real images, on declared features."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from s2rstore.errors import InconclusiveError, RequestError
from s2rstore.reader import Store
from s2rstore.records import Run
from s2rtools.gap import blocks, instance_selection
from s2rtools.gap.axis_result import Anchor, Axis, AxisResult, Evidence, GapSettings
from s2rtools.gap.blocks import Blocks
from s2rtools.gap.visual.features import Source, source
from s2rtools.gap.visual.further_metrics import figures
from s2rtools.gap.visual.kid import KERNEL, BlockMMD, block_mmd
from s2rtools.gap.visual.kl_divergence import bias
from s2rtools.gap.visual.low_dimensional_samples import Points, predicted, principal

Floats = NDArray[np.float64]

LEAST_INSTANCES = 40
LEAST_BLOCKS = 6
"""2^(1 - 6) < 0.05: with fewer blocks no permutation test can tell anything at 5 %. In simulations
of features with neighbours' correlation 0.8 the 95 % intervals of 40 instances in 6 blocks held the
truth in 95 %, of 100 to 500 instances in 90 to 97 %; with correlation 0.95, longer than a block of
100 instances, in 78 %.
"""
MOST_INSTANCES = 2000
_SEED = 7
_PERMUTATIONS = 999
_RAW_FID = (
    "FID grows as n falls (equal distributions of 1024 features at n = 100 gave 52), so no "
    "threshold on it means anything: read it beside its floor"
)


@dataclass(frozen=True, slots=True, eq=False)
class _Sample:
    """Features (n, d) of both sides of the same instances in recording order, and their blocks."""

    source: Source
    iids: NDArray[np.int64]
    blocks: Blocks
    sim: Floats
    real: Floats
    notes: tuple[str, ...]


class VisualAxis(Axis):
    name: ClassVar[str] = "visual"
    unit: ClassVar[str] = "KID"
    measure_is: ClassVar[str] = "kernel distance of sim and real images"
    floor_is: ClassVar[str] = (
        "0 by construction: the same of real and real images, averaged over all halves"
    )
    reason: ClassVar[str] = (
        "m is the unbiased squared MMD with the cubic polynomial kernel (KID) between sim images "
        "and real images of other poses, averaged over all halves of the blocks. Of real images "
        "against real images of other poses that average is 0 at every n, term by term, so the "
        "floor is not measured; what single halves give is among the details. FID, which is "
        "biased, would need it. The anchor is the sim images as they were before anything adapted "
        "them."
    )

    def missing(self, evidence: Evidence) -> str | None:
        if evidence.features is not None:
            return None
        store, run = evidence.store, evidence.run
        reason = instance_selection.uncomputed(evidence)
        if reason is None and not any(r.kind == "embedding" for r in store.arrays(run)):
            reason = f"run {run!r} has no embeddings; run `s2r precompute`"
        return reason

    def measure(self, evidence: Evidence, settings: GapSettings) -> AxisResult:
        sample = _sample(evidence)
        pair = block_mmd(sample.sim, sample.real, sample.blocks)
        counts = blocks.draws(sample.blocks, settings.replicates, settings.seed)
        components = principal(sample.sim, sample.real, settings.pca)
        points = {"pca": components, **predicted(evidence.store, evidence.run, sample.iids)}
        told = bias(components.periods.size)
        details = _details(sample, pair, points, settings)
        return AxisResult(
            axis=self.name,
            value=pair.value(),
            floor=0.0,
            n=sample.iids.size,
            replicates=pair.replicates(counts, settings.level),
            floor_replicates=np.zeros(settings.replicates),
            fingerprint=_fingerprint(evidence, sample),
            details=details,
            notes=(
                *sample.notes,
                _beside(details["halves"]),
                sample.blocks.told,
                _RAW_FID,
                *([f"PCA: {told}"] if told else []),
            ),
        )

    def anchor(self, evidence: Evidence, settings: GapSettings) -> Anchor:
        run = evidence.store.run(evidence.run)
        if evidence.anchor_run is not None:
            raw = _declared(evidence, run)
            state = f"the sim images of run {raw.run}"
        elif not run.sim_adjustments:
            raw, state = run, f"the sim images of run {run.run}, unadapted"
        else:
            raw = _unadapted(evidence, run)
            state = f"the sim images before {_steps(run)} (run {raw.run})"
        sample = _sample(replace(evidence, run=raw.run), iids=_iids(evidence))
        pair = block_mmd(sample.sim, sample.real, sample.blocks)
        counts = blocks.draws(sample.blocks, settings.replicates, settings.seed)
        return Anchor(pair.value(), pair.replicates(counts, settings.level), state)


def _iids(evidence: Evidence) -> NDArray[np.int64]:
    """What is looked at: for a model's own features nothing that it was trained on."""
    if evidence.features is None:
        return instance_selection.held_out(evidence)
    return instance_selection.selected(evidence)


def _sample(evidence: Evidence, iids: NDArray[np.int64] | None = None) -> _Sample:
    """Raises InconclusiveError where there are too few instances or blocks."""
    store = evidence.store
    iids = _iids(evidence) if iids is None else iids
    cut = blocks.cut(store.instances.trajectory[iids])
    if iids.size < LEAST_INSTANCES or cut.count < LEAST_BLOCKS:
        raise InconclusiveError(
            f"{iids.size} usable instances of {evidence.expression!r} in {cut.count} "
            f"blocks; at least {LEAST_INSTANCES} in {LEAST_BLOCKS} are needed"
        )
    notes: tuple[str, ...] = ()
    if iids.size > MOST_INSTANCES:
        fine = blocks.cut(store.instances.trajectory[iids], round(MOST_INSTANCES**0.5))
        kept, cut = fine.part(MOST_INSTANCES, _SEED)
        notes = (f"{kept.size} of {iids.size} instances, as seeded whole blocks",)
        iids = iids[kept]
    features = source(store, evidence.run, evidence.features)
    sim, real = features.read("sim", iids), features.read("real", iids)
    return _Sample(features, iids, cut, sim, real, notes)


def _declared(evidence: Evidence, run: Run) -> Run:
    """The run whose sim images are the bad state; its features must be those of `run`."""
    raw = evidence.store.run(evidence.anchor_run)
    if raw.model != run.model and evidence.features is None:
        raise RequestError(
            f"--anchor-run {raw.run}: of model {raw.model}, whose embedding is not that of "
            f"{run.model}; take a run of {run.model}, or --features"
        )
    if raw.key is None and evidence.features is None:
        raise RequestError(f"--anchor-run {raw.run}: not computed; run `s2r precompute`")
    return raw


def _unadapted(evidence: Evidence, run: Run) -> Run:
    """A run of the same model and real images that leaves the sim images as they are."""
    store: Store = evidence.store
    for other in store.runs.values():
        same = (other.model, other.sim_domain, other.real_domain, other.real_adjustments)
        wanted = (run.model, run.sim_domain, run.real_domain, run.real_adjustments)
        usable = other.key is not None or evidence.features is not None
        if not other.sim_adjustments and same == wanted and usable:
            return other
    raise RequestError(
        f"run {run.run!r}: nothing to compare its adapted sim images with; add a run of model "
        f"{run.model!r} without --adjust sim:..., and run `s2r precompute`"
    )


def _steps(run: Run) -> str:
    return ", ".join(f"{step['name']}={step['value']:g}" for step in run.sim_adjustments)


def _fingerprint(evidence: Evidence, sample: _Sample) -> dict[str, str | int | float]:
    return {
        **sample.source.identity,
        "poses": instance_selection.poses(evidence.store),
        "expression": evidence.expression,
        "dimensions": int(sample.real.shape[1]),
        "kernel": KERNEL,
        "scaling": "none",
        "n": int(sample.iids.size),
    }


def _details(
    sample: _Sample, pair: BlockMMD, points: Mapping[str, Points], settings: GapSettings
) -> dict[str, Any]:
    return {
        "blocks": pair.blocks,
        "kid_p": pair.swap_p(_PERMUTATIONS, settings.seed),
        "permutations": _PERMUTATIONS,
        "halves": figures(sample.sim, sample.real, sample.blocks, settings.seed, points),
    }


def _beside(halves: dict[str, Any]) -> str:
    """What real against real gives at the same n."""
    kid = halves["kid"]
    return (
        f"of halves, n = {halves['n']}: KID {kid['value']:.3f} of sim and real, {kid['floor']:.3f} "
        f"({kid['floor_low']:.3f} .. {kid['floor_high']:.3f}) of real and real"
    )

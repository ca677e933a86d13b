"""All stages of a run, in the rounds in which they are computed and published."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cache
from typing import Any

from s2rstore.errors import RequestError
from s2rstore.reader import Store
from s2rstore.records import Run
from s2rtools.counterfactual import gap_shares
from s2rtools.heatmaps import HEATMAP_KINDS, harm
from s2rtools.models.pose_network import LoadedModel
from s2rtools.precompute.array_keys import ArrayKeys
from s2rtools.precompute.chosen_kinds import domains_without_depth
from s2rtools.precompute.imported_arrays import imported_stages
from s2rtools.precompute.input_hashes import InputHashes
from s2rtools.precompute.restart import is_complete
from s2rtools.precompute.run_backends import RunBackends
from s2rtools.precompute.segment_plan import (
    ArrayMerge,
    SegmentPlan,
    plan_segments,
    published_ranges,
    segments,
)
from s2rtools.precompute.tasks import map_grids, outliers, rendered_frames, umap_projection
from s2rtools.precompute.tasks.image_heatmaps import image_stages
from s2rtools.precompute.tasks.map_grids import map_stages
from s2rtools.precompute.tasks.network_outputs import (
    imaged_sides,
    network_stages,
    one_sided_stage,
)
from s2rtools.precompute.tasks.outliers import outlier_stage
from s2rtools.precompute.tasks.rendered_frames import frames_stages
from s2rtools.precompute.tasks.umap_projection import projection_stage
from s2rtools.precompute.work_units import ArraySpec, Stage

WORK: dict[str, float] = {
    "predictions": 1.0, "forward": 1.5, "projection": 0.7, "tens": 3.0, "hundreds": 6.0,
}  # fmt: skip
"""Rounds with their work per instance; measured ratios differ by network and processor."""
ROUNDS = tuple(WORK)
"""What is computed and published one after the other; heatmaps by their cost."""
PROJECTION = ROUNDS.index("projection")
"""The round of projections and outliers."""


@dataclass(frozen=True, slots=True)
class Round:
    """What a run publishes together: stages in `groups`, each of which needs those before it, and
    the arrays that are merged from theirs.

    `published` are the stages with the arrays of all segments, those of earlier rounds included.
    """

    groups: Sequence[Sequence[Stage]]
    merges: Sequence[ArrayMerge]
    published: Sequence[Stage]


@dataclass(frozen=True, slots=True)
class RunStages:
    """The stages of a run, in the rounds of `ROUNDS`.

    `earlier` are the paths that the arrays of predictions have for the ranges of instances that are
    published.
    """

    run: str
    rounds: Sequence[Round]
    earlier: frozenset[str] = frozenset()

    @property
    def stages(self) -> list[Stage]:
        """All stages that are computed or published."""
        computed = [stage for each in self.rounds for group in each.groups for stage in group]
        return [*computed, *self.rounds[-1].published]


def model_run_stages(
    store: Store,
    hashes: InputHashes,
    run: Run,
    model: LoadedModel,
    backends: RunBackends,
    kinds: Sequence[str],
    refit: bool,
) -> RunStages:
    """The stages of a run of a model; projections are fitted again with `refit`.

    Projections and heatmaps are those of pairs; instances with images of one side have predictions.
    """
    has_depth = not domains_without_depth(store, run)

    @cache
    def of_pairs(iids: range) -> list[Stage]:
        keys = ArrayKeys(hashes, run, iids)
        rendered = frames_stages(store, keys, run, iids)
        frames = tuple(spec for stage in rendered for spec in stage.specs)
        forward, others = network_stages(keys, run, iids, model, backends, kinds, frames, has_depth)
        return [*rendered, forward, *others, *map_stages(store, keys, forward, others)]

    def stages_of(iids: range) -> list[Stage]:
        sides = imaged_sides(store, run, iids)
        if len(sides) > 1:
            return of_pairs(iids)
        keys = ArrayKeys(hashes, run, iids, sides)
        rendered = frames_stages(store, keys, run, iids, sides)
        frames = tuple(spec for stage in rendered for spec in stage.specs)
        return [*rendered, one_sided_stage(keys, run, iids, sides[0], backends, frames)]

    def embedding_key(iids: range) -> str:
        return next(
            spec.key for stage in of_pairs(iids) for spec in stage.specs_of_kind("embedding")
        )

    parts = store.imaged_ranges(run.sim_domain, run.real_domain)
    if not parts:
        raise RequestError(
            f"{store.path}: no instance has images in both {run.sim_domain} and {run.real_domain}, "
            f"the domains of run {run.run}"
        )
    network = plan_segments(store, run.run, stages_of, parts, segments(parts))
    computed = [spec for stage in network.computed for spec in stage.specs]
    one_sided = SegmentPlan()
    domains = run.sim_domain, run.real_domain
    for domain, other in (domains, reversed(domains)):
        lone = store.imaged_ranges(domain, without=other)
        one_sided = one_sided + plan_segments(store, run.run, stages_of, lone, segments(lone))
    projections = _projections(store, run, computed, _adjoining(parts), embedding_key, refit)
    earlier = frozenset(
        spec.path(run.run)
        for iids in published_ranges(store, [run.run])
        if imaged_sides(store, run, iids)
        for stage in stages_of(iids)
        for spec in stage.specs_of_kind("prediction")
    )
    return _run_stages(run.run, network + one_sided, projections, earlier)


def imported_run_stages(
    store: Store, hashes: InputHashes, run: Run, kinds: Sequence[str], refit: bool
) -> RunStages:
    """The stages of a run of imported predictions: what needs no network.

    These are the heatmaps of `kinds` and their map grids, and with embeddings projection and
    outliers, for the instances of the import. Raises RequestError where imported arrays are
    missing.
    """
    forwards = imported_stages(store, run)
    imported = [spec for forward in forwards for spec in forward.specs]
    if not imported or not all(is_complete(store, run.run, spec) for spec in imported):
        raise RequestError(f"run {run.run!r}: its imported arrays are missing; import it again")
    has_depth = not domains_without_depth(store, run)

    @cache
    def stages_of(iids: range) -> list[Stage]:
        keys = ArrayKeys(hashes, run, iids)
        images = image_stages(keys, run, iids, kinds, has_depth)
        forward = next(each for each in forwards if iids.start in each.instances)
        return [*images, *map_stages(store, keys, forward, images)]

    def embedding_key(iids: range) -> str | list[str]:
        keys = [each.specs[0].key for each in forwards if each.first_iid in iids]
        return keys[0] if len(keys) == 1 else keys

    imports = [forward.instances for forward in forwards]
    imaged = store.imaged_ranges(run.sim_domain, run.real_domain)
    covered = [part for each in imports for part in imaged if part.start in each]
    network = plan_segments(store, run.run, stages_of, covered, _joined(covered, imports))
    projections = SegmentPlan()
    if forwards[0].specs_of_kind("embedding"):
        parts = [part.iids for part in store.parts if part.first_iid < imports[-1].stop]
        projections = _projections(store, run, imported, parts, embedding_key, refit)
    return _run_stages(run.run, network, projections, imported=forwards)


def _adjoining(parts: Sequence[range]) -> list[range]:
    """Each part with the instances between the one before it and itself, from instance 0 on."""
    starts = [0, *(part.stop for part in parts[:-1])]
    return [range(start, part.stop) for start, part in zip(starts, parts, strict=True)]


def _joined(parts: Sequence[range], ranges: Sequence[range]) -> list[range]:
    """Merge parts that adjoin and lie in the same one of `ranges`."""
    joined: list[range] = []
    for part in parts:
        if joined and joined[-1].stop == part.start and part.start not in {r.start for r in ranges}:
            part = range(joined.pop().start, part.stop)
        joined.append(part)
    return joined


def _projections(
    store: Store,
    run: Run,
    embeddings: Sequence[ArraySpec],
    parts: Sequence[range],
    embedding_key: Callable[[range], Any],
    refit: bool,
) -> SegmentPlan:
    """The stages of the run's projection, and of outliers, of some parts of the data set.

    `embeddings` are the arrays of predictions and embeddings.
    """
    sources = tuple(spec for spec in embeddings if spec.kind in ("prediction", "embedding"))

    def projected(iids: range, fitted: int) -> Stage:
        return projection_stage(run.run, iids, fitted, embedding_key, sources)

    fitted = parts[-1].stop if refit else _fitted(store, run, parts[-1].stop, projected)
    first = range(fitted)
    later = [range(max(part.start, fitted), part.stop) for part in parts if part.stop > fitted]
    fit = projected(first, fitted)

    def stages_of(iids: range) -> list[Stage]:
        stage = projected(iids, fitted)
        return [stage, outlier_stage(fit, stage)]

    ranges = [first, *segments(later)]
    return plan_segments(store, run.run, stages_of, [first, *later], ranges)


def _fitted(store: Store, run: Run, count: int, projected: Callable[[range, int], Stage]) -> int:
    """How many instances the projection is fitted on: those of the published one.

    So points stay where they are. All `count` where none of the same embeddings is published.
    """
    for record in store.array_parts(run.run):
        if record.kind == "umap" and record.first_iid == 0:
            fitted = record.shape[0]
            stage = projected(range(fitted), fitted)
            if record.path in {spec.path(run.run) for spec in stage.specs}:
                return fitted
    return count


def _run_stages(
    run: str,
    network: SegmentPlan,
    projections: SegmentPlan,
    earlier: frozenset[str] = frozenset(),
    imported: Sequence[Stage] = (),
) -> RunStages:
    """Distribute the arrays of stages over the rounds; `imported` are published with the first."""
    computed = [*network.computed, *projections.computed]
    merges = [*network.merges, *projections.merges]
    published = [*imported, *network.published, *projections.published]
    rounds = []
    for number in range(len(ROUNDS)):

        def is_now(spec: ArraySpec, number: int = number) -> bool:
            return _round(spec) == number

        def is_done(spec: ArraySpec, number: int = number) -> bool:
            return _round(spec) <= number

        rounds.append(
            Round(
                _groups(_with_specs(computed, is_now)),
                [merge for merge in merges if is_now(merge.spec)],
                _with_specs(published, is_done),
            )
        )
    return RunStages(run, rounds, earlier)


def _round(spec: ArraySpec) -> int:
    """The place in `ROUNDS` of an array."""
    kind = spec.kind.removeprefix("map:")
    if kind in HEATMAP_KINDS:
        return ROUNDS.index(HEATMAP_KINDS[kind].cost)
    if kind == gap_shares.KIND:
        return ROUNDS.index(HEATMAP_KINDS[harm.Harm.name].cost)
    return PROJECTION if kind in ("pca", "umap", outliers.KIND) else 0


def _with_specs(stages: Sequence[Stage], is_wanted: Callable[[ArraySpec], bool]) -> list[Stage]:
    """The stages with the wanted ones of their arrays, without those that have none."""
    kept = (tuple(filter(is_wanted, stage.specs)) for stage in stages)
    return [replace(stage, specs=specs) for stage, specs in zip(stages, kept, strict=True) if specs]


def _groups(stages: Sequence[Stage]) -> list[list[Stage]]:
    """The stages of a round in the order in which they need each other."""

    def named(*names: str) -> list[Stage]:
        return [stage for stage in stages if stage.name in names]

    fits = named(umap_projection.NAME)
    later = (rendered_frames.NAME, map_grids.STAGE, umap_projection.NAME, outliers.NAME)
    groups = [
        named(rendered_frames.NAME),
        [*(stage for stage in stages if stage.name not in later), *fits[:1]],
        [*named(map_grids.STAGE), *fits[1:]],
        named(outliers.NAME),
    ]
    return [group for group in groups if group]

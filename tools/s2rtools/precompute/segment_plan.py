"""Plan what is computed of some stages of a run, and what is merged to the arrays of segments.

Stages are computed for one part of the data set at a time, so that what was begun is used when
more parts are appended. The arrays of a segment of several parts are merged from those of the
parts and of earlier segments. An array is found by its key, which is a hash of what its values
depend on, so that nothing else than the store's content tells which rows exist.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field, replace
from functools import cache

from s2rstore.arrays import array_writer
from s2rstore.errors import RequestError
from s2rstore.files import layout, safe_files
from s2rstore.files.ledger import Ledger
from s2rstore.reader import Store
from s2rtools.precompute.work_units import ArraySpec, Stage

COPIED_ROWS = 32
"""Earlier rows that may be copied for each later one."""


Label = tuple[str, str | None, str | None]
"""Kind, side and mode of an array."""
StagesOf = Callable[[range], Sequence[Stage]]


@dataclass(frozen=True, slots=True)
class ArrayMerge:
    """An array of the stage of a segment, and the arrays whose rows it consists of, in order."""

    stage: Stage
    spec: ArraySpec
    sources: tuple[ArraySpec, ...]


@dataclass(frozen=True, slots=True)
class SegmentPlan:
    """`computed` are stages of parts and segments, whose arrays exist or are to be computed.

    `published` are the stages of the segments, whose arrays are computed or merged.
    """

    computed: list[Stage] = field(default_factory=list)
    merges: list[ArrayMerge] = field(default_factory=list)
    published: list[Stage] = field(default_factory=list)

    def __add__(self, other: SegmentPlan) -> SegmentPlan:
        return SegmentPlan(
            self.computed + other.computed,
            self.merges + other.merges,
            self.published + other.published,
        )

    @property
    def rows_of(self) -> dict[Label, list[ArraySpec]]:
        """For each kind, side and mode the computed arrays, which hold all rows once."""
        found: dict[Label, list[ArraySpec]] = defaultdict(list)
        for stage in self.computed:
            for spec in stage.specs:
                found[label(spec)].append(spec)
        return found


def label(spec: ArraySpec) -> Label:
    return spec.kind, spec.side, spec.mode


def plan_segments(
    store: Store, run: str, stages_of: StagesOf, parts: Sequence[range], segments: Sequence[range]
) -> SegmentPlan:
    """Plan the stages of a run; `stages_of` gives those of a range of whole `parts`.

    Each segment is a range of parts. Its arrays are computed where it is one part, and where they
    are published or complete; else they are merged.
    """
    holdings = _Holdings(store, run, cache(stages_of))
    plan = SegmentPlan()
    for segment in segments:
        inside = [part for part in parts if part.start in segment]
        wanted: dict[range, set[Label]] = defaultdict(set)
        for stage in holdings.stages_of(segment):
            plan.published.append(stage)
            for spec in stage.specs:
                ranges = [segment]
                if len(inside) > 1 and not holdings.is_complete(spec):
                    ranges = holdings.cover(label(spec), segment, inside)
                    sources = tuple(holdings.specs_of(each)[label(spec)] for each in ranges)
                    plan.merges.append(ArrayMerge(stage, spec, sources))
                for each in ranges:
                    wanted[each].add(label(spec))
        for each in sorted(wanted, key=lambda iids: iids.start):
            plan.computed.extend(_with_arrays(holdings.stages_of(each), wanted[each]))
    rows_of = plan.rows_of
    plan.computed[:] = [_with_sources(stage, rows_of) for stage in plan.computed]
    return plan


def published_ranges(store: Store, runs: Iterable[str]) -> list[range]:
    """The ranges of instances that published arrays of some runs hold."""
    ranges = {
        range(record.first_iid, record.first_iid + record.shape[0])
        for run in runs
        for record in store.array_parts(run)
        if record.axes[:1] == ("iid",)
    }
    return sorted(ranges, key=lambda iids: (iids.start, iids.stop))


def segments(parts: Iterable[range]) -> list[range]:
    """The segments of parts, which are ascending ranges of instances.

    Parts that do not adjoin are never merged.
    """
    merged: list[range] = []
    for each in parts:
        while merged and merged[-1].stop == each.start and _is_worth_merging(merged[-1], each):
            each = range(merged.pop().start, each.stop)
        merged.append(each)
    return merged


def _is_worth_merging(segment: range, part: range) -> bool:
    """Whether a merge copies few rows of a segment for each row of the next part."""
    return len(segment) % array_writer.SHARD_ROWS <= COPIED_ROWS * len(part)


class _Holdings:
    """Which arrays of a run a store holds, for which ranges of instances."""

    def __init__(self, store: Store, run: str, stages_of: StagesOf) -> None:
        self._store, self._run, self.stages_of = store, run, stages_of
        self._ledger = Ledger(store.path)
        self._entries = cache(self._ledger.array_entries)
        self.specs_of = cache(self._specs_of)
        self._published = cache(lambda: published_ranges(store, store.runs))

    def _specs_of(self, iids: range) -> dict[Label, ArraySpec]:
        return {label(spec): spec for stage in self.stages_of(iids) for spec in stage.specs}

    def is_complete(self, spec: ArraySpec) -> bool:
        """Whether an array is published, or recorded in the ledger with all files."""
        if spec.path(self._run) in self._store.array_paths:
            return True
        root, path = self._store.path, f"{layout.RUNS}/{spec.path(self._run)}"
        if safe_files.kind(root, path) is None:
            return False
        try:
            array = spec.open_array(root, self._run)
        except RequestError:
            return False
        entries = self._entries(spec.folder(self._run))
        return all(
            self._ledger.states_size(entries.get(array.file(shard), []))
            for shard in range(array.layout.shards)
        )

    def cover(self, name: Label, segment: range, parts: Sequence[range]) -> list[range]:
        """Ranges that fill a segment: those of published arrays, else parts."""
        chosen: list[range] = []
        position = segment.start
        while position < segment.stop:
            options = [
                iids
                for iids in self._published()
                if iids.start == position and iids.stop <= segment.stop
                and self._is_published(name, iids)
            ]  # fmt: skip
            part = next(part for part in parts if part.start == position)
            chosen.append(max(options, key=len, default=part))
            position = chosen[-1].stop
        return chosen

    def _is_published(self, name: Label, iids: range) -> bool:
        spec = self.specs_of(iids).get(name)
        return spec is not None and spec.path(self._run) in self._store.array_paths


def _with_arrays(stages: Iterable[Stage], names: set[Label]) -> list[Stage]:
    """Stages with some of their arrays, without those that have none of them."""
    kept = [
        replace(stage, specs=tuple(spec for spec in stage.specs if label(spec) in names))
        for stage in stages
    ]
    return [stage for stage in kept if stage.specs]


def _with_sources(stage: Stage, rows_of: dict[Label, list[ArraySpec]]) -> Stage:
    """A stage that reads its sources from the arrays that hold their rows."""
    sources = (
        found
        for source in stage.sources
        for found in rows_of.get(label(source), [source])
        if found is source or _overlap(found, source)
    )
    return replace(stage, sources=tuple(dict.fromkeys(sources)))


def _overlap(one: ArraySpec, other: ArraySpec) -> bool:
    return (
        one.first_iid < other.first_iid + other.rows and other.first_iid < one.first_iid + one.rows
    )

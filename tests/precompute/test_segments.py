"""Arrays of appended parts are merged to those of few segments, without computing them again."""

import hashlib
import tempfile
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from functools import partial
from itertools import accumulate, pairwise
from pathlib import Path
from types import SimpleNamespace
from unittest.mock import Mock

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from s2rstore.arrays import array_writer
from s2rstore.errors import RequestError
from s2rstore.files import atomic_writes
from s2rstore.files.compute_environment import ComputeEnvironment
from s2rstore.files.ledger import Ledger
from s2rstore.geometry.map_grid import AGGREGATES, aggregates, empty_totals
from s2rtools.precompute import segment_plan, unit_results
from s2rtools.precompute.merged_arrays import merge_arrays
from s2rtools.precompute.segment_plan import label, plan_segments, segments
from s2rtools.precompute.tasks.map_grids import merge_grids
from s2rtools.precompute.unit_computer import encoded
from s2rtools.precompute.unit_plan import UnitPlan, recorded_environments
from s2rtools.precompute.unit_results import Receipt
from s2rtools.precompute.work_units import ArraySpec, Stage, WorkUnit

SHARD_ROWS, COPIED_ROWS, UNIT_ROWS = 16, 2, 4
MOST_SEGMENTS = 4
"""Segments but the first have at most 7, 3 and 1 rows."""


class Killed(BaseException):
    """Ends a merge as `kill -9` would."""


def ranges(sizes: list[int]) -> list[range]:
    return [range(*ends) for ends in pairwise(accumulate(sizes, initial=0))]


@given(st.lists(st.sampled_from([1, 3, 20, 500, 5_000, 20_000, 400_000]), min_size=1, max_size=60))
def test_a_data_set_of_any_history_has_at_most_three_segments(sizes):
    parts, before = ranges(sizes), list[range]()
    for count in range(1, len(parts) + 1):
        found = segments(parts[:count])
        assert len(found) <= 3
        assert [i for each in found for i in (each.start, each.stop)][1:-1:2] == [
            each.start for each in found[1:]
        ]
        assert (found[0].start, found[-1].stop) == (0, parts[count - 1].stop)
        assert {each.stop for each in found} <= {part.stop for part in parts[:count]}
        assert all(any(b.start in each and b.stop <= each.stop for each in found) for b in before)
        before = found


def stages_of(iids: range, with_extra: bool = True) -> list[Stage]:
    """Stages of arrays of the run, of arrays that runs share, and of aggregates."""
    key = hashlib.sha256(str(iids).encode()).hexdigest()
    axes, count, first = ("iid", "value"), len(iids), iids.start
    own = ArraySpec("heat", "sim", None, (3,), "float32", axes, "m", key[:16], count,
                    first_iid=first)  # fmt: skip
    shared = ArraySpec("heat", None, "rgb", (2,), "float16", axes, "m", key[16:32], count,
                       first_iid=first, is_shared=True)  # fmt: skip
    extra = ArraySpec("extra", None, None, (), "uint8", axes[:1], "", key[32:48], count,
                      first_iid=first)  # fmt: skip
    grid = ArraySpec("map:heat", "sim", None, (2, 2), "float32", ("aggregate", "row", "column"),
                     "m", key[48:], len(AGGREGATES), first_iid=first)  # fmt: skip
    extras = [Stage("extra", "r", (extra,), UNIT_ROWS)] if with_extra else []
    return [
        Stage("heat", "r", (own, shared), UNIT_ROWS),
        *extras,
        Stage("maps", "r", (grid,), 8, (own,), aggregated=iids),
    ]


def values_of(spec: ArraySpec, iids: range) -> np.ndarray:
    """Rows of instances, or the totals of a map grid."""
    rows = np.array(iids)
    if spec.kind == "map:heat":
        totals = empty_totals(2, 2).reshape(3, 4)
        np.maximum.at(totals[0], rows % 3, rows)
        np.add.at(totals[1], rows % 3, rows)
        np.add.at(totals[2], rows % 3, 1)
        return totals.reshape(3, 2, 2)
    grown = np.multiply.outer(rows, np.arange(1, 1 + int(np.prod(spec.item)))) % 251
    return grown.reshape(len(rows), *spec.item).astype(spec.dtype)


@dataclass
class Growing:
    """A store that parts are appended to; `computed` counts how often a row was computed."""

    path: Path
    parts: list[range]
    listed: list[ArraySpec] = field(default_factory=list)
    computed: Counter[tuple[object, int]] = field(default_factory=Counter)
    runs = ("r",)

    @property
    def array_paths(self) -> set[str]:
        return {spec.path("r") for spec in self.listed}

    def array_parts(self, run: str) -> list[SimpleNamespace]:
        return [
            SimpleNamespace(first_iid=s.first_iid, shape=(s.rows, *s.item), axes=s.axes)
            for s in self.listed
        ]

    def precompute(self, count: int, with_extra: bool = True, checks: int = 10**6) -> None:
        """Compute, merge and publish some parts; the merge is killed after some checks."""
        parts, plan_of = self.parts[:count], partial(stages_of, with_extra=with_extra)
        plan = plan_segments(self, "r", plan_of, parts, segments(parts))  # type: ignore[arg-type]
        host = ComputeEnvironment(f"processor {count % 2}", "float32", 1, {})
        for is_aggregate in (False, True):
            group = [stage for stage in plan.computed if stage.is_aggregate == is_aggregate]
            units = UnitPlan(self.path, group, self.array_paths, merge_grids)
            for unit in units.units:
                units.finish(self._computed(unit, host))
            units.close()
        left = iter(range(checks))

        def check() -> None:
            if next(left, None) is None:
                raise Killed

        merge_arrays(self.path, "r", plan.merges, check)
        specs = [spec for stage in plan.published for spec in stage.specs]
        names = {label(spec) for spec in specs}
        self.listed = [*specs, *(spec for spec in self.listed if label(spec) not in names)]

    def _computed(self, unit: WorkUnit, host: ComputeEnvironment) -> Receipt:
        values = {spec: values_of(spec, unit.instances) for spec in unit.missing}
        self.computed.update((label(spec), iid) for spec in values for iid in unit.instances)
        layouts = {spec.path("r"): spec.open_array(self.path, "r").layout for spec in values}
        chunks = encoded(unit, values, layouts.__getitem__)
        attempt = unit_results.write_attempt(self.path, unit, chunks, host)
        name = unit_results.file_name(unit.stage, unit.number)
        return Receipt(name, *attempt, 0.0, host.device, host)

    def assert_equal(self, listed: list[ArraySpec]) -> None:
        """Arrays hold the values that they would have without parts, and the ledger proves them."""
        ledger = Ledger(self.path)
        entries = ledger.by_path()
        rows = {spec.first_iid: spec.rows for spec in listed if spec.kind == "heat"}
        for spec in listed:
            array = spec.open_array(self.path, "r")
            for shard in range(array.layout.shards):
                of_file = entries[array.file(shard)]
                assert ledger.proves(of_file)
                assert {entry.count for entry in of_file} == {array.rows_in(shard)}
            is_map = spec.kind == "map:heat"
            count = rows[spec.first_iid] if is_map else spec.rows
            expected = values_of(spec, range(spec.first_iid, spec.first_iid + count))
            expected = aggregates(expected) if is_map else expected
            np.testing.assert_allclose(array[:], expected, rtol=1e-6)


@contextmanager
def small_shards() -> Iterator[Path]:
    """Shards of few rows, and an empty folder."""
    with pytest.MonkeyPatch.context() as patch, tempfile.TemporaryDirectory() as folder:
        patch.setattr(array_writer, "SHARD_ROWS", SHARD_ROWS)
        patch.setattr(segment_plan, "COPIED_ROWS", COPIED_ROWS)
        yield Path(folder)


@settings(max_examples=12)
@given(
    st.lists(st.tuples(st.integers(1, 40), st.booleans(), st.integers(0, 8)), max_size=6),
    st.booleans(),
)
def test_a_store_that_grew_equals_one_that_was_computed_at_once(appends, has_links):
    """Also where merges are killed, where a kind is left out at times, and without hard links."""
    with small_shards() as root, pytest.MonkeyPatch.context() as patch:
        if not has_links:
            patch.setattr(atomic_writes, "link", Mock(side_effect=OSError))
        store = Growing(root, ranges([7, *(size for size, _, _ in appends), 5]))
        store.precompute(1)
        for count, (_, with_extra, checks) in enumerate(appends, 2):
            before = store.listed
            with suppress(Killed):
                store.precompute(count, with_extra, checks)
            store.precompute(count, with_extra)
            store.assert_equal(before)
            store.assert_equal(store.listed)
        store.precompute(len(store.parts))
        store.assert_equal(store.listed)
        assert set(store.computed.values()) == {1}
        assert len(store.computed) == 4 * store.parts[-1].stop
        assert max(Counter(map(label, store.listed)).values()) <= MOST_SEGMENTS


def test_whole_shards_are_linked_and_environments_of_all_parts_recorded():
    with small_shards() as root:
        store, ledger = Growing(root, ranges([40, 30])), Ledger(root)
        store.precompute(1)
        (first, *_), _ = store.listed, store.precompute(2)
        old, new = (each.open_array(root, "r").path for each in (first, store.listed[0]))
        for shard in ("c.0.0", "c.1.0"):
            assert (old / shard).samefile(new / shard)
        entries = ledger.array_entries(store.listed[0].folder("r"))
        found = recorded_environments(ledger, entries.values())
        assert {environment.device for environment in found} == {"processor 0", "processor 1"}


def test_damaged_arrays_are_not_merged():
    with small_shards() as root:
        store = Growing(root, ranges([10, 10, 10]))
        store.precompute(1)
        file = store.listed[0].open_array(root, "r").path / "c.0.0"
        content = file.read_bytes()
        file.write_bytes(bytes([content[0] ^ 1]) + content[1:])
        with pytest.raises(RequestError, match="checksum is not the ledger's; remove it"):
            store.precompute(3)
        file.unlink()
        store.precompute(3)
        store.assert_equal(store.listed)

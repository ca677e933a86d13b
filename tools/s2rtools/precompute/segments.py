"""Which instances share arrays: consecutive parts of a data set, merged to few segments.

An append adds a part. If every part kept arrays of its own, the number of files of a run would grow
with every append. So parts are merged, like the runs of a log-structured merge tree (O'Neil et al.,
1996): a segment takes in the one before it where this copies few rows for each that is added.

Whole shards are never copied, they get a second name (`merged_arrays`). What a merge copies are the
rows of the earlier segment behind its last whole shard, and those of the later one. A segment stays
apart while the earlier one has more than `COPIED_ROWS` such rows for each of its own. So each
segment but the first has at most 1 / `COPIED_ROWS` of a shard, and of the rows of the one before
it: a store of any size has at most three segments, and a row is copied a limited number of times.

Segments depend on the parts alone, so that all runs have the same and can share arrays.
"""

from __future__ import annotations

from collections.abc import Iterable

from s2rstore.arrays import array_writer

COPIED_ROWS = 32
"""Earlier rows that may be copied for each later one."""


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

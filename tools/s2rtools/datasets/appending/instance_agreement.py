"""Compare the instances of a scan with those that the store has of the same trajectories.

Stored instances are never replaced. So the source must have them unchanged, in the same order;
further ones may follow them.
"""

from __future__ import annotations

import math
from array import array
from collections import defaultdict
from collections.abc import Callable, Collection, Iterator, Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import astuple, dataclass, field
from functools import partial

from s2rstore.errors import RequestError, counted
from s2rstore.reader import Store
from s2rtools.common.input_issue import InputIssue
from s2rtools.common.read_ahead import map_ahead
from s2rtools.datasets.appending.store_agreement import is_close
from s2rtools.datasets.scan import InstanceRecord, Scan
from s2rtools.datasets.writing.frame_writing import depth_type

_THREADS = 2
_BLOCK = 4096
"""Stored instances that are read together."""
_MOST_RANGES = 3
"""Ranges of other numbers that a message lists."""


@dataclass(slots=True)
class Renumbered:
    """Rows of a source whose images are stored under other numbers.

    Each range has the first `seq` of the source, the first stored one, and the number of rows over
    which both count on by one.
    """

    ranges: list[tuple[int, int, int]] = field(default_factory=list)
    rows: int = 0

    def add(self, seq: int, stored: int) -> None:
        """Add a row with its `seq` in the source and in the store."""
        self.rows += 1
        if self.ranges:
            first, first_stored, count = self.ranges[-1]
            if (seq - first, stored - first_stored) == (count, count):
                self.ranges[-1] = (first, first_stored, count + 1)
                return
        self.ranges.append((seq, stored, 1))

    @property
    def text(self) -> str:
        """`40 rows have another seq in the store: seq 100..139 of the source is 0..39`."""
        listed = "; ".join(
            f"seq {_range_text(first, count)} of the source is {_range_text(stored, count)}"
            for first, stored, count in self.ranges[:_MOST_RANGES]
        )
        more = len(self.ranges) - _MOST_RANGES
        verb = "has" if self.rows == 1 else "have"
        rest = f"; and {counted(more, 'further range')}" if more > 0 else ""
        return f"{counted(self.rows, 'row')} {verb} another seq in the store: {listed}{rest}"


def _range_text(first: int, count: int) -> str:
    return str(first) if count == 1 else f"{first}..{first + count - 1}"


@dataclass(frozen=True, slots=True)
class Additions:
    """What a scan adds to a store.

    `new` and `unchanged` are names of trajectories. `continued` has the number of the first record
    behind the stored instances of a trajectory, `rows` the numbers of the records of these.
    `renumbered` has the trajectories whose stored instances have another `seq` than their source.
    `domains` are added to the stored instances of those trajectories in `rows` that the source
    images in them and the store does not; they are new to the store, or image others of it, which
    may be of the same trajectory.
    """

    new: tuple[str, ...]
    domains: tuple[str, ...]
    unchanged: list[str] = field(default_factory=list)
    continued: dict[str, int] = field(default_factory=dict)
    rows: dict[str, array[int]] = field(default_factory=dict)
    renumbered: dict[str, Renumbered] = field(default_factory=dict)

    @property
    def is_empty(self) -> bool:
        return not (self.new or self.continued or self.domains)


@dataclass(frozen=True, slots=True)
class _StoredInstance:
    """`frame_poses` are those of frames that have other poses than their instances."""

    seq: int
    pose: tuple[float, float, float]
    checksums: dict[str, str]
    frame_poses: dict[str, tuple[float, float, float]]


class _DifferenceError(Exception):
    """The first difference of a trajectory from the stored one."""


def additions(scan: Scan, store: Store, progress: Callable[[int], None]) -> Additions:
    """What the scan, in the terms of the store, adds to it.

    `progress` is called with twice the number of compared frames. Raises RequestError for a
    trajectory that the store has with other images or poses, and for a new domain where the scan
    does not have all stored instances of a trajectory.
    """
    stored = {trajectory.trajectory for trajectory in store.trajectories}
    added = {
        domain
        for name, records in scan.trajectories.items()
        for domain in records[0].sources
        if domain not in store.domains or _lacks_images(store, name, domain)
    }
    domains = tuple(name for name in scan.domains if name in added)
    found = Additions(tuple(sorted(scan.trajectories.keys() - stored)), domains)
    for name in sorted(stored & scan.trajectories.keys()):
        try:
            first = _compare(scan, store, name, found, progress)
        except _DifferenceError as difference:
            raise _refusal(store, name, difference, domains) from None
        if first is None:
            found.unchanged.append(name)
        else:
            found.continued[name] = first
    return found


def _lacks_images(store: Store, trajectory: str, domain: str) -> bool:
    """Whether a domain lacks images of stored instances of a trajectory."""
    return any(part.trajectory == trajectory and part not in store.imaged_parts[domain]
               for part in store.trajectory_parts)  # fmt: skip


def imaged_domains(store: Store, trajectory: str) -> frozenset[str]:
    """The domains that have images of a stored trajectory; none of one that is not stored."""
    return frozenset(
        name
        for name, parts in store.imaged_parts.items()
        if any(part.trajectory == trajectory for part in parts)
    )


def stored_depth_types(store: Store, trajectory: str) -> dict[str, str]:
    """The numpy type of a trajectory's stored depth images in each domain with depth."""
    types: dict[str, str] = {}
    for name, parts in store.imaged_parts.items():
        part = next((part for part in parts if part.trajectory == trajectory), None)
        if part is not None and store.domain(name).has_depth:
            types[name] = store.frames_array(name, part, "depth").layout.dtype
    return types


def _refusal(
    store: Store, name: str, difference: _DifferenceError, domains: tuple[str, ...]
) -> RequestError:
    advice = "and stored instances are never replaced; give the trajectory another name"
    if domains:
        advice = (
            f"and domain {', '.join(domains)} needs an image of every stored instance of it; "
            "complete the source, or leave that domain out"
        )
    return RequestError(
        f"{store.path}: trajectory {name}: the source differs from what is stored ({difference}), "
        f"{advice}"
    )


def _stored_instances(store: Store, trajectory: str) -> Iterator[_StoredInstance]:
    """The instances of a trajectory in recording order."""
    query = """
        SELECT iid, any_value(seq), any_value(x), any_value(y), any_value(heading), list(domain),
               list(sha256)
        FROM instance JOIN frame USING (iid)
        WHERE iid >= ? AND iid < ? GROUP BY iid ORDER BY iid
    """
    pose_query = "SELECT iid, domain, x, y, heading FROM frame_pose WHERE iid >= ? AND iid < ?"
    for part in store.trajectory_parts:
        if part.trajectory != trajectory:
            continue
        for start in range(part.first_iid, part.stop, _BLOCK):
            stop = min(start + _BLOCK, part.stop)
            frame_poses: dict[int, dict[str, tuple[float, float, float]]] = defaultdict(dict)
            for iid, domain, *of_frame in store.execute(pose_query, [start, stop]):
                frame_poses[iid][domain] = (of_frame[0], of_frame[1], of_frame[2])
            for iid, seq, x, y, heading, domains, sums in store.execute(query, [start, stop]):
                known = None not in (x, y, heading)
                pose = (x, y, heading) if known else (math.nan, math.nan, math.nan)
                checksums = dict(zip(domains, sums, strict=True))
                yield _StoredInstance(seq, pose, checksums, frame_poses.get(iid, {}))


def _compare(
    scan: Scan, store: Store, name: str, found: Additions, progress: Callable[[int], None]
) -> int | None:
    """Compare a trajectory's usable records with the stored instances, up to the first further one.

    Adds the numbers of the records of stored instances to `found.rows`, and the trajectory to
    `found.renumbered` where their `seq` differs; gives the number of the first further record,
    None without one. The source may lack domains of stored instances, and have further ones.
    Records whose images cannot be decoded, or have another depth type,
    were left out when the trajectory was ingested. Raises _DifferenceError.
    """
    types, kept = stored_depth_types(store, name), imaged_domains(store, name)
    rows = found.rows.setdefault(name, array("i"))
    stored = _stored_instances(store, name)
    expected = next(stored, None)
    with ThreadPoolExecutor(_THREADS) as pool:
        compared = map_ahead(pool, partial(_checksums, scan, kept), scan.trajectories[name])
        for number, (record, checksums) in enumerate(compared):
            if expected is not None and all(
                expected.checksums.get(domain, sum) == sum for domain, sum in checksums.items()
            ):
                moved = _moved_frame(record, expected, checksums)
                if moved is not None:
                    raise _DifferenceError(f"the pose of {_file(scan, record, moved, len(rows))}")
                if record.seq is not None and record.seq != expected.seq:
                    found.renumbered.setdefault(name, Renumbered()).add(record.seq, expected.seq)
                rows.append(number)
                expected = next(stored, None)
            elif all(_is_usable(scan, record, domain, types) for domain in checksums):
                if expected is None:
                    return number
                domain = next(
                    d for d, sum in checksums.items() if expected.checksums.get(d, sum) != sum
                )
                raise _DifferenceError(_file(scan, record, domain, len(rows)))
            progress(2 * len(checksums))
    if expected is not None:
        raise _DifferenceError(f"only the first {len(rows)} of the stored instances")
    return None


def _moved_frame(
    record: InstanceRecord, stored: _StoredInstance, domains: Collection[str]
) -> str | None:
    """The first domain whose frame has another pose than the stored one, of its `domains`.

    A stored instance has the pose of one of its images; so its own pose is compared where the
    source has an image without a stored pose of its own.
    """
    pose = record.x, record.y, record.heading
    known = [domain for domain in domains if domain in stored.frame_poses]
    if (len(known) < len(domains) or not known) and not all(map(is_close, pose, stored.pose)):
        return next(iter(record.sources))
    for domain in known:
        found = record.frame_poses.get(domain)
        own = pose if found is None else astuple(found)[:3]
        if not all(map(is_close, own, stored.frame_poses[domain])):
            return domain
    return None


def _file(scan: Scan, record: InstanceRecord, domain: str, seq: int) -> str:
    """The files of a frame as messages name them."""
    files = [name for name in record.sources[domain].file_names(scan) if name is not None]
    return " or ".join(files) or f"instance {seq} in {domain}"


def _checksums(
    scan: Scan, domains: frozenset[str], record: InstanceRecord
) -> tuple[InstanceRecord, dict[str, str | None]]:
    """A record and the checksums of its frames in the stored domains."""
    sources = ((name, source) for name, source in record.sources.items() if name in domains)
    return record, {name: source.checksum(scan, scan.domains[name]) for name, source in sources}


def _is_usable(
    scan: Scan, record: InstanceRecord, domain: str, depth_types: Mapping[str, str]
) -> bool:
    frame = record.sources[domain].decode(scan, scan.domains[domain])
    if isinstance(frame, InputIssue):
        return False
    return depth_type(frame) == depth_types.get(domain, depth_type(frame))

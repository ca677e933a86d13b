"""Instances that are appended behind those of a trajectory."""

from __future__ import annotations

import json
import tempfile
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

import s2rstore
from s2rstore.errors import RequestError
from s2rstore.index import schema
from s2rstore.index.transaction import edit
from s2rstore.maintenance.verify import verify
from s2rtools.datasets.scan import Scan
from s2rtools.datasets.writing import build
from s2rtools.synthetic_world.dataset import WorldData, WorldRecipe
from tests.datasets.conftest import N
from tests.datasets.helpers import SIZE, add, files, ingest, kinds, rows_by_trajectory, scan_of
from tests.support import pairs
from tests.support.copies import copy_store

Counts = dict[str, int]


def cut(scan: Scan, counts: Counts) -> Scan:
    """The first records of each trajectory; those without one are left out."""
    kept = {name: scan.trajectories[name][:count] for name, count in counts.items() if count}
    return replace(scan, trajectories=kept, issues=[])


@pytest.fixture(scope="module")
def once(source: tuple[Path, Path], tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A store that all trajectories were ingested into at once."""
    store = tmp_path_factory.mktemp("once") / "s.s2r"
    ingest("sim2realviz", source[0], store, header=source[1])
    return store


def grow(scan: Scan, store: Path, stages: Sequence[Counts]) -> None:
    """Ingest the first stage and append the others."""
    build.build(cut(scan, stages[0]), store, "s2r ingest", True, lambda steps: None)
    for counts in stages[1:]:
        add(cut(scan, counts), store, strict=True)


STAGES = st.lists(
    st.fixed_dictionaries({name: st.integers(0, N) for name in "abc"}), min_size=1, max_size=3
)


def test_appending_in_two_pieces_equals_ingesting_at_once(scan: Scan, once: Path) -> None:
    check_pieces([{"a": 4, "b": 0, "c": 3}], scan, once)


@pytest.mark.deep
@settings(
    max_examples=8,
    suppress_health_check=[HealthCheck.function_scoped_fixture],
)  # fmt: skip
@given(drawn=STAGES)
def test_appending_in_pieces_equals_ingesting_at_once(
    drawn: list[Counts], scan: Scan, once: Path
) -> None:
    check_pieces(drawn, scan, once)


def check_pieces(drawn: Sequence[Counts], scan: Scan, once: Path) -> None:
    """Ingest one instance, append up to these counts and then the others; compare with `once`."""
    stages = [{"a": 1, "b": 0, "c": 0}]
    for counts in (*drawn, dict.fromkeys("abc", N)):
        stages.append({name: max(counts[name], stages[-1][name]) for name in "abc"})
    with tempfile.TemporaryDirectory() as folder:
        store = Path(folder) / "s.s2r"
        grow(scan, store, stages)
        assert rows_by_trajectory(store) == rows_by_trajectory(once)
        assert verify(store) == []
        with s2rstore.open(store) as opened, s2rstore.open(once) as other:
            everyone = np.ones(3 * N, dtype=np.bool_)
            ordered = opened.in_recording_order(everyone)
            names = [opened.instances.trajectory_names[k] for k in opened.instances.trajectory]
            assert [names[iid] for iid in ordered] == sorted(
                names, key=opened.instances.trajectory_names.index
            )
            for name in "abc":
                iids = opened.iids_of(name)
                assert (np.diff(iids) > 0).all()
                assert opened.instances.seq[iids].tolist() == list(range(N))
                expected = other.frames("real", *other.iids_of(name)[[0, -1]] + [0, 1])["rgb"]
                for iid, image in zip(iids.tolist(), expected, strict=True):
                    assert (opened.frame("real", iid).rgb == image).all()
            across = opened.frames("sim", 0, 3 * N)["rgb"]
            for iid in range(3 * N):
                assert (across[iid] == opened.frame("sim", iid).rgb).all()


def test_existing_iids_and_frames_stay_and_only_the_ends_change_their_curvature(
    scan: Scan, tmp_path: Path
) -> None:
    store = tmp_path / "s.s2r"
    grow(scan, store, [{"a": 5, "b": 2}])
    before = files(store)
    query = "FROM instance WHERE iid < 7 ORDER BY iid"
    with s2rstore.open(store) as opened:
        rows, frames = opened.execute(query), opened.execute("FROM frame ORDER BY ALL")
        column = [c.name for c in schema.BY_NAME["instance"].columns].index("curvature")
    lines: list[str] = []
    added = add(cut(scan, {"a": N, "b": 4, "c": 3}), store, lines=lines)
    assert added == {"a": N - 5, "b": 2, "c": 3}
    assert lines[:2] == [
        f"trajectory {n}: already in the store; its further instances are added" for n in "ab"
    ]
    after = files(store)
    assert {path: after[path] for path in before} == before
    with s2rstore.open(store) as opened:
        changed = [
            (was[0], {k for k, pair in enumerate(zip(was, now, strict=True)) if len({*pair}) > 1})
            for was, now in zip(rows, opened.execute(query), strict=True)
        ]
        assert changed == [(iid, {column} if iid in (2, 3, 4, 5, 6) else set()) for iid in range(7)]
        assert opened.execute("FROM frame WHERE iid < 7 ORDER BY ALL") == frames
        parts = [(p.trajectory, p.first_iid, p.instances, p.row) for p in opened.trajectory_parts]
        assert parts == [("a", 0, 5, 0), ("b", 5, 2, 0), ("a", 7, 3, 5), ("b", 10, 2, 2),
                         ("c", 12, 3, 0)]  # fmt: skip
        assert opened.iids_of("a").tolist() == [0, 1, 2, 3, 4, 7, 8, 9]
        assert opened.in_recording_order([11, 8, 0, 6]).tolist() == [0, 8, 6, 11]
        recorded = json.loads(opened.provenance("dataset")["append:1"])["trajectories"]
        assert recorded == {"a": 3, "b": 2, "c": 3}
        assert [t.instances for t in opened.trajectories] == [N, 4, 3]


def test_a_difference_in_any_piece_is_refused_by_name(scan: Scan, tmp_path: Path) -> None:
    store = tmp_path / "s.s2r"
    grow(scan, store, [{"a": 3}, {"a": 6}])
    before = files(store)
    whole = list(scan.trajectories["a"])
    other = scan.trajectories["b"]
    for row in (0, 2, 3, 5):
        file = whole[row].sources["sim"].file_names(scan)[0]
        scan.trajectories["a"] = [*whole[:row], replace(whole[row], x=0.5), *whole[row + 1 :]]
        with pytest.raises(RequestError, match=rf"trajectory a: .*\(the pose of {file}"):
            add(cut(scan, {"a": N}), store)
        scan.trajectories["a"] = [*whole[:row], other[row], *whole[row + 1 :]]
        file = other[row].sources["sim"].file_names(scan)[0]
        with pytest.raises(RequestError, match=rf"trajectory a: .*\({file} .*another name"):
            add(cut(scan, {"a": N}), store)
    scan.trajectories["a"] = whole[:5]
    with pytest.raises(RequestError, match="only the first 5 of the stored instances"):
        add(cut(scan, {"a": 5}), store)
    assert files(store) == before


def test_unusable_pairs_at_the_end_are_left_out(tmp_path: Path) -> None:
    header = pairs.sim2realviz(tmp_path / "data", n=N, trajectories=("a",))
    options = {"header": header}
    store = tmp_path / "s.s2r"
    first = scan_of("sim2realviz", tmp_path / "data", **options)
    broken = [str(first.trajectories["a"][row].sources["real"].files[0]) for row in (4, 6)]
    content = {name: Path(name).read_bytes() for name in broken}
    for name in broken:
        Path(name).write_bytes(content[name][:300])
    build.build(cut(first, {"a": 5}), store, "s2r ingest", False, lambda steps: None)
    lines: list[str] = []
    assert add(cut(first, {"a": 5}), store, lines=lines) == {}
    assert "nothing to append" in lines[-1]
    whole = cut(first, {"a": N})
    assert add(whole, store) == {"a": N - 6}
    assert kinds(whole) == {"unreadable image": 1}
    assert verify(store) == []
    with s2rstore.open(store) as opened:
        assert opened.instances.seq.tolist() == list(range(N - 2))


def test_further_pairs_must_have_the_depth_type_of_the_stored_ones(tmp_path: Path) -> None:
    manifest = pairs.manifest(tmp_path / "data")
    lines = manifest.read_text().splitlines(keepends=True)
    store = tmp_path / "s.s2r"
    manifest.write_text("".join(lines[:5]))
    ingest("csv", manifest, store)
    for number in range(3, 6):
        file = tmp_path / "data" / "sim" / f"{number}_depth.png"
        cv2.imwrite(str(file), cv2.imread(str(file), cv2.IMREAD_UNCHANGED).astype(np.uint16))
    manifest.write_text("".join(lines[:13]))
    grown = scan_of("csv", manifest)
    assert add(grown, store) == {"a": 1}
    assert kinds(grown) == {"mixed depth types": 3}
    assert verify(store) == []
    lines = list[str]()
    assert add(scan_of("csv", manifest), store, lines=lines) == {}
    with s2rstore.open(store) as opened:
        assert opened.frames("sim", 0, 3, ("depth",))["depth"].dtype == np.uint8


def test_verify_finds_instances_out_of_order(scan: Scan, tmp_path: Path) -> None:
    store = tmp_path / "s.s2r"
    grow(scan, store, [{"a": 3, "b": 1}, {"a": 5, "b": 1}])
    for number, change in enumerate(
        (
            "UPDATE instance SET seq = 9 WHERE iid = 1",
            "UPDATE instance SET trajectory = 'b' WHERE iid = 1",
            "UPDATE trajectory SET instances = 4",
        )
    ):
        own = copy_store(store, tmp_path / f"{number}.s2r")
        with edit(own) as draft:
            draft.rows(change)
        assert any(damage.where.startswith("table") for damage in verify(own)), change


def test_the_synthetic_world_knows_the_instances_of_continued_trajectories(tmp_path: Path) -> None:
    world = {"seed": 3, "count": 3}
    whole = replace(scan_of("world", Path(), world=world), drives=None)
    store = tmp_path / "w.s2r"
    grow(whole, store, [{"traj2": 2}, {"traj1": 1}, {"traj1": 3}])
    ((section, facts),) = whole.provenance.items()
    other = {section: {**facts, "recipe": {**facts["recipe"], "count": 4}}}
    with pytest.raises(RequestError, match="another recipe of"):
        add(replace(whole, provenance=other), store)
    with s2rstore.open(store) as opened:
        data = WorldData(WorldRecipe(**world, frame=SIZE[0]))
        assert data.matches(opened)
        assert data.noise_numbers(opened).tolist() == [1_000_000, 1_000_001, 0, 1, 2]

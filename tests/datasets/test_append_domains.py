"""Domains that are added to the instances of a store."""

from __future__ import annotations

import json
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import s2rstore
from s2rstore.errors import RequestError
from s2rstore.files import layout
from s2rstore.language import evaluation
from s2rstore.maintenance.prune import prune
from s2rstore.maintenance.verify import check, verify
from s2rtools.datasets.appending import append
from s2rtools.datasets.scan import Scan
from s2rtools.datasets.writing import build
from tests.datasets.conftest import N
from tests.datasets.helpers import add, files, ingest, kinds, rows_by_trajectory, scan_of
from tests.support import pairs
from tests.support.copies import copy_store

EDIT = "sim_edit"


@pytest.fixture(scope="module")
def edited(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    """Trajectories `a` and `b` with images in three domains, and their calibration."""
    folder = tmp_path_factory.mktemp("edited")
    return folder, pairs.sim2realviz(folder, n=N, trajectories=("a", "b"), edit=True)


@pytest.fixture
def whole(edited: tuple[Path, Path]) -> Scan:
    return scan_of("sim2realviz", edited[0], header=edited[1])


@pytest.fixture(scope="module")
def once(edited: tuple[Path, Path], tmp_path_factory: pytest.TempPathFactory) -> Path:
    store = tmp_path_factory.mktemp("once") / "s.s2r"
    ingest("sim2realviz", edited[0], store, header=edited[1])
    return store


def without(scan: Scan, **counts: int) -> Scan:
    """The scan without the edited images, with the first records of some trajectories."""
    domains = {name: domain for name, domain in scan.domains.items() if name != EDIT}
    trajectories = {
        name: [
            replace(r, sources={d: source for d, source in r.sources.items() if d != EDIT})
            for r in scan.trajectories[name][:count]
        ]
        for name, count in counts.items()
    }
    return replace(scan, domains=domains, trajectories=trajectories, issues=[])


def start(scan: Scan, store: Path, **counts: int) -> Path:
    build.build(without(scan, **counts), store, "s2r ingest", True, lambda steps: None)
    return store


@pytest.fixture(scope="module")
def plain_store(edited: tuple[Path, Path], tmp_path_factory: pytest.TempPathFactory) -> Path:
    """All instances without the edited images."""
    scan = scan_of("sim2realviz", edited[0], header=edited[1])
    return start(scan, tmp_path_factory.mktemp("plain") / "s.s2r", a=N, b=N)


@pytest.fixture
def plain(plain_store: Path, tmp_path: Path) -> Path:
    return copy_store(plain_store, tmp_path / "plain.s2r")


def test_a_domain_of_all_instances_is_added_and_nothing_else_changes(whole, once, plain):
    store = plain
    before = files(store)
    query = "FROM frame WHERE domain <> 'sim_edit' ORDER BY ALL"
    with s2rstore.open(store) as opened:
        rows = opened.execute("FROM instance ORDER BY iid"), opened.execute(query)
        identity, data_set = opened.identity, opened.dataset.hash
    steps: list[int] = []
    added = append.append(whole, store, "s2r ingest", True, steps.append)
    assert (added.instances, added.domains) == ({}, (EDIT,))
    assert sum(steps) == 2 * 3 * 2 * N
    after = files(store)
    assert {path: after[path] for path in before} == before
    assert rows_by_trajectory(store) == rows_by_trajectory(once)
    assert verify(store) == []
    assert check(store).notes == ()
    with s2rstore.open(store) as opened:
        assert (opened.execute("FROM instance ORDER BY iid"), opened.execute(query)) == rows
        assert opened.identity == identity == opened.parts[0].hash == data_set
        assert opened.dataset.hash != data_set
        assert layout.read_current(store).dataset_hash == opened.dataset.hash
        assert len(opened.parts) == 1
        assert opened.domains[EDIT] == whole.domains[EDIT]
        assert json.loads(opened.provenance("dataset")[f"domain:{EDIT}"])["problems"] == {}


def test_a_domain_and_further_instances_are_added_at_once(whole, once, tmp_path):
    store = start(whole, tmp_path / "s.s2r", a=2)
    add(without(whole, a=5, b=3), store)
    with s2rstore.open(store) as opened:
        data_set, hashes = opened.dataset.hash, [part.hash for part in opened.parts]
    lines: list[str] = []
    assert add(whole, store, strict=True, lines=lines) == {"a": N - 5, "b": N - 3}
    assert lines[:2] == [
        f"trajectory {name}: already in the store; its further instances are added" for name in "ab"
    ]
    assert rows_by_trajectory(store) == rows_by_trajectory(once)
    assert verify(store) == []
    with s2rstore.open(store) as opened:
        assert [part.hash for part in opened.parts[:2]] == hashes
        assert opened.dataset.hash != data_set
    assert prune(store, keep=1).bytes > 0
    assert verify(store) == []


def test_the_hash_of_the_data_set_depends_on_the_images_of_an_added_domain(whole, tmp_path):
    hashes, first = [], start(whole, tmp_path / "first.s2r", a=3)
    for number in range(3):
        store = copy_store(first, tmp_path / f"{number}.s2r")
        scan = replace(whole, trajectories={"a": list(whole.trajectories["a"][:3])})
        if number == 2:
            first, second, third = scan.trajectories["a"]
            other = {**second.sources, EDIT: first.sources[EDIT]}
            scan.trajectories["a"] = [first, replace(second, sources=other), third]
        add(scan, store)
        with s2rstore.open(store) as opened:
            hashes.append(opened.dataset.hash)
    assert hashes[0] == hashes[1] != hashes[2]


def test_instances_that_lack_a_domain_get_its_images_later(whole, once, tmp_path):
    """Behind those of a trajectory and as a new one; others of both have them already."""
    store = tmp_path / "s.s2r"
    part = replace(whole, trajectories={"a": whole.trajectories["a"][:4]}, issues=[])
    build.build(part, store, "s2r ingest", True, lambda steps: None)
    assert add(without(whole, a=6, b=3), store) == {"a": 2, "b": 3}
    assert add(without(whole, a=6, b=3), store) == {}
    third = replace(whole, trajectories={"c": whole.trajectories["b"]}, issues=[])
    assert add(third, store) == {"c": N}
    assert verify(store) == []
    lacking = copy_store(store, tmp_path / "lacking.s2r")
    with s2rstore.open(store) as opened:
        assert opened.imaged_ranges("sim", "real") == [range(4), range(4, 9), range(9, 9 + N)]
        assert opened.imaged_ranges(EDIT, "real") == [range(4), range(9, 9 + N)]
        assert opened.frame(EDIT, 9).rgb.any()
        with pytest.raises(RequestError, match=r"sim_edit has no images of trajectory a \(domains"):
            opened.frame(EDIT, 4)
    shutil.rmtree(lacking / "frames.zarr" / "sim" / "a@1" / "depth")
    assert any("sim/a@1/depth" in damage.where for damage in verify(lacking))
    assert add(whole, store) == {"a": N - 6, "b": N - 3}
    assert verify(store) == []
    with s2rstore.open(store) as opened:
        assert opened.imaged(EDIT).all()
    added, expected = rows_by_trajectory(store), rows_by_trajectory(once)
    assert {name: added[name] for name in ("sim_edit a", "sim_edit b", "domain")} == {
        name: expected[name] for name in ("sim_edit a", "sim_edit b", "domain")
    }


@pytest.mark.parametrize(("first", "second"), [("a", "b"), ("b", "a")], ids=["without", "with"])
def test_a_trajectory_of_other_domains_is_appended(whole, tmp_path, first, second):
    """Trajectory `a` has edited images, `b` none; further ones have one side."""
    store = tmp_path / "s.s2r"
    records = {"a": whole.trajectories["a"], "b": without(whole, b=N).trajectories["b"]}
    build.build(
        replace(whole, trajectories={first: records[first]}, issues=[],
                domains={d: whole.domains[d] for d in records[first][0].sources}),
        store, "s2r ingest", True, lambda steps: None,
    )  # fmt: skip
    sides = {
        side: [replace(r, sources={side: r.sources[side]}) for r in whole.trajectories["b"][:3]]
        for side in ("sim", "real")
    }
    added = replace(whole, trajectories={second: records[second], **sides}, issues=[])
    assert add(added, store) == {second: N, "sim": 3, "real": 3}
    assert verify(store) == []
    with s2rstore.open(store) as opened:
        for text, names in (
            ("has:sim_edit", "a"), ("paired", "a b"), ("has:real", "a b real"),
            ("has:sim - paired", "sim"),
        ):  # fmt: skip
            expected = np.sort(np.concatenate([opened.iids_of(name) for name in names.split()]))
            query, parameters = evaluation.sql(opened, text, evaluation.NO_RUN)
            rows = opened.execute(query, parameters)
            assert sorted(row[0] for row in rows) == expected.tolist(), text
            chosen = evaluation.select(opened, text, evaluation.NO_RUN)
            assert np.flatnonzero(chosen).tolist() == expected.tolist(), text


@pytest.mark.parametrize("trajectory", ["a", "c"])
def test_a_new_domain_may_image_some_trajectories(whole, tmp_path, trajectory):
    """A stored one, or one that is added with it."""
    store = start(whole, tmp_path / "s.s2r", a=N, b=4)
    records = whole.trajectories["a"]
    if trajectory == "c":
        edits = {EDIT: whole.domains[EDIT]}
        records = [replace(r, sources={EDIT: r.sources[EDIT]}) for r in records]
        whole = replace(whole, domains=edits)
    add(replace(whole, trajectories={trajectory: records}), store)
    assert verify(store) == []
    with s2rstore.open(store) as opened:
        assert np.flatnonzero(opened.imaged(EDIT)).tolist() == opened.iids_of(trajectory).tolist()


def test_a_domain_of_some_instances_is_refused_by_name(whole, edited, tmp_path):
    store = start(whole, tmp_path / "s.s2r", a=N, b=4)
    before = files(store)
    for trajectories, message in (
        (
            {**whole.trajectories, "a": whole.trajectories["a"][:-1]},
            rf"trajectory a: .*only the first {N - 1} of the stored .* domain sim_edit",
        ),
        (
            {**whole.trajectories, "b": whole.trajectories["b"][1:]},
            "trajectory b: the source differs .* sim_edit needs an image of every stored instance",
        ),
    ):
        with pytest.raises(RequestError, match=message):
            add(replace(whole, trajectories=trajectories), store)
    assert files(store) == before


def test_an_unusable_image_of_a_new_domain_is_refused_by_name(tmp_path):
    header = pairs.sim2realviz(tmp_path / "data", n=N, trajectories=("a",), edit=True)
    whole = scan_of("sim2realviz", tmp_path / "data", header=header)
    store = start(whole, tmp_path / "s.s2r", a=N)
    before = files(store)
    broken = whole.trajectories["a"][5].sources[EDIT].files[0]
    content = broken.read_bytes()
    broken.write_bytes(content[:200])
    with pytest.raises(RequestError, match=rf"a/sim_edit/{broken.name}: unreadable image.*every"):
        add(whole, store)
    assert files(store) == before
    broken.unlink()
    missing = scan_of("sim2realviz", tmp_path / "data", header=header)
    with pytest.raises(RequestError, match=r"trajectory a: .*sim_edit needs an image of every"):
        add(missing, store)
    assert kinds(missing)["missing image"] == 1
    broken.write_bytes(content)
    add(scan_of("sim2realviz", tmp_path / "data", header=header), store)
    assert verify(store) == []

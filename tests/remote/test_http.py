"""A store on a web server gives the results of the folder that is served, and only reads it."""

import hashlib
import os
from pathlib import Path

import msgspec
import numpy as np
import pytest

import s2rstore
from s2rstore.errors import DamagedStoreError, RequestError, UnreachableStoreError
from s2rstore.files import layout
from s2rstore.index import row_files
from s2rstore.index.transaction import edit
from s2rstore.maintenance.verify import check
from s2rstore.remote.object_client import MAX_RETRIES
from s2rstore.remote.open_files import open_files
from s2rtui.cli import main

SHARD = "runs.zarr/vanilla/key0/feature_distance/c.0.0.0"
COMMANDS = (
    ("query", "{store}", "worst15 | room:right", "--format", "csv"),
    ("sql", "{store}", "SELECT run, count(*), sum(gap_m) FROM pair GROUP BY run ORDER BY run"),
    ("runs", "{store}", "--json"),
    ("findings", "{store}", "--json"),
    *(("show", "{store}", view) for view in ("instance", "compare")),
    ("export", "{store}", "--view", "instance", "--heat", "occlusion:rgb", "--out", "{out}.png"),
    ("export", "{store}", "--view", "map", "--heat", "feature_distance", "--on", "selection",
     "--select", "worst15", "--out", "{out}.png"),
    ("snapshot", "{store}", "--size", "160x48", "--keys", "3,n,h,o", "--out", "{out}.txt"),
)  # fmt: skip


def content(folder: Path) -> dict[str, tuple[int, str]]:
    """Modification time and checksum of every file below a folder."""
    return {
        path.relative_to(folder).as_posix(): (
            path.stat().st_mtime_ns,
            hashlib.sha256(path.read_bytes()).hexdigest(),
        )
        for path in folder.rglob("*")
        if path.is_file()
    }


def output(words: tuple[str, ...], store: str, out: Path, capsys) -> tuple[str, bytes]:
    """What a command prints and writes; it must succeed."""
    code = main([word.format(store=store, out=out) for word in words])
    printed = capsys.readouterr()
    assert code == 0, printed.err
    files = sorted(out.parent.glob(f"{out.name}.*"))
    written = b"".join(file.read_bytes() for file in files)
    for file in files:
        file.unlink()
    return printed.out, written


@pytest.mark.parametrize("words", COMMANDS, ids=lambda words: "-".join((words[0], *words[2:5])))
def test_commands_give_equal_results(words, served, tmp_path, capsys):
    local = output(words, str(served.path), tmp_path / "out", capsys)
    before = content(served.path)
    remote = output(words, served.url, tmp_path / "out", capsys)
    assert remote == local
    assert any(local)
    assert served.server.requests
    assert served.server.methods <= {"GET", "HEAD"}
    assert content(served.path) == before


def test_every_stored_array_is_equal(served):
    with s2rstore.open(served.path) as local, s2rstore.open(served.url) as remote:
        assert (remote.generation, remote.identity) == (local.generation, local.identity)
        for run in local.runs:
            for record in local.array_parts(run):
                assert np.array_equal(remote.stored(record)[:], local.stored(record)[:])
        for domain in local.domains:
            for iid in range(len(local.instances)):
                a, b = local.frame(domain, iid), remote.frame(domain, iid)
                assert np.array_equal(a.rgb, b.rgb)
                assert np.array_equal(a.depth, b.depth)


def test_one_instance_costs_few_small_requests(served):
    with s2rstore.open(served.url) as store:
        store.heatmap("vanilla", "feature_distance", "sim", 3)
        served.server.requests.clear()
        store.heatmap("vanilla", "feature_distance", "sim", 3)
        assert not served.server.requests
        store.heatmap("vanilla", "feature_distance", "sim", 20)
    assert len(served.server.requests) == 2


def test_a_server_without_byte_ranges_works(served):
    served.server.fail("", "whole")
    with s2rstore.open(served.path) as local, s2rstore.open(served.url) as remote:
        a = local.heatmaps("vanilla", "occlusion", "real", 0, 40, "rgb")
        assert np.array_equal(remote.heatmaps("vanilla", "occlusion", "real", 0, 40, "rgb"), a)


# --- faults ---------------------------------------------------------------------------------------


def test_a_missing_shard_is_an_error_that_names_it(served, s2r):
    served.server.fail(SHARD, "missing")
    with (
        s2rstore.open(served.url) as store,
        pytest.raises(DamagedStoreError, match=f"{served.url}/{SHARD}: missing"),
    ):
        store.heatmap("vanilla", "feature_distance", "sim", 0)
    line = s2r("verify", served.url).checked(1).out.splitlines()[-1]
    assert line.split(maxsplit=1) == [SHARD, "missing; push the store again"]


@pytest.mark.parametrize(
    ("fault", "reason"),
    [
        ("denied", "access denied, 403"),
        ("login", "the server asks for a login, 401"),
        ("closed", "the server closed the connection without an answer"),
        ("garbled", "what answers is no web server"),
        ("failing", "the server answered 503"),
        ("cut", "the connection was cut"),
        ("slow", "no answer within 0.2 s"),
    ],
)
def test_a_shard_that_cannot_be_had_is_no_damage(fault, reason, served, monkeypatch, s2r):
    monkeypatch.setenv("S2R_REMOTE_TIMEOUT", "0.2" if fault == "slow" else "20")
    served.server.fail(SHARD, fault)
    with s2rstore.open(served.url) as store:
        served.server.requests.clear()
        with pytest.raises(UnreachableStoreError, match=reason) as error:
            store.heatmap("vanilla", "feature_distance", "sim", 0)
    assert f"{served.url}/{SHARD}" in str(error.value)
    attempts = [path for _, path in served.server.requests if path.endswith(SHARD)]
    assert 1 <= len(attempts) <= MAX_RETRIES + 1
    s2r("verify", served.url).assert_refused(reason)


@pytest.mark.parametrize("fault", ["failing", "cut"])
def test_a_passing_fault_is_survived(fault, served):
    served.server.fail(SHARD, fault, times=2)
    with s2rstore.open(served.path) as local, s2rstore.open(served.url) as remote:
        name = "vanilla", "feature_distance", "sim", 0
        assert np.array_equal(remote.heatmap(*name), local.heatmap(*name))
    assert served.server.faults[SHARD][1] == 0


@pytest.mark.parametrize("command", ["query", "verify", "tui"])
def test_a_cut_connection_is_one_line(command, served, monkeypatch, s2r):
    monkeypatch.setenv("TERM", "xterm-256color")
    monkeypatch.setattr("s2rtui.terminal.capabilities.refuse_unusable", lambda: None)
    served.server.fail("index-", "cut")
    words = [command, served.url, *(["all"] if command == "query" else [])]
    printed = s2r(*words).checked(2)
    assert not printed.out
    assert printed.err.splitlines() == [
        f"s2r: {served.url}/index/index-000002.duckdb: cannot be read (the connection was cut; "
        "try again)"
    ]


def test_a_server_that_is_gone_and_a_folder_without_a_store_are_one_line(served, s2r):
    s2r("runs", "http://127.0.0.1:9/own.s2r").assert_refused("no connection to the server")
    url = f"{served.url}/nothing"
    s2r("runs", url).assert_refused(f"{url}: not a store (no CURRENT.json there)")


def test_a_shard_that_is_replaced_between_two_requests_is_noticed(served):
    with open_files(served.url).open(SHARD) as file:
        _, size = file.tail(20)
        os.utime(served.path / SHARD)  # another ETag
        with pytest.raises(RequestError, match="was replaced while it was read"):
            file.piece(0, size - 20)


# --- the index and its copy -----------------------------------------------------------------------


def test_the_index_is_copied_once_and_compared(served, cache_folder):
    s2rstore.open(served.url).close()
    (copy,) = cache_folder.rglob("*.duckdb")
    sha256 = layout.read_current(served.path).sha256
    assert sha256 in str(copy)
    assert hashlib.sha256(copy.read_bytes()).hexdigest() == sha256
    served.server.requests.clear()
    s2rstore.open(served.url).close()
    assert served.server.requests == [("GET", f"{served.url.split('/', 3)[3]}/CURRENT.json")]
    copy.write_bytes(copy.read_bytes()[:-1] + b"x")
    served.server.requests.clear()
    s2rstore.open(served.url).close()
    assert hashlib.sha256(copy.read_bytes()).hexdigest() == sha256


def test_an_index_that_is_not_as_published_is_refused(served, cache_folder, s2r):
    index = served.path / layout.read_current(served.path).index
    index.write_bytes(index.read_bytes()[:-1] + b"x")
    with pytest.raises(DamagedStoreError, match="its checksum is not the published one"):
        s2rstore.open(served.url)
    assert not [path for path in cache_folder.rglob("*") if path.is_file()]
    assert (
        "its size or checksum is not the published one" in s2r("verify", served.url).checked(1).out
    )


def test_an_index_of_another_size_or_beyond_the_disk_is_refused(served):
    current = layout.read_current(served.path)
    for size, message in (
        (current.bytes - 1, f"instead of the published {current.bytes - 1}"),
        (current.bytes + 1, f"instead of the published {current.bytes + 1}"),
        (2**60, "do not fit"),
    ):
        served.server.requests.clear()
        layout.write_current(served.path, msgspec.structs.replace(current, bytes=size))
        with pytest.raises(RequestError, match=message):
            s2rstore.open(served.url)
    assert not [path for _, path in served.server.requests if path.endswith(".duckdb")]


def test_a_cache_that_others_may_write_is_not_used(served, cache_folder):
    cache_folder.mkdir(parents=True)
    cache_folder.chmod(0o777)
    with s2rstore.open(served.url) as store:
        assert len(store.instances) == 40
    assert not list(cache_folder.iterdir())


def test_a_new_generation_is_noticed_and_the_old_one_stays(served):
    with s2rstore.open(served.url) as store:
        number = store.generation
        with edit(served.path) as draft:
            draft.set_provenance("test", {"key": "value"})
        assert store.latest_generation() == number + 1
        assert store.generation == number
        assert store.provenance("test") == {}
        with s2rstore.open(served.url) as newer:
            assert newer.provenance("test") == {"key": "value"}
        with s2rstore.open(served.url, generation=number) as older:
            assert older.provenance("test") == {}


def test_an_earlier_generation_that_was_never_copied_is_refused(served):
    with pytest.raises(RequestError, match="not the published generation"):
        s2rstore.open(served.url, generation=1)


def test_rows_in_files_are_copied_and_shared_by_generations(served, monkeypatch):
    monkeypatch.setattr(row_files, "MAX_ROWS", 0)
    with edit(served.path):
        pass
    query = "SELECT run, side, sum(x), count(*) FROM prediction GROUP BY ALL ORDER BY ALL"
    with s2rstore.open(served.path) as local, s2rstore.open(served.url) as remote:
        assert remote.row_files
        assert remote.execute(query) == local.execute(query)
    with edit(served.path) as draft:
        draft.set_provenance("test", {"key": "value"})
    served.server.requests.clear()
    with s2rstore.open(served.url) as remote:
        assert remote.provenance("test") == {"key": "value"}
        remote.execute(query)
    assert not [path for _, path in served.server.requests if path.endswith(".parquet")]
    assert not check(served.url).damages


# --- hostile servers ------------------------------------------------------------------------------


def test_a_huge_current_json_is_not_read(served):
    (served.path / layout.CURRENT).write_bytes(b" " * 70_000)
    with pytest.raises(RequestError, match="70000 bytes, at most 65536 are read"):
        s2rstore.open(served.url)


@pytest.mark.parametrize(
    "change",
    [{"index": "../../index-000002.duckdb"}, {"index": "/etc/passwd"}, {"generation": 3},
     {"sha256": "../../../x"}, {"sha256": "A" * 64}, {"bytes": -1}],
)  # fmt: skip
def test_a_hostile_current_json_leads_nowhere(change, served, cache_folder):
    path = served.path / layout.CURRENT
    path.write_bytes(msgspec.json.encode({**msgspec.json.decode(path.read_bytes()), **change}))
    with pytest.raises(RequestError):
        s2rstore.open(served.url)
    assert not [path for path in cache_folder.rglob("*") if path.is_file()]


def test_names_from_an_index_stay_below_the_url(served):
    with edit(served.path) as draft:
        path = "../../other.s2r/runs.zarr/x"
        draft.update("zarr_array", {"kind": "feature_distance"}, {"path": path})
    with s2rstore.open(served.url) as store, pytest.raises(RequestError, match="lies outside"):
        store.heatmap("vanilla", "feature_distance", "sim", 0)
    assert all("other.s2r" not in path for _, path in served.server.requests)

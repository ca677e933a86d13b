"""Run `s2r serve` as a separate process."""

import re
import socket
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from bench.support.processes import applications_below, program_environment, wait_until

StartServer = Callable[..., "ServerProcess"]


@dataclass(frozen=True, slots=True)
class ServerProcess:
    """A running server process."""

    port: int
    process: subprocess.Popen[str]
    data_home: Path
    token: str

    @property
    def root(self) -> str:
        return f"http://127.0.0.1:{self.port}/"

    @property
    def url(self) -> str:
        """The address of the page, with its token."""
        return f"{self.root}?token={self.token}"

    @property
    def socket(self) -> str:
        """The WebSocket address of a session."""
        return f"{self.root}ws/{self.token}".rstrip("/")

    @property
    def applications(self) -> list[int]:
        """Process ids of the applications that the server has started."""
        return applications_below(self.process.pid)


@contextmanager
def servers(store: Path, data_home: Path) -> Iterator[StartServer]:
    """A function that starts servers of a store in the folder `cwd`; all end with the context."""
    started: list[ServerProcess] = []
    (data_home / "s2rtui").mkdir(parents=True)
    (data_home / "s2rtui" / "toured").touch()

    def start(*options: str, cwd: Path | None = None) -> ServerProcess:
        port = _free_port()
        command = [sys.executable, "-P", "-m", "s2rtui", "serve", str(store), "--port", str(port)]
        environment = program_environment(XDG_DATA_HOME=str(data_home))
        environment.pop("PYTHONSAFEPATH", None)
        process = subprocess.Popen(
            [*command, *options], stdout=subprocess.PIPE, text=True, env=environment, cwd=cwd
        )
        line = process.stdout.readline()
        token = re.search(r"token=([\w-]+)", line)
        started.append(ServerProcess(port, process, data_home, token[1] if token else ""))
        assert store.name in line, line
        assert wait_until(lambda: _listens(port))
        return started[-1]

    try:
        yield start
    finally:
        for server in started:
            server.process.terminate()
            server.process.communicate(timeout=30)


def _listens(port: int) -> bool:
    try:
        socket.create_connection(("127.0.0.1", port), 1).close()
    except OSError:
        return False
    return True


def _free_port() -> int:
    with socket.socket() as listener:
        listener.bind(("127.0.0.1", 0))
        return int(listener.getsockname()[1])

"""A private OpenSSH server on the loopback interface, with temporary keys and free ports."""

from __future__ import annotations

import getpass
import os
import shlex
import shutil
import socket
import subprocess
import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

_PROGRAMS = ("sshd", "ssh", "ssh-keygen")
_PATH = os.pathsep.join((os.environ.get("PATH", ""), "/usr/sbin", "/sbin"))
_SEPARATION = Path("/run/sshd")
_CONFIGURATION = """
Port {port}
Port {forced_port}
ListenAddress 127.0.0.1
HostKey {folder}/host_key
AuthorizedKeysFile {folder}/authorized_keys
PidFile {folder}/sshd.pid
StrictModes no
UsePAM no
PasswordAuthentication no
KbdInteractiveAuthentication no
PermitRootLogin prohibit-password
MaxStartups 50
MaxSessions 50
PrintMotd no
PrintLastLog no
AcceptEnv LANG LC_* COLORTERM NO_COLOR
SetEnv {environment}
Subsystem sftp internal-sftp

Match LocalPort {forced_port}
    ForceCommand {forced}
    DisableForwarding yes
    PermitUserRC no
"""


def missing_program() -> str | None:
    """The first of the programs needed that this machine lacks."""
    return next((name for name in _PROGRAMS if shutil.which(name, path=_PATH) is None), None)


def application(store: Path, *options: str) -> list[str]:
    """The command that opens the application, as a server's account would run it."""
    return [sys.executable, "-m", "s2rtui", "tui", *options, str(store)]


@dataclass(frozen=True, slots=True)
class Sshd:
    """A running server: `port` gives a shell, `forced_port` only the restricted application."""

    folder: Path
    port: int
    forced_port: int
    process: subprocess.Popen[bytes]

    @property
    def pid(self) -> int:
        return self.process.pid

    @property
    def data_home(self) -> Path:
        """XDG_DATA_HOME of whoever logs in."""
        return self.folder / "data"

    def login(
        self, *command: str, forced: bool = False, tty: bool = True, options: Sequence[str] = ()
    ) -> list[str]:
        """The `ssh` call that logs in and runs `command` (words are quoted for the far shell)."""
        return [
            "ssh", "-F", "/dev/null", *self._client_options,
            "-p", str(self.forced_port if forced else self.port), "-tt" if tty else "-T", *options,
            f"{getpass.getuser()}@127.0.0.1", shlex.join(command),
        ]  # fmt: skip

    @property
    def _client_options(self) -> list[str]:
        values = (
            f"IdentityFile={self.folder}/client_key", "IdentitiesOnly=yes", "IdentityAgent=none",
            f"UserKnownHostsFile={self.folder}/known_hosts", "GlobalKnownHostsFile=/dev/null",
            "StrictHostKeyChecking=accept-new", "LogLevel=ERROR", "BatchMode=yes",
            "ServerAliveInterval=0", "SendEnv=NO_COLOR COLORTERM LANG", "EscapeChar=none",
        )  # fmt: skip
        return [part for value in values for part in ("-o", value)]

    def copy(self, program: str, *arguments: str, forced: bool) -> list[str]:
        """A call of `scp` or `sftp`; HOST in the arguments stands for the account."""
        port = self.forced_port if forced else self.port
        host = f"{getpass.getuser()}@127.0.0.1"
        words = [argument.replace("HOST", host) for argument in arguments]
        return [program, "-F", "/dev/null", *self._client_options, "-P", str(port), *words]

    def stop(self) -> None:
        self.process.terminate()
        self.process.wait(20)


def start(folder: Path, store: Path) -> Sshd:
    """Start a server whose forced account opens `store`. Raises RuntimeError with its log."""
    folder.mkdir(parents=True, exist_ok=True)
    if os.geteuid() == 0:
        _SEPARATION.mkdir(mode=0o755, exist_ok=True)
    for name in ("host_key", "client_key"):
        _keygen(folder / name)
    shutil.copy(folder / "client_key.pub", folder / "authorized_keys")
    (folder / "data" / "s2rtui").mkdir(parents=True)
    (folder / "data" / "s2rtui" / "toured").touch()
    port, forced_port = _free_ports(2)
    environment = {
        "PYTHONPATH": os.pathsep.join(path for path in sys.path if path),
        "XDG_DATA_HOME": str(folder / "data"),
        "LANG": "C.UTF-8",
        "OMP_NUM_THREADS": "1",
    }
    text = _CONFIGURATION.format(
        folder=folder, port=port, forced_port=forced_port,
        environment=" ".join(f'{name}="{value}"' for name, value in environment.items()),
        forced=shlex.join(application(store, "--restricted")),
    )  # fmt: skip
    (folder / "sshd_config").write_text(text)
    server = shutil.which("sshd", path=_PATH)
    assert server is not None
    with (folder / "sshd.log").open("wb") as log:
        process = subprocess.Popen(
            [server, "-D", "-e", "-f", str(folder / "sshd_config")], stderr=log
        )
    made = Sshd(folder, port, forced_port, process)
    _wait_until_listening(made)
    return made


def _keygen(path: Path) -> None:
    made = ["ssh-keygen", "-q", "-t", "ed25519", "-N", "", "-C", "test", "-f", str(path)]
    subprocess.run(made, check=True)


def _free_ports(count: int) -> list[int]:
    held = [socket.socket() for _ in range(count)]
    try:
        for one in held:
            one.bind(("127.0.0.1", 0))
        return [int(one.getsockname()[1]) for one in held]
    finally:
        for one in held:
            one.close()


def _wait_until_listening(server: Sshd, patience: float = 20.0) -> None:
    limit = time.monotonic() + patience
    while time.monotonic() < limit and server.process.poll() is None:
        try:
            socket.create_connection(("127.0.0.1", server.forced_port), 1).close()
            return
        except OSError:
            time.sleep(0.05)
    server.process.kill()
    raise RuntimeError(f"sshd does not listen: {(server.folder / 'sshd.log').read_text()}")

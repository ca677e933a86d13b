"""Enforcement of permissions in the whole process by an audit hook, for code of any library."""

from __future__ import annotations

import os
import sys
import termios
import tty
from collections.abc import Callable, MutableMapping
from functools import partial
from pathlib import Path
from typing import Any

from s2rtui.security.permissions import Permissions

WEB_DRIVER = "textual.drivers.web_driver:WebDriver"
SERVER_VARIABLE = "S2R_SERVER"
"""Environment variable with the process id of the server that started a session."""

_DEVICES = ("/dev/null", "/dev/tty")
_WRITE_FLAGS = os.O_WRONLY | os.O_RDWR | os.O_CREAT | os.O_TRUNC | os.O_APPEND
_PROCESS_EVENTS = ("subprocess.Popen", "pty.spawn", "os.exec", "os.fork", "os.forkpty",
                   "os.posix_spawn", "os.spawn", "os.system")  # fmt: skip
_NETWORK_EVENTS = ("socket.connect", "socket.bind", "socket.sendto", "socket.sendmsg")
_MODEL_PACKAGES = ("torch", "s2rtools", "openvino")
_PATH_EVENTS = {
    "os.chmod": 1, "os.chown": 1, "os.link": 2, "os.mkdir": 1, "os.remove": 1, "os.rename": 2,
    "os.rmdir": 1, "os.setxattr": 1, "os.symlink": 2, "os.truncate": 1, "os.utime": 1,
}  # fmt: skip
"""Audit events that change files, with the number of their leading arguments that are paths."""


def is_served(environment: MutableMapping[str, str] | None = None) -> bool:
    """Whether `s2r serve` started this process, with pipes to a browser in place of a terminal."""
    env = os.environ if environment is None else environment
    return env.get("TEXTUAL_DRIVER") == WEB_DRIVER


def clean_environment(environment: MutableMapping[str, str]) -> None:
    """Remove variables that make Textual load code, write files, press keys or open connections."""
    served = is_served(environment)
    for name in [name for name in environment if name.startswith("TEXTUAL")]:
        del environment[name]
    if served:
        environment["TEXTUAL_DRIVER"] = WEB_DRIVER


def server_process_id() -> int | None:
    """Return the process id of the server of a served session."""
    text = os.environ.get(SERVER_VARIABLE, "")
    return int(text) if text.isdecimal() else None


def restrict_process(permissions: Permissions) -> None:
    """Enforce permissions until the process ends.

    Forbidden file changes, programs and network connections raise PermissionError. This protects
    against defects of the program; it is no sandbox for hostile code inside the process.
    """
    clean_environment(os.environ)
    os.environ["MPLCONFIGDIR"] = str(permissions.user_data_dir / "matplotlib")
    os.environ["XDG_CACHE_HOME"] = str(permissions.user_data_dir / "cache")
    _disable_signal_keys()
    sys.dont_write_bytecode = True
    sys.addaudithook(_audit_hook(permissions))


def _disable_signal_keys() -> None:
    """Turn off signals from keys such as ctrl+z, which would suspend the starting program."""
    if not os.isatty(0):
        return
    attributes = termios.tcgetattr(0)
    attributes[tty.LFLAG] &= ~termios.ISIG
    termios.tcsetattr(0, termios.TCSANOW, attributes)


def _audit_hook(permissions: Permissions) -> Callable[[str, tuple[Any, ...]], None]:
    checks: dict[str, Callable[[tuple[Any, ...]], None]] = {
        "open": partial(_check_open, permissions),
        "import": _check_import,
    }
    for event, count in _PATH_EVENTS.items():
        checks[event] = partial(_check_paths, permissions, count)
    for event in (*_PROCESS_EVENTS, *_NETWORK_EVENTS):
        checks[event] = partial(_refuse, event)

    def audit(event: str, arguments: tuple[Any, ...]) -> None:
        check = checks.get(event)
        if check is not None:
            check(arguments)

    return audit


def _check_open(permissions: Permissions, arguments: tuple[Any, ...]) -> None:
    path, mode, flags = arguments
    writes = any(letter in mode for letter in "wax+") if mode else bool(flags & _WRITE_FLAGS)
    if writes:
        _check_paths(permissions, 1, (path,))


def _check_paths(permissions: Permissions, count: int, arguments: tuple[Any, ...]) -> None:
    for path in arguments[:count]:
        if isinstance(path, int) or path in _DEVICES:
            continue
        if not permissions.may_write(Path(os.fsdecode(path))):
            raise PermissionError(1, "not allowed in a restricted session", os.fsdecode(path))


def _check_import(arguments: tuple[Any, ...]) -> None:
    if str(arguments[0]).split(".")[0] in _MODEL_PACKAGES:
        raise ImportError(f"{arguments[0]}: a restricted session loads no models")


def _refuse(event: str, arguments: tuple[Any, ...]) -> None:
    raise PermissionError(1, f"{event}: not allowed in a restricted session")

"""A restricted process: what `Permissions` forbids raises wherever it is tried, in any library."""

from __future__ import annotations

import ctypes
import os
import signal
import sys
import termios
import threading
import time
import tty
from collections.abc import Callable, Iterable, MutableMapping
from contextlib import suppress
from functools import partial
from pathlib import Path
from typing import Any

from s2rtui.security.permissions import Permissions

WEB_DRIVER = "textual.drivers.web_driver:WebDriver"
SERVER_VARIABLE = "S2R_SERVER"
"""Names the process id of the server that started a session."""

_PR_SET_PDEATHSIG = 1
_DEVICES = ("/dev/null", "/dev/tty")
_WRITING = os.O_WRONLY | os.O_RDWR | os.O_CREAT | os.O_TRUNC | os.O_APPEND
_PROGRAMS = ("subprocess.Popen", "pty.spawn", "os.exec", "os.fork", "os.forkpty", "os.posix_spawn",
             "os.spawn", "os.system")  # fmt: skip
_NETWORK = ("socket.connect", "socket.bind", "socket.sendto", "socket.sendmsg")
_MODELS = ("torch", "s2rtools", "openvino")
# Which arguments of an event are paths that it changes.
_CHANGES = {
    "os.chmod": 1, "os.chown": 1, "os.link": 2, "os.mkdir": 1, "os.remove": 1, "os.rename": 2,
    "os.rmdir": 1, "os.setxattr": 1, "os.symlink": 2, "os.truncate": 1, "os.utime": 1,
}  # fmt: skip


def is_served(environment: MutableMapping[str, str] | None = None) -> bool:
    """Whether `s2r serve` started this process: pipes to a browser take the terminal's place."""
    env = os.environ if environment is None else environment
    return env.get("TEXTUAL_DRIVER") == WEB_DRIVER


def clean_environment(environment: MutableMapping[str, str]) -> None:
    """Drop what would make Textual load code, write files, press keys or connect somewhere."""
    served = is_served(environment)
    for name in [name for name in environment if name.startswith("TEXTUAL")]:
        del environment[name]
    if served:
        environment["TEXTUAL_DRIVER"] = WEB_DRIVER


def end_with_parent(number: int = signal.SIGTERM, parent: int | None = None) -> None:
    """Have this process ended by a signal when its parent ends, however that happens.

    `parent` is the id of the process that started this one; where that has ended already, so does
    this one. Linux does it in the kernel; elsewhere a thread looks every half second.
    """
    parent = os.getppid() if parent is None else parent
    if sys.platform == "linux":
        with suppress(AttributeError, OSError):
            ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, number)
    else:
        threading.Thread(target=_watch, args=(parent, number), daemon=True).start()
    if os.getppid() != parent:
        os._exit(1)


def server_id(environment: MutableMapping[str, str] | None = None) -> int | None:
    """The process id of the server of a served session."""
    told = (os.environ if environment is None else environment).get(SERVER_VARIABLE, "")
    return int(told) if told.isdecimal() else None


def _watch(parent: int, number: int) -> None:
    while os.getppid() == parent:
        time.sleep(0.5)
    os.kill(os.getpid(), number)


def confine(access: Permissions) -> None:
    """Hold this process to `access` until it ends: PermissionError for files, programs, network.

    A guard against mistakes of the program, not a sandbox against code that already runs in it.
    """
    clean_environment(os.environ)
    os.environ["MPLCONFIGDIR"] = str(access.own / "matplotlib")
    _silence_keys()
    sys.dont_write_bytecode = True
    sys.addaudithook(_hook(access))


def _silence_keys() -> None:
    """Let ctrl+z and its like be keys from now on: one pressed now would stop the program."""
    if not os.isatty(0):
        return
    attributes = termios.tcgetattr(0)
    attributes[tty.LFLAG] &= ~termios.ISIG
    termios.tcsetattr(0, termios.TCSANOW, attributes)


def _hook(access: Permissions) -> Callable[[str, tuple[Any, ...]], None]:
    watched: dict[str, Callable[[tuple[Any, ...]], None]] = {
        "open": partial(_opened, access),
        "import": _imported,
        **{event: partial(_changed, access, count) for event, count in _CHANGES.items()},
        **{event: partial(_refused, event) for event in (*_PROGRAMS, *_NETWORK)},
    }

    def audit(event: str, arguments: tuple[Any, ...]) -> None:
        check = watched.get(event)
        if check is not None:
            check(arguments)

    return audit


def _opened(access: Permissions, arguments: tuple[Any, ...]) -> None:
    path, mode, flags = arguments
    writes = any(letter in mode for letter in "wax+") if mode else bool(flags & _WRITING)
    if writes:
        _check(access, [path])


def _changed(access: Permissions, count: int, arguments: tuple[Any, ...]) -> None:
    _check(access, arguments[:count])


def _check(access: Permissions, paths: Iterable[Any]) -> None:
    for path in paths:
        if isinstance(path, int) or path in _DEVICES:
            continue
        if not access.may_write(Path(os.fsdecode(path))):
            raise PermissionError(1, "not in a restricted session", os.fsdecode(path))


def _imported(arguments: tuple[Any, ...]) -> None:
    if str(arguments[0]).split(".")[0] in _MODELS:
        raise ImportError(f"{arguments[0]}: a restricted session loads no models")


def _refused(event: str, arguments: tuple[Any, ...]) -> None:
    raise PermissionError(1, f"{event}: not in a restricted session")

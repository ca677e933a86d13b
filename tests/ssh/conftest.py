"""An OpenSSH server on the loopback interface, shared by the tests of this folder."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path

import pytest

from bench.support import sshd
from bench.support.screen import Screen

OpenScreen = Callable[..., Screen]


@pytest.fixture(scope="session")
def server(tiny_store: Path, tmp_path_factory: pytest.TempPathFactory) -> Iterator[sshd.Sshd]:
    """An SSH server whose restricted account opens the tiny store."""
    missing = sshd.missing_program()
    if missing:
        pytest.skip(f"{missing} is not installed (Debian: openssh-server, openssh-client)")
    started = sshd.start(tmp_path_factory.mktemp("sshd"), tiny_store)
    yield started
    started.stop()


@pytest.fixture
def open_screen() -> Iterator[OpenScreen]:
    """A function that opens terminals; they are closed when the test ends."""
    opened: list[Screen] = []

    def start_screen(
        command: Sequence[str],
        size: tuple[int, int] = (80, 24),
        environment: Mapping[str, str] | None = None,
    ) -> Screen:
        opened.append(Screen(command, size, environment))
        return opened[-1]

    yield start_screen
    for screen in opened:
        screen.close()

"""A command that is started in somebody else's folder runs nothing that lies there."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import pytest

from bench.support.processes import wait_until
from tests.support.serving import servers

_LIBRARIES = ("numpy", "duckdb", "textual", "lark", "zarr")
_STANDARD = ("json", "pickle", "multiprocessing", "concurrent", "signal", "sitecustomize",
             "usercustomize")  # fmt: skip
_OWN = ("s2rtui", "s2rstore", "s2rtools")
_SCRIPT = "import sys\nfrom s2rtui.cli import main\nsys.exit(main())\n"
_UNITS = """
import sys
from pathlib import Path
from s2rtools.precompute import executors
from tests.hostile.plain_units import opener
import cv2

if __name__ == "__main__":
    print(list(executors.run_units(Path("."), [1, 2], opener, 2)))
"""


class Hostile(NamedTuple):
    """A folder whose modules write the file `ran` when they are imported."""

    folder: Path
    ran: Path

    def command(self, program: Path, *words: str) -> subprocess.CompletedProcess[str]:
        return self.python(str(program), *words)

    def python(self, *words: str) -> subprocess.CompletedProcess[str]:
        path = os.pathsep.join(part for part in sys.path if part)
        names = {"PYTHONPATH": path, "XDG_DATA_HOME": str(self.ran.parent / "share")}
        environment = {**os.environ, **names}
        for name in ("PYTHONSAFEPATH", "LD_LIBRARY_PATH"):
            environment.pop(name, None)
        return subprocess.run(
            [sys.executable, *words], cwd=self.folder, env=environment, text=True,
            capture_output=True, timeout=120,
        )  # fmt: skip


@pytest.fixture
def hostile(tmp_path: Path) -> Iterator[Hostile]:
    found = Hostile(tmp_path / "hostile", tmp_path / "ran")
    found.folder.mkdir()
    for name in (*_LIBRARIES, *_STANDARD):
        (found.folder / f"{name}.py").write_text(_payload(found.ran))
    for name in _OWN:
        (found.folder / name).mkdir()
        for file in ("__init__.py", "__main__.py"):
            (found.folder / name / file).write_text(_payload(found.ran))
    yield found
    assert not found.ran.exists(), found.ran.read_text()


def _payload(ran: Path) -> str:
    return f"with open({str(ran)!r}, 'a') as out: out.write(__file__ + '\\n')\n"


@pytest.fixture
def program(tmp_path: Path) -> Path:
    """The `s2r` script, as installing the package writes it."""
    path = tmp_path / "bin" / "s2r"
    path.parent.mkdir()
    path.write_text(_SCRIPT)
    return path


def test_the_command_runs_none_of_its_modules(
    hostile: Hostile, program: Path, tiny_store: Path
) -> None:
    done = hostile.command(program, "query", str(tiny_store), "worst15", "--count")
    assert (done.returncode, done.stdout, done.stderr) == (0, "6\n", "")


def test_python_m_takes_no_library_from_it(hostile: Hostile, tiny_store: Path) -> None:
    """What the interpreter itself imports before the program, and the program, are found first."""
    for name in (*_STANDARD, *_OWN):
        for file in (hostile.folder / f"{name}.py", hostile.folder / name / "__init__.py"):
            file.unlink(missing_ok=True)
        (hostile.folder / name / "__main__.py").unlink(missing_ok=True)
    done = hostile.python("-m", "s2rtui", "query", str(tiny_store), "worst15", "--count")
    assert (done.returncode, done.stdout, done.stderr) == (0, "6\n", "")


def test_worker_processes_run_none_of_its_modules(hostile: Hostile, tmp_path: Path) -> None:
    script = tmp_path / "units.py"
    script.write_text(_UNITS)
    done = hostile.python(str(script))
    assert done.returncode == 0, done.stderr
    assert sorted(done.stdout) == sorted("[1, 2]\n")


@pytest.mark.skipif(sys.platform != "linux", reason="the names of the libraries are Linux's")
def test_worker_processes_load_none_of_its_libraries(hostile: Hostile, tmp_path: Path) -> None:
    version = f"{sys.version_info.major}.{sys.version_info.minor}"
    for name in ("libc.so.6", "libm.so.6", f"libpython{version}.so.1.0"):
        (hostile.folder / name).write_text("not a library")
    script = tmp_path / "units.py"
    script.write_text(_UNITS)
    done = hostile.python("-P", str(script))
    assert done.returncode == 0, done.stderr
    assert done.stderr == ""


def test_figures_do_not_follow_its_matplotlibrc(
    hostile: Hostile, program: Path, tiny_store: Path, tmp_path: Path
) -> None:
    pictures = [tmp_path / "before.png", tmp_path / "after.png"]
    for picture in pictures:
        words = ("--view", "rooms", "--size", "400x300", "--out", str(picture))
        done = hostile.command(program, "export", str(tiny_store), *words)
        assert (done.returncode, done.stderr) == (0, "")
        (hostile.folder / "matplotlibrc").write_text("text.usetex: True\naxes.linewidth: 5\n")
    assert pictures[0].read_bytes() == pictures[1].read_bytes()


def test_compiled_code_does_not_follow_its_numba_settings(
    hostile: Hostile, program: Path, tmp_path: Path
) -> None:
    (hostile.folder / ".numba_config.yaml").write_text("opt: [\n")
    words = ("world", "--instances", "2", "--size", "16", "--store", str(tmp_path / "w.s2r"))
    done = hostile.command(program, "ingest", *words)
    assert done.returncode == 0, done.stderr


async def test_a_served_page_runs_none_of_its_modules(
    hostile: Hostile, tiny_store: Path, tmp_path: Path
) -> None:
    aiohttp = pytest.importorskip("aiohttp")
    pytest.importorskip("textual_serve")
    with servers(tiny_store, tmp_path / "data") as serve:
        server = serve(cwd=hostile.folder)
        async with aiohttp.ClientSession() as session, session.ws_connect(server.socket) as page:
            message = await page.receive(60)
            assert message.type is aiohttp.WSMsgType.BINARY
            assert wait_until(lambda: bool(server.applications))

"""A command started in a folder with malicious modules runs none of them."""

import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import pytest

from bench.support.processes import program_environment, wait_until
from tests.support.serving import servers

_LIBRARIES = ("numpy", "duckdb", "textual", "lark", "zarr")
_STANDARD_MODULES = ("json", "pickle", "multiprocessing", "concurrent", "signal", "sitecustomize",
             "usercustomize")  # fmt: skip
_PROJECT = ("s2rtui", "s2rstore", "s2rtools")
_SCRIPT = "import sys\nfrom s2rtui.cli import main\nsys.exit(main())\n"
_COMPILATION = """
import sys
from s2rtui.cli import main
assert main() == 0
import numba
print(numba.njit(lambda x: 2 * x)(2))
"""
_UNITS = """
import sys
from s2rtools.precompute.executors.executor import Task
from s2rtools.precompute.executors.local_executors import ProcessExecutor
from tests.hostile.plain_units import PlainComputation
import cv2

if __name__ == "__main__":
    tasks = [Task(PlainComputation(), unit) for unit in (1, 2)]
    print(list(ProcessExecutor(1, 1).run(tasks)))
"""


class HostileFolder(NamedTuple):
    """A folder whose modules write the file `ran` when they are imported."""

    folder: Path
    ran: Path

    def command(self, program: Path, *arguments: str) -> subprocess.CompletedProcess[str]:
        return self.python(str(program), *arguments)

    def python(self, *arguments: str) -> subprocess.CompletedProcess[str]:
        environment = program_environment(XDG_DATA_HOME=str(self.ran.parent / "share"))
        for name in ("PYTHONSAFEPATH", "LD_LIBRARY_PATH"):
            environment.pop(name, None)
        return subprocess.run(
            [sys.executable, *arguments], cwd=self.folder, env=environment, text=True,
            capture_output=True, timeout=300,
        )  # fmt: skip


@pytest.fixture
def hostile(tmp_path: Path) -> Iterator[HostileFolder]:
    folder = HostileFolder(tmp_path / "hostile", tmp_path / "ran")
    folder.folder.mkdir()
    for name in (*_LIBRARIES, *_STANDARD_MODULES):
        (folder.folder / f"{name}.py").write_text(_payload(folder.ran))
    for name in _PROJECT:
        (folder.folder / name).mkdir()
        for file in ("__init__.py", "__main__.py"):
            (folder.folder / name / file).write_text(_payload(folder.ran))
    yield folder
    assert not folder.ran.exists(), folder.ran.read_text()


def _payload(ran: Path) -> str:
    return f"with open({str(ran)!r}, 'a') as out: out.write(__file__ + '\\n')\n"


@pytest.fixture
def program(tmp_path: Path) -> Path:
    """The `s2r` script as the package installer writes it."""
    path = tmp_path / "bin" / "s2r"
    path.parent.mkdir()
    path.write_text(_SCRIPT)
    return path


def test_the_command_imports_nothing_from_the_folder(hostile, program, tiny_store):
    process = hostile.command(program, "query", str(tiny_store), "worst15", "--count")
    assert (process.returncode, process.stdout, process.stderr) == (0, "6\n", "")


def test_python_m_imports_no_library_from_the_folder(hostile, tiny_store):
    """Standard modules and the program are deleted: the interpreter imports those from there."""
    for name in (*_STANDARD_MODULES, *_PROJECT):
        for file in (hostile.folder / f"{name}.py", hostile.folder / name / "__init__.py"):
            file.unlink(missing_ok=True)
        (hostile.folder / name / "__main__.py").unlink(missing_ok=True)
    process = hostile.python("-m", "s2rtui", "query", str(tiny_store), "worst15", "--count")
    assert (process.returncode, process.stdout, process.stderr) == (0, "6\n", "")


@pytest.mark.skipif(sys.platform != "linux", reason="the names of the libraries are Linux's")
def test_worker_processes_import_and_load_nothing_from_the_folder(hostile, tmp_path):
    version = f"{sys.version_info.major}.{sys.version_info.minor}"
    for name in ("libc.so.6", "libm.so.6", f"libpython{version}.so.1.0"):
        (hostile.folder / name).write_text("not a library")
    script = tmp_path / "units.py"
    script.write_text(_UNITS)
    process = hostile.python(str(script))
    assert (process.returncode, process.stdout, process.stderr) == (0, "[1, 2]\n", "")


def test_figures_ignore_the_matplotlibrc_of_the_folder(hostile, program, tiny_store, tmp_path):
    images = [tmp_path / "before.png", tmp_path / "after.png"]
    for image in images:
        arguments = ("--view", "rooms", "--size", "400x300", "--out", str(image))
        process = hostile.command(program, "export", str(tiny_store), *arguments)
        assert (process.returncode, process.stderr) == (0, "")
        (hostile.folder / "matplotlibrc").write_text("text.usetex: True\naxes.linewidth: 5\n")
    assert images[0].read_bytes() == images[1].read_bytes()


def test_numba_ignores_the_settings_of_the_folder(hostile, tiny_store, tmp_path):
    (hostile.folder / ".numba_config.yaml").write_text("opt: [\n")
    script = tmp_path / "compiling.py"
    script.write_text(_COMPILATION)
    process = hostile.python(str(script), "query", str(tiny_store), "worst15", "--count")
    assert (process.returncode, process.stdout) == (0, "6\n4\n"), process.stderr


async def test_a_served_session_imports_nothing_from_the_folder(hostile, tiny_store, tmp_path):
    aiohttp = pytest.importorskip("aiohttp")
    pytest.importorskip("textual_serve")
    with servers(tiny_store, tmp_path / "data") as serve:
        server = serve(cwd=hostile.folder)
        async with aiohttp.ClientSession() as session, session.ws_connect(server.socket) as page:
            message = await page.receive(60)
            assert message.type is aiohttp.WSMsgType.BINARY
            assert wait_until(lambda: bool(server.applications))

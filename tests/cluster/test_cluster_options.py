"""Options of `s2r precompute` for clusters, and the file of SLURM settings."""

import socketserver
import threading
from collections.abc import Callable
from pathlib import Path
from unittest.mock import MagicMock

import pytest

from tests.support.refusals import CommandResult, RunCommand

pytest.importorskip("dask_jobqueue")


Script = Callable[[str], CommandResult]


@pytest.fixture
def script(tmp_path: Path, s2r: RunCommand) -> Script:
    """The result of `--show-job-script` with a file of settings."""
    file = tmp_path / "slurm.toml"

    def show(settings: str) -> CommandResult:
        file.write_text(settings)
        return s2r("precompute", "s.s2r", "--cluster", file, "--show-job-script")

    return show


def test_the_job_script_has_what_the_settings_say(tmp_path, script):
    result = script(
        f"""[slurm]
        jobs = 3
        cores = 4
        memory = "8GB"
        walltime = "1-00:00:00"
        queue = "cpu"
        account = "lab"
        directives = ["--constraint=icelake"]
        skip = ["--mem"]
        prologue = ["module load python"]
        python = "/opt/python"
        log_folder = "{tmp_path}/logs"
        """
    )
    assert result.code == 0
    lines = result.out.splitlines()
    assert {
        "#SBATCH -p cpu", "#SBATCH -A lab", "#SBATCH --cpus-per-task=4", "#SBATCH -t 1-00:00:00",
        "#SBATCH --constraint=icelake", "module load python",
    } <= set(lines)  # fmt: skip
    assert "--mem=" not in result.out
    (worker,) = (line for line in lines if "dask_worker" in line)
    assert worker.startswith("/opt/python -m distributed.cli.dask_worker ")
    for option in ("--nthreads 4", "--no-dashboard", "--lifetime 79488s", "--lifetime-stagger"):
        assert option in worker


def test_an_edited_job_script_keeps_its_changes(tmp_path, script):
    from s2rtools.precompute.executors.slurm_settings import with_worker

    printed = script("[slurm]\njobs = 1\n").out
    edited = printed.replace("#SBATCH -n 1", "#SBATCH -n 1\n#SBATCH --exclusive")
    (tmp_path / "job.sh").write_text(edited)
    settings = '[slurm]\njobs = 1\nscript = "job.sh"\n'
    assert "#SBATCH --exclusive" in script(settings).out
    assert with_worker(edited, "the worker").splitlines()[-1] == "the worker"
    (tmp_path / "job.sh").write_text("#!/bin/sh\n")
    message = f"{tmp_path / 'job.sh'}: needs one line with distributed.cli.dask_worker"
    script(settings).assert_refused(message)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("jobs = 1\n", "has no table [slurm]; name a TOML file with a table [slurm]"),
        ("iid,x,y\n1,2,3\n", "not valid TOML (Expected '='"),
        ("[slurm]\n", "missing required field `jobs`"),
        ("[slurm]\njobs = 0\n", ">= 1"),
        ("[slurm]\njobs = 1\nspeed = 2\n", "unknown field `speed`"),
        ('[slurm]\njobs = 1\nwalltime = "soon"\n', "walltime 'soon': write it as hh:mm:ss"),
        ('[slurm]\njobs = 1\nscript = "none.sh"\n', "none.sh: cannot be read"),
    ],
)
def test_invalid_settings_are_named(script, text, message):
    script(text).assert_refused("slurm.toml", message)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--cluster", "local:2", "--workers", "2"], "--cluster: cannot be combined"),
        (["--cluster", "local:2", "--scheduler", "tcp://h:1"], "--scheduler: cannot be combined"),
        (["--scheduler", "tcp://h:1", "--threads", "2"], "dask worker --nthreads"),
        (["--cluster", "none.toml"], "--cluster none.toml: cannot be read (No such file"),
        (["--cluster", "local:0"], "use local:N, with 1 to 9999 workers"),
        (["--cluster", ""], "--cluster: names nothing"),
        (["--cluster", "local:2", "--show-job-script"], "has no job script"),
        (["--show-job-script"], "needs --cluster FILE"),
        (["--threads", "0"], "must be at least 1"),
        (["--scheduler", "nonsense"], "no Dask scheduler answers there (missing port"),
        (["--scheduler", "tcp://127.0.0.1:1"], "no Dask scheduler answers there"),
    ],
)
def test_invalid_options_are_named(store_copy, s2r, arguments, message):
    s2r("precompute", store_copy, *arguments).assert_refused(message)


@pytest.mark.parametrize(
    ("content", "message"),
    [(bytes(range(256)), "not UTF-8 at byte 128"), (None, "a folder, not a regular file")],
    ids=["bytes", "folder"],
)
def test_a_file_that_has_no_settings_is_named(tmp_path, s2r, content, message):
    path = tmp_path / "bin.csv"
    path.mkdir() if content is None else path.write_bytes(content)
    s2r("precompute", "s.s2r", "--cluster", path, "--show-job-script").assert_refused(
        f"s2r: --cluster {path}: {message}", "; name a TOML file with a table [slurm]"
    )


class _Answering(socketserver.BaseRequestHandler):
    """Answers as a web server, or for the test's time not at all."""

    def handle(self) -> None:
        if self.server.answer:  # type: ignore[attr-defined]
            self.request.recv(64)
            self.request.sendall(self.server.answer)  # type: ignore[attr-defined]
        else:
            self.server.is_over.wait(60)  # type: ignore[attr-defined]


@pytest.mark.parametrize("answer", [b"", b"HTTP/1.1 400 Bad Request\r\nContent-Length: 0\r\n\r\n"])
def test_a_port_without_dask_is_told_soon(store_copy, s2r, monkeypatch, answer):
    from s2rtools.precompute.executors import clusters

    monkeypatch.setattr(clusters, "_ANSWER_SECONDS", 1)
    with socketserver.ThreadingTCPServer(("127.0.0.1", 0), _Answering) as server:
        server.daemon_threads = True
        server.answer, server.is_over = answer, threading.Event()  # type: ignore[attr-defined]
        threading.Thread(target=server.serve_forever, args=(0.02,), daemon=True).start()
        address = f"tcp://127.0.0.1:{server.server_address[1]}"
        result = s2r("precompute", store_copy, "--scheduler", address)
        server.is_over.set()  # type: ignore[attr-defined]
        server.shutdown()
    result.assert_refused(f"--scheduler {address}: no Dask scheduler answers there")


@pytest.mark.parametrize(
    ("address", "is_warned"),
    [
        ("ws://node1:8786", True), ("tcp://127.0.0.1:8786", False), ("localhost:8786", False),
    ],
)  # fmt: skip
def test_a_scheduler_without_encryption_is_warned_of(monkeypatch, address, is_warned):
    from s2rtools.precompute.executors import clusters

    monkeypatch.setattr(clusters, "_require_scheduler", lambda address: None)
    monkeypatch.setattr("distributed.Client", MagicMock())
    lines: list[str] = []
    with clusters.open_cluster(None, address, None, lines.append):
        pass
    expected = (
        f"warning: --scheduler {address}: not encrypted; whoever reaches it can run code here and "
        "on the workers; use tls://, or a network that you trust"
    )
    assert lines == [expected] * is_warned

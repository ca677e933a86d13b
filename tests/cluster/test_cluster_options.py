"""Options of `s2r precompute` for clusters, and the file of SLURM settings."""

from __future__ import annotations

import socketserver
import threading
from pathlib import Path
from unittest.mock import MagicMock

import pytest

from s2rtui.cli import main

pytest.importorskip("dask_jobqueue")
pytestmark = pytest.mark.xdist_group("cluster")


def script_of(tmp_path: Path, capsys: pytest.CaptureFixture[str], text: str) -> tuple[int, str]:
    """Exit code and output of `--show-job-script` with a file of settings."""
    file = tmp_path / "slurm.toml"
    file.write_text(text)
    code = main(["precompute", "s.s2r", "--cluster", str(file), "--show-job-script"])
    captured = capsys.readouterr()
    return code, captured.out if code == 0 else captured.err


def test_the_job_script_has_what_the_settings_say(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    code, script = script_of(
        tmp_path,
        capsys,
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
        """,
    )
    assert code == 0
    for line in (
        "#SBATCH -p cpu", "#SBATCH -A lab", "#SBATCH --cpus-per-task=4", "#SBATCH -t 1-00:00:00",
        "#SBATCH --constraint=icelake", "module load python",
    ):  # fmt: skip
        assert line in script.splitlines()
    assert "--mem=" not in script
    (worker,) = (line for line in script.splitlines() if "dask_worker" in line)
    assert worker.startswith("/opt/python -m distributed.cli.dask_worker ")
    for option in ("--nthreads 4", "--no-dashboard", "--lifetime 79488s", "--lifetime-stagger"):
        assert option in worker


def test_an_edited_job_script_keeps_its_changes(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    from s2rtools.precompute.executors.slurm_settings import with_worker

    code, printed = script_of(tmp_path, capsys, "[slurm]\njobs = 1\n")
    assert code == 0
    edited = printed.replace("#SBATCH -n 1", "#SBATCH -n 1\n#SBATCH --exclusive")
    (tmp_path / "job.sh").write_text(edited)
    code, script = script_of(tmp_path, capsys, '[slurm]\njobs = 1\nscript = "job.sh"\n')
    assert code == 0
    assert "#SBATCH --exclusive" in script
    assert with_worker(edited, "the worker").splitlines()[-1] == "the worker"
    (tmp_path / "job.sh").write_text("#!/bin/sh\n")
    code, error = script_of(tmp_path, capsys, '[slurm]\njobs = 1\nscript = "job.sh"\n')
    assert code == 2
    assert f"{tmp_path / 'job.sh'}: needs one line with distributed.cli.dask_worker" in error


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("jobs = 1\n", "has no table [slurm]"),
        ("[slurm]\n", "missing required field `jobs`"),
        ("[slurm]\njobs = 0\n", ">= 1"),
        ("[slurm]\njobs = 1\nspeed = 2\n", "unknown field `speed`"),
        ('[slurm]\njobs = 1\nwalltime = "soon"\n', "walltime 'soon': write it as hh:mm:ss"),
        ('[slurm]\njobs = 1\nscript = "none.sh"\n', "none.sh: cannot be read"),
        ("[slurm\n", "slurm.toml"),
    ],
)
def test_invalid_settings_are_named(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], text: str, message: str
) -> None:
    code, error = script_of(tmp_path, capsys, text)
    assert code == 2
    assert message in error
    assert error.count("\n") == 1


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--cluster", "local:2", "--workers", "2"], "--cluster: cannot be combined"),
        (["--cluster", "local:2", "--scheduler", "tcp://h:1"], "--scheduler: cannot be combined"),
        (["--scheduler", "tcp://h:1", "--threads", "2"], "dask worker --nthreads"),
        (["--cluster", "none.toml"], "--cluster none.toml: cannot be read (No such file"),
        (["--cluster", "local:0"], "use local:N, with 1 to 9999 workers"),
        (["--cluster", "local:two"], "use local:N, with 1 to 9999 workers"),
        (["--cluster", ""], "--cluster: names nothing"),
        (["--scheduler", ""], "--scheduler: names nothing"),
        (["--kinds", ""], "--kinds: names nothing"),
        (["--cluster", "local:2", "--show-job-script"], "has no job script"),
        (["--show-job-script"], "needs --cluster FILE"),
        (["--threads", "0"], "must be at least 1"),
        (["--scheduler", "nonsense"], "no Dask scheduler answers there (missing port"),
        (["--scheduler", "tcp://127.0.0.1:1"], "no Dask scheduler answers there"),
    ],
)
def test_invalid_options_are_named(
    store_copy: Path, capsys: pytest.CaptureFixture[str], arguments: list[str], message: str
) -> None:
    assert main(["precompute", str(store_copy), *arguments]) == 2
    error = capsys.readouterr().err
    assert message in error
    assert error.count("\n") == 1


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (bytes(range(256)), "not UTF-8 at byte 128"),
        (b"iid,x,y\n1,2,3\n", "not valid TOML (Expected '='"),
        (b"jobs = 1\n", "has no table [slurm]"),
        (None, "a folder, not a regular file"),
    ],
)
def test_a_file_that_has_no_settings_is_named(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], content: bytes | None, message: str
) -> None:
    path = tmp_path / "bin.csv"
    path.mkdir() if content is None else path.write_bytes(content)
    assert main(["precompute", "s.s2r", "--cluster", str(path), "--show-job-script"]) == 2
    error = capsys.readouterr().err
    assert error.startswith(f"s2r: --cluster {path}: {message}")
    assert error.endswith("; name a TOML file with a table [slurm]\n")
    assert error.count("\n") == 1


class _Answering(socketserver.BaseRequestHandler):
    """Answers as a web server, or for the test's time not at all."""

    def handle(self) -> None:
        if self.server.answer:  # type: ignore[attr-defined]
            self.request.recv(64)
            self.request.sendall(self.server.answer)  # type: ignore[attr-defined]
        else:
            self.server.is_over.wait(60)  # type: ignore[attr-defined]


@pytest.mark.parametrize("answer", [b"", b"HTTP/1.1 400 Bad Request\r\nContent-Length: 0\r\n\r\n"])
def test_a_port_without_dask_is_told_soon(
    store_copy: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
    answer: bytes,
) -> None:
    from s2rtools.precompute.executors import clusters

    monkeypatch.setattr(clusters, "_ANSWER_SECONDS", 1)
    with socketserver.ThreadingTCPServer(("127.0.0.1", 0), _Answering) as server:
        server.daemon_threads = True
        server.answer, server.is_over = answer, threading.Event()  # type: ignore[attr-defined]
        threading.Thread(target=server.serve_forever, args=(0.02,), daemon=True).start()
        address = f"tcp://127.0.0.1:{server.server_address[1]}"
        code = main(["precompute", str(store_copy), "--scheduler", address])
        server.is_over.set()  # type: ignore[attr-defined]
        server.shutdown()
    error = capsys.readouterr().err
    assert code == 2
    assert f"--scheduler {address}: no Dask scheduler answers there" in error
    assert error.count("\n") == 1


@pytest.mark.parametrize(
    ("address", "is_warned"),
    [
        ("tcp://10.0.0.5:8786", True),
        ("node1:8786", True),
        ("tcp://[2001:db8::1]:8786", True),
        ("ws://node1:8786", True),
        ("tcp://127.0.0.1:8786", False),
        ("localhost:8786", False),
        ("tcp://[::1]:8786", False),
        ("tls://10.0.0.5:8786", False),
        ("wss://node1:8786", False),
    ],
)
def test_a_scheduler_without_encryption_is_warned_of(
    monkeypatch: pytest.MonkeyPatch, address: str, is_warned: bool
) -> None:
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

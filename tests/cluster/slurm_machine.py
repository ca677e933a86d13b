"""A real SLURM on this machine: a controller and two nodes, each with its own mounts.

It needs root and the packages slurmctld, slurmd, slurm-client and munge
of Debian, but neither systemd nor control groups.
"""

import os
import shutil
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path

PROGRAMS = ("slurmctld", "slurmd", "sbatch", "squeue", "scancel", "munged", "unshare", "setpriv")
NODES = ("n1", "n2")
_SEARCHED = os.pathsep.join((os.environ.get("PATH", ""), "/usr/sbin", "/sbin"))
_START_SECONDS = 60.0
_CONFIGURATION = """
ClusterName=test
SlurmctldHost={host}(127.0.0.1)
SlurmctldPort={controller}
SlurmUser=root
SlurmdUser=root
AuthType=auth/munge
AuthInfo=socket={folder}/munge.socket
CredType=cred/munge
CommunicationParameters=NoCtldInAddrAny,NoInAddrAny
ProctrackType=proctrack/linuxproc
TaskPlugin=task/none
JobAcctGatherType=jobacct_gather/none
AccountingStorageType=accounting_storage/none
SelectType=select/cons_tres
SelectTypeParameters=CR_Core_Memory
SchedulerParameters=sched_interval=1,batch_sched_delay=0
SlurmdParameters=config_overrides
StateSaveLocation={folder}/state
SlurmdSpoolDir={folder}/spool-%n
SlurmctldPidFile={folder}/slurmctld.pid
SlurmdPidFile={folder}/slurmd-%n.pid
SlurmctldLogFile={folder}/slurmctld.log
SlurmdLogFile={folder}/slurmd-%n.log
SwitchType=switch/none
MpiDefault=none
ReturnToService=2
KillWait=2
InactiveLimit=0
SlurmctldTimeout=300
SlurmdTimeout=300
{nodes}
PartitionName=all Nodes={names} Default=YES State=UP MaxTime=INFINITE
"""
_NODE = "NodeName={name} NodeAddr=127.0.0.1 NodeHostname={host} Port={port} CPUs=4 RealMemory=16000"


def missing_program() -> str | None:
    """A program or right that is missing here to start SLURM; None where it can be started."""
    if os.geteuid() != 0:
        return "root"
    return next((name for name in PROGRAMS if not shutil.which(name, path=_SEARCHED)), None)


@dataclass
class SlurmMachine:
    """A running SLURM; `environment` are the variables of its programs.

    Jobs find the modules that this process finds.
    """

    folder: Path
    environment: dict[str, str]
    processes: list[subprocess.Popen[bytes]] = field(default_factory=list)

    def call(self, *command: str) -> str:
        """The standard output of one of SLURM's programs."""
        return subprocess.run(
            command, env=self.environment, check=True, capture_output=True, text=True, timeout=60
        ).stdout

    def jobs(self) -> dict[str, str]:
        """The nodes of the running jobs, by job number."""
        lines = self.call("squeue", "--noheader", "--states=R", "--format=%i %N").splitlines()
        return dict(line.split() for line in lines)


@contextmanager
def slurm_machine(
    folder: Path, mount: Callable[[str], str] | None = None
) -> Iterator[SlurmMachine]:
    """Start SLURM with its files in `folder`; jobs that still run end with it.

    `mount` gives the shell commands that a node of some name runs in its own mount namespace before
    it starts.
    """
    folder.mkdir(parents=True)
    for name in ("state", *(f"spool-{node}" for node in NODES)):
        (folder / name).mkdir()
    host = socket.gethostname().partition(".")[0]
    ports = _free_ports(1 + len(NODES))
    nodes = [_NODE.format(name=n, host=host, port=p) for n, p in zip(NODES, ports[1:], strict=True)]
    configuration = folder / "slurm.conf"
    configuration.write_text(
        _CONFIGURATION.format(
            host=host, folder=folder, controller=ports[0], nodes="\n".join(nodes),
            names=",".join(NODES),
        )
    )  # fmt: skip
    modules = os.pathsep.join(filter(None, sys.path))
    environment = {**os.environ, "PATH": _SEARCHED, "PYTHONPATH": modules,
                   "SLURM_CONF": str(configuration)}  # fmt: skip
    machine = SlurmMachine(folder, environment)
    try:
        _start_munge(machine)
        _start(machine, "slurmctld", "-D", "-c", "-i")
        for node in NODES:
            prepare = mount(node) if mount else ":"
            command = f"set -e; {prepare}; exec slurmd -D -c -N {node}"
            _start(machine, "unshare", "--mount", "--propagation", "private", "sh", "-c", command)
        _wait(lambda: _idle_nodes(machine) == len(NODES), machine)
        yield machine
    finally:
        _stop(machine)


def _start_munge(machine: SlurmMachine) -> None:
    key = machine.folder / "munge.key"
    key.write_bytes(os.urandom(128))
    key.chmod(0o400)
    machine.folder.chmod(0o755)
    files = {"socket": "socket", "pid-file": "pid", "log-file": "log", "seed-file": "seed"}
    _start(
        machine, "munged", "--foreground", "--force", f"--key-file={key}", "--num-threads=2",
        *(f"--{name}={machine.folder}/munge.{file}" for name, file in files.items()),
    )  # fmt: skip
    _wait((machine.folder / "munge.socket").exists, machine)


def _start(machine: SlurmMachine, *command: str) -> None:
    log = machine.folder / f"{len(machine.processes)}-{command[0]}.out"
    with log.open("wb") as out:
        machine.processes.append(
            subprocess.Popen(
                ["setpriv", "--pdeathsig", "TERM", *command],  # it ends with this process
                env=machine.environment, stdout=out, stderr=out, stdin=subprocess.DEVNULL,
            )
        )  # fmt: skip


def _idle_nodes(machine: SlurmMachine) -> int:
    try:
        return machine.call("sinfo", "--noheader", "--Node", "--format=%t").split().count("idle")
    except subprocess.CalledProcessError:
        return 0


def _wait(is_ready: Callable[[], bool], machine: SlurmMachine) -> None:
    deadline = time.monotonic() + _START_SECONDS
    while not is_ready():
        ended = next((p for p in machine.processes if p.poll() is not None), None)
        if ended is not None or time.monotonic() > deadline:
            logs = sorted((*machine.folder.glob("*.out"), *machine.folder.glob("*.log")))
            texts = [f"{log.name}: {log.read_text(errors='replace')[-1500:]}" for log in logs]
            raise RuntimeError("\n".join(["SLURM did not start", *texts]))
        time.sleep(0.05)


def _stop(machine: SlurmMachine) -> None:
    """End all jobs, then the daemons, the last one first."""
    if len(machine.processes) > 1 and machine.processes[1].poll() is None:
        subprocess.run(["scancel", "--full", "--user=root"], env=machine.environment, check=False)
        subprocess.run(
            ["scancel", "--signal=KILL", "--full", "--user=root"],
            env=machine.environment, check=False, capture_output=True,
        )  # fmt: skip
    for process in reversed(machine.processes):
        if process.poll() is None:
            process.send_signal(signal.SIGTERM)
    for process in machine.processes:
        try:
            process.wait(10)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()


def _free_ports(count: int) -> list[int]:
    sockets = [socket.socket() for _ in range(count)]
    try:
        for each in sockets:
            each.bind(("127.0.0.1", 0))
        return [each.getsockname()[1] for each in sockets]
    finally:
        for each in sockets:
            each.close()

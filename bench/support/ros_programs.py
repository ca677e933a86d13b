"""Start and stop a ROS 1 master, a camera, the proxy and a listener on loopback."""

from __future__ import annotations

import json
import os
import shutil
import signal
import socket
import subprocess
import sys
import threading
from pathlib import Path
from typing import Any

from s2rtools.ros.ros_environment import SYSTEM_PACKAGES

REPOSITORY = Path(__file__).resolve().parents[2]
CAMERA_TOPIC, PROXY_TOPIC = "/camera/image_raw/compressed", "/translated/image_raw/compressed"


def missing_ros() -> str:
    """What is missing of ROS 1, empty where it is installed."""
    if shutil.which("rosmaster") is None:
        return "rosmaster"
    packages = ("rospy", "sensor_msgs", "diagnostic_msgs", "rosbag")
    folders = [SYSTEM_PACKAGES, *sys.path]
    return next((p for p in packages if not any(Path(f, p).is_dir() for f in folders)), "")


def free_port() -> int:
    """A TCP port of the loopback interface that was free a moment ago."""
    with socket.create_server(("127.0.0.1", 0)) as server:
        return int(server.getsockname()[1])


class Program:
    """A running program whose lines of output are collected."""

    def __init__(self, command: list[str], environment: dict[str, str]) -> None:
        self.process = subprocess.Popen(
            command, cwd=REPOSITORY, env=environment, text=True,
            stdout=subprocess.PIPE, stderr=subprocess.STDOUT,
        )  # fmt: skip
        self.lines: list[str] = []
        self._reader = threading.Thread(target=self._read, daemon=True)
        self._reader.start()

    def _read(self) -> None:
        assert self.process.stdout is not None
        for line in self.process.stdout:
            self.lines.append(line.rstrip())

    def rows(self, name: str) -> list[dict[str, Any]]:
        """JSON objects of the output that have the key `name`."""
        found = [json.loads(line) for line in self.lines.copy() if line.startswith("{")]
        return [row for row in found if name in row]

    def stop(self, kind: signal.Signals = signal.SIGTERM) -> int:
        """Send a signal, wait for the end; returns the exit code."""
        if self.process.poll() is None:
            self.process.send_signal(kind)
        try:
            code = self.process.wait(30)
        except subprocess.TimeoutExpired:
            self.process.kill()
            code = self.process.wait()
        self._reader.join(5)
        if self.process.stdout is not None:
            self.process.stdout.close()
        return code


class RosNetwork:
    """Programs of one ROS 1 network with a master on a free port of loopback."""

    def __init__(self, folder: Path) -> None:
        self._port = free_port()
        self._environment = os.environ | {
            "ROS_MASTER_URI": f"http://127.0.0.1:{self._port}", "ROS_IP": "127.0.0.1",
            "ROS_LOG_DIR": str(folder / "log"), "ROS_HOME": str(folder), "ROS_VERSION": "1",
            "OMP_NUM_THREADS": "1", "PYTHONUNBUFFERED": "1",
            "PYTHONPATH": os.pathsep.join(map(str, (REPOSITORY, REPOSITORY / "store",
                                                    REPOSITORY / "tools"))),
        }  # fmt: skip
        self._environment.pop("ROS_NAMESPACE", None)
        self._programs: list[Program] = []

    def start(self, command: list[str]) -> Program:
        program = Program(command, self._environment)
        self._programs.append(program)
        return program

    def master(self) -> Program:
        return self.start(["rosmaster", "--core", "-p", str(self._port)])

    def roscore(self) -> Program:
        return self.start(["roscore", "-p", str(self._port)])

    def camera(self, topic: str = CAMERA_TOPIC, *options: str) -> Program:
        module = [sys.executable, "-m", "bench.support.ros_camera"]
        return self.start([*module, "--topic", topic, *options])

    def listener(self, topic: str = PROXY_TOPIC, *options: str) -> Program:
        module = [sys.executable, "-m", "bench.support.ros_listener"]
        return self.start([*module, "--topic", topic, *options])

    def proxy(
        self, translator: Path, *options: str, topics: tuple[str, str] = (CAMERA_TOPIC, PROXY_TOPIC)
    ) -> Program:
        command = [sys.executable, "-m", "s2rtui", "ros", "proxy"]
        return self.start(
            [*command, "--translator", str(translator), "--in", topics[0], "--out", topics[1],
             *options]
        )  # fmt: skip

    def set_parameter(self, name: str, value: Any) -> None:
        """Set a parameter at the master."""
        import xmlrpc.client

        with xmlrpc.client.ServerProxy(f"http://127.0.0.1:{self._port}") as master:
            master.setParam("/test", name, value)

    def stop(self) -> None:
        """End all programs, at the same time."""
        for program in self._programs:
            if program.process.poll() is None:
                program.process.terminate()
        for program in self._programs:
            program.stop()

"""The ROS 1 proxy between a camera and a listener at a real roscore: drops, latency, memory.

Run as `python -m bench.ros_proxy TRANSLATOR ...`.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np

from bench.support.ros_programs import (
    CAMERA_TOPIC,
    Program,
    RosNetwork,
    missing_ros,
)

_WARM_UP = 10.0
"""Seconds before memory is measured for the first time."""
_START = 120.0
"""Seconds after which the programs must have started."""


def main() -> int:
    parser = argparse.ArgumentParser(prog="python -m bench.ros_proxy", description=__doc__)
    parser.add_argument("translators", nargs="+", type=Path, help="translator files")
    parser.add_argument("--seconds", type=float, default=300.0, help="for each (default 300)")
    parser.add_argument("--size", default="640x480")
    parser.add_argument("--rate", type=float, default=30.0, help="images per second")
    parser.add_argument("--max-age", help="as in `s2r ros proxy`")
    parser.add_argument("--json", action="store_true", help="one JSON object per line")
    options = parser.parse_args()
    if missing := missing_ros():
        parser.error(f"ROS 1 is not installed: {missing} is missing")
    for translator in options.translators:
        measured = measure(translator, options)
        print(json.dumps(measured) if options.json else _text(measured), flush=True)
    return 0


def measure(translator: Path, options: argparse.Namespace) -> dict[str, Any]:
    """Counts of the proxy, its share of one core, latencies in ms, and its memory in MB after the
    start and at the end."""
    with tempfile.TemporaryDirectory() as folder:
        network = RosNetwork(Path(folder))
        try:
            network.roscore()
            age = ("--max-age", options.max_age) if options.max_age else ()
            proxy = network.proxy(translator.resolve(), *age)
            listener = network.listener()
            network.camera(CAMERA_TOPIC, "--size", options.size, "--rate", str(options.rate))
            for name in ("image", "diagnostics"):
                _wait_for(listener, name)
            began, cpu = time.monotonic(), _cpu_seconds(proxy)
            time.sleep(min(_WARM_UP, options.seconds / 2))
            first = _memory(proxy)
            peaks = [first]
            while time.monotonic() < began + options.seconds:
                time.sleep(1.0)
                peaks.append(_memory(proxy))
            cpu_share = (_cpu_seconds(proxy) - cpu) / (time.monotonic() - began)
            counts = listener.rows("diagnostics")[-1]["diagnostics"]
            return {
                "translator": translator.name,
                "cpu_share": round(cpu_share, 3),
                **{name: counts[name] for name in counts if not name.startswith("setting")},
                **_percentiles("latency", [row["latency"] for row in listener.rows("latency")]),
                **_percentiles("camera to listener",
                               [1e3 * row["delay"] for row in listener.rows("image")]),
                "memory_start": first, "memory_end": peaks[-1], "memory_peak": max(peaks),
            }  # fmt: skip
        finally:
            network.stop()


def _percentiles(name: str, values: list[float]) -> dict[str, float]:
    """Of all frames, not of the sliding window of the diagnostics."""
    found = np.percentile(values, (50, 95, 99, 100))
    return {
        f"{name} {label}": round(float(value), 2)
        for label, value in zip(("p50", "p95", "p99", "max"), found, strict=True)
    }


def _wait_for(listener: Program, name: str) -> None:
    end = time.monotonic() + _START
    while not listener.rows(name):
        if time.monotonic() > end:
            raise TimeoutError(f"no {name} from the proxy after {_START:.0f} s")
        time.sleep(0.1)


def _memory(program: Program) -> float:
    """Resident memory in MB (Linux)."""
    lines = Path(f"/proc/{program.process.pid}/status").read_text().splitlines()
    kilobytes = next(line.split()[1] for line in lines if line.startswith("VmRSS:"))
    return round(int(kilobytes) / 1024, 1)


def _cpu_seconds(program: Program) -> float:
    fields = Path(f"/proc/{program.process.pid}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def _text(measured: dict[str, Any]) -> str:
    lines = [f"{name:<32} {value}" for name, value in measured.items()]
    return "\n".join([*lines, ""])


if __name__ == "__main__":
    sys.exit(main())

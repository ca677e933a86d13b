"""Coverage of the parameters' 95 % intervals, and detection of a structural mismatch.

`python -m bench.sysid` identifies the planar robot in ten worlds with random parameters and prints
the 40 cases of delay, mass, friction and damping, then the same worlds with wheels of unequal
radius, and the time of a 60 s replay. It exits with 1 if fewer than 35 intervals contain the truth.
"""

from __future__ import annotations

import argparse
import math
import os
import sys
import tempfile
import time
from pathlib import Path

os.environ.setdefault("OMP_NUM_THREADS", "1")

import numpy as np

from bench.budget import seconds
from s2rtools.motion_logs import Commands
from s2rtools.sysid.identify import Identification, SysidSettings, identify
from s2rtools.sysid.simulators import Planar
from s2rtools.sysid.synthetic_drives import DriveSettings, make_drives

JUDGED = ("latency", "mass", "friction", "damping")
NEEDED = 35
_RANGES = {
    "mass": (7.0, 20.0), "friction": (1.5, 6.0), "damping": (4.0, 14.0), "drag": (0.3, 2.5),
    "latency": (0.01, 0.15),
}  # fmt: skip


class Silent:
    def begin(self, what: str, total: int) -> None: ...
    def advance(self, steps: int) -> None: ...
    def say(self, line: str) -> None: ...


def main() -> int:
    parser = argparse.ArgumentParser(prog="python -m bench.sysid", description=__doc__)
    parser.add_argument("--worlds", type=int, default=10)
    parser.add_argument("--efforts", action="store_true", help="torques unknown: lumped parameters")
    parser.add_argument("--first", type=int, default=0, help="number of the first world")
    options = parser.parse_args()
    print(f"60 s replay: {1e3 * replay_seconds():.2f} ms")
    inside = cases = alarms = detected = 0
    numbers = range(options.first, options.first + options.worlds)
    for number in numbers:
        began = time.perf_counter()
        truth, found = identified(number, 0.0, options.efforts)
        taken = time.perf_counter() - began
        alarms += found.structure.mismatch
        for name, true, value, low, high in rows(truth, found):
            good = low <= true <= high
            cases, inside = cases + 1, inside + good
            print(f"{number:3d} {name:14s} {true:9.5f} {value:9.5f}  {low:9.5f} .. {high:9.5f}  "
                  f"{'inside' if good else 'OUTSIDE'}")  # fmt: skip
        print(f"{number:3d} mismatch: {found.structure.mismatch}; {taken:.1f} s", flush=True)
    print(f"inside: {inside} of {cases}; mismatch reported without one: {alarms} of {len(numbers)}")
    for number in numbers:
        wheels = (0.01, 0.02, 0.04)[number % 3] * (-1) ** number
        _, found = identified(number, wheels, options.efforts)
        detected += found.structure.mismatch
        one = next(one for one in found.structure.candidates if one.name == "wheels")
        print(f"{number:3d} wheels {wheels:+.3f}: reported {found.structure.mismatch}, estimate "
              f"{one.estimate:+.4f} ({one.low:+.4f} .. {one.high:+.4f})", flush=True)  # fmt: skip
    print(f"mismatch reported where there is one: {detected} of {len(numbers)}")
    return 0 if inside >= NEEDED / 40 * cases and detected == len(numbers) else 1


def replay_seconds() -> float:
    """Replay time of the planar simulator, 60 s at 50 poses per second."""
    rng = np.random.default_rng(0)
    torques = np.repeat(rng.uniform(-0.2, 0.6, (2, 120)), 10, axis=1)
    channels = {"left_torque": torques[0], "right_torque": torques[1]}
    commands = Commands(np.arange(1200) * 0.05, channels, 0.05, "", "")
    times, simulator = np.arange(3000) * 0.02, Planar()
    return seconds(lambda: simulator.simulate({}, commands, np.zeros(5), times), 30)


def identified(
    number: int, wheels: float, efforts: bool
) -> tuple[dict[str, float], Identification]:
    rng = np.random.default_rng((number, 77))
    truth = {
        name: math.exp(rng.uniform(math.log(low), math.log(high)))
        for name, (low, high) in _RANGES.items()
    }
    recording = DriveSettings(efforts=efforts, truth={**truth, "wheels": wheels})
    with tempfile.TemporaryDirectory() as folder:
        drives = make_drives(Path(folder), 1000 + number, recording=recording)
    return truth, identify(drives, SysidSettings(seed=number), Silent())


def rows(
    truth: dict[str, float], found: Identification
) -> list[tuple[str, float, float, float, float]]:
    estimates = []
    for one in found.estimates:
        name, _, over = one.name.partition("/")
        if name in JUDGED:
            true = truth[name] / truth[over] if over else truth[name]
            estimates.append((one.name, true, one.value, one.low, one.high))
    return estimates


if __name__ == "__main__":
    sys.exit(main())

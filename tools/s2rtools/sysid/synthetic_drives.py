"""Folders of synthetic drives with known parameters, made with the planar simulator."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from s2rstore.errors import RequestError
from s2rstore.files import atomic_writes
from s2rstore.geometry.angles import wrap
from s2rtools.motion_logs import Commands, Drive, Log, csv_reader
from s2rtools.sysid.simulators.planar import Planar
from s2rtools.sysid.simulators.simulator import LATENCY, Floats, Values

SEVERITIES: dict[str, tuple[str, float]] = {
    "latency": (LATENCY, 0.08),
    "wheels": ("wheels", 0.04),
    "mass": ("mass", 4.0),
    "friction": ("friction", 1.5),
    "damping": ("damping", 3.0),
}
"""The parameter of the real robot that a factor changes, and the change at severity 1."""

UNTUNED: Mapping[str, float] = {
    "mass": 20.0, "friction": 1.0, "damping": 4.0, "drag": 0.0, LATENCY: 0.0,
}  # fmt: skip
"""The simulator before any identification: the declared bad state."""

_PERIOD, _SAMPLED, _STEP = 0.05, 0.02, 0.001


@dataclass(frozen=True, slots=True)
class DriveSettings:
    """Settings of synthetic drives: `count` of `seconds` each, white noise of the real log in m and
    rad, `efforts` instead of known torques, and real parameter values (`truth`) instead of the
    defaults.
    """

    count: int = 12
    seconds: float = 20.0
    place_noise: float = 0.002
    heading_noise: float = 0.003
    efforts: bool = False
    truth: Values = field(default_factory=dict)


def make_drives(
    folder: Path, seed: int, severities: Mapping[str, float] | None = None,
    recording: DriveSettings | None = None,
) -> tuple[Drive, ...]:  # fmt: skip
    """Write `folder`/drive-NN/{real,sim,untuned,commands}.csv and `folder`/truth.json.

    With all `severities` (names of SEVERITIES) at 0 the simulator equals reality except for the
    measurement noise. Equal seeds give equal bytes. Raises RequestError for an unknown severity.
    """
    recording = recording or DriveSettings()
    simulator = Planar(_STEP)
    truth = {**simulator.defaults(), **recording.truth}
    for name, severity in (severities or {}).items():
        if name not in SEVERITIES:
            raise RequestError(f"{name}: no such factor (has: {', '.join(SEVERITIES)})")
        parameter, whole = SEVERITIES[name]
        truth[parameter] += severity * whole
    folder.mkdir(parents=True, exist_ok=True)
    drives = []
    for number in range(recording.count):
        rng = np.random.default_rng((seed, number))
        drives.append(_drive(folder / f"drive-{number:02d}", rng, truth, recording, simulator))
    text = json.dumps({"seed": seed, "values": truth}, indent=1, sort_keys=True) + "\n"
    atomic_writes.write_file(folder / "truth.json", text.encode())
    return tuple(drives)


def _drive(folder: Path, rng: np.random.Generator, truth: Values, recording: DriveSettings,
           simulator: Planar) -> Drive:  # fmt: skip
    commands = _commands(rng, recording, simulator)
    start = np.array([rng.uniform(-2, 2), rng.uniform(-2, 2), rng.uniform(-3, 3), 0.0, 0.0])
    time: Floats = _SAMPLED * np.arange(round(recording.seconds / _SAMPLED), dtype=np.float64)
    scale = np.array([recording.place_noise, recording.place_noise, recording.heading_noise])
    noise = scale * rng.standard_normal((len(time), 3))
    folder.mkdir(exist_ok=True)
    logs = {}
    for role, values in (("real", truth), ("sim", {}), ("untuned", UNTUNED)):
        poses = simulator.simulate(values, commands, start, time)[:, :3]
        if role == "real":
            poses = poses + noise
        log = Log(time, poses[:, 0], poses[:, 1], wrap(poses[:, 2]), "", "")
        csv_reader.write(log, folder / f"{role}.csv")
        logs[role] = csv_reader.read(folder / f"{role}.csv")
    csv_reader.write_commands(commands, folder / "commands.csv")
    commands = csv_reader.read_commands(folder / "commands.csv")
    return Drive(folder.name, logs["real"], logs["sim"], logs["untuned"], commands)


def _commands(rng: np.random.Generator, recording: DriveSettings, simulator: Planar) -> Commands:
    """Half a second of rest, then stretches of driving, turning, coasting and braking."""
    time: Floats = _PERIOD * np.arange(round(recording.seconds / _PERIOD), dtype=np.float64)
    both = np.zeros((2, len(time)))
    k = round(0.5 / _PERIOD)
    while k < len(time):
        end = k + int(rng.integers(round(0.4 / _PERIOD), round(1.6 / _PERIOD)))
        forward = rng.choice(
            [rng.uniform(0.2, 0.7), 0.0, rng.uniform(-0.4, 0.0)], p=[0.7, 0.1, 0.2]
        )
        turn = rng.choice([rng.uniform(-0.12, 0.12), 0.0], p=[0.7, 0.3])
        both[:, k:end] = [[forward - turn], [forward + turn]]
        k = end
    names = simulator.efforts if recording.efforts else simulator.torques
    return Commands(time, dict(zip(names, both, strict=True)), _PERIOD, "", "")

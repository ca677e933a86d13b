"""Repeatability: how much real drives with the same commands differ from each other."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from s2rtools.gap.delay import time_delay
from s2rtools.gap.dynamics.windows import WindowPlan, windows
from s2rtools.motion_logs.motion_log import Commands, Drive, Floats

_TIME_TOLERANCE = 1e-3


def same_commands(a: Commands, b: Commands) -> bool:
    """Whether both hold the same values at the same times after their start."""
    if a.time.size != b.time.size or a.channels.keys() != b.channels.keys():
        return False
    offsets = (a.time - a.time[0]) - (b.time - b.time[0])
    return bool(np.abs(offsets).max() <= _TIME_TOLERANCE) and all(
        np.allclose(a.channels[name], b.channels[name], atol=1e-9) for name in a.channels
    )


def repetitions(drives: Sequence[Drive]) -> list[list[int]]:
    """For each drive the indices of the other drives with the same commands."""
    return [
        [
            j
            for j, other in enumerate(drives)
            if j != i
            and drive.commands is not None
            and other.commands is not None
            and other.real.sha256 != drive.real.sha256
            and same_commands(drive.commands, other.commands)
        ]
        for i, drive in enumerate(drives)
    ]


def repeatability_squares(
    drive: Drive,
    others: Sequence[Drive],
    plan: WindowPlan,
    max_delay: float = 1.0,
) -> Floats:
    """Half the mean square (H, K), m^2, of the windows of a drive against each repetition of it.

    The difference of two real drives holds the variation of reality twice, that of a real and a
    simulated drive once.
    """
    assert drive.commands is not None
    repeated = []
    for other in others:
        assert other.commands is not None
        shift = float(drive.commands.time[0] - other.commands.time[0])
        _, aligned = time_delay.remove_delay(
            drive.real, time_delay.shifted(other.real, shift), plan.rate, max_delay
        )
        repeated.append(windows(drive.real, aligned, plan).end ** 2)
    stacked = np.stack(repeated)
    known = np.isfinite(stacked)
    count = known.sum(axis=0)
    return np.where(count > 0, np.nansum(stacked, axis=0) / np.maximum(2 * count, 1), np.nan)

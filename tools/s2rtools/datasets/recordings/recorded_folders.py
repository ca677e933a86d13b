"""Steps that the readers of folders of recordings share."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from s2rstore.errors import RequestError, counted
from s2rtools.common.input_issue import InputIssue
from s2rtools.datasets.recording import RecordedTrajectory
from s2rtools.datasets.recordings.recorded_poses import nearest_times

_MAX_NAME = 80
_PARTS = re.compile(r"([0-9]+)|([^0-9]+)")


def existing_folder(path: Path) -> Path:
    """The path. Raises RequestError unless it is a folder."""
    if not path.is_dir():
        kind = "not a folder" if path.exists() else "no such folder"
        raise RequestError(f"{path}: {kind}")
    return path


def folder_name(path: Path) -> str:
    """The name of a folder, also of `.`, as it is reported."""
    return path.name or path.resolve().name or "recording"


def trajectory_name(text: str) -> str:
    """The text as the name of a trajectory: other characters than letters and digits are `_`."""
    name = re.sub(r"\.\.+", ".", re.sub(r"[^A-Za-z0-9_.+-]", "_", text)).lstrip("_.+-")
    return name[:_MAX_NAME] or "recording"


def natural_order(name: str) -> list[tuple[int, str]]:
    """The key that sorts names by the numbers in them, so that 2.png comes before 10.png."""
    parts = ((number.lstrip("0"), text) for number, text in _PARTS.findall(name))
    return [(-1, text) if text else (len(number), number) for number, text in parts]


def require_frames(
    layout: str,
    folder: Path,
    trajectories: Mapping[str, RecordedTrajectory],
    issues: Sequence[InputIssue],
) -> None:
    """Raise RequestError, stating the first issue, if no trajectory has a frame."""
    if any(len(trajectory.frames) for trajectory in trajectories.values()):
        return
    message = f"{folder}: no usable image of layout {layout}"
    if issues:
        message += f" ({counted(len(issues), 'issue')}, the first: {issues[0]})"
    raise RequestError(message)


def report_none_near(
    kind: str,
    names: Sequence[str],
    times: NDArray[np.float64],
    known_times: NDArray[np.float64],
    tolerance: float,
    issues: list[InputIssue],
    rule: str = "",
) -> None:
    """Report images without a pose or depth image near their `times` (N,), seconds.

    `known_times` (K,) are those of all poses or depth images, ascending. `rule` is what none of
    them fulfils, by default to be within `tolerance` seconds.
    """
    rows = nearest_times(times, known_times, np.inf)
    for name, time, row in zip(names, times.tolist(), rows.tolist(), strict=True):
        detail = rule or f"none within {tolerance * 1000:g} ms"
        if row >= 0:
            detail += f"; the nearest is {abs(time - known_times[row]):.3f} s away"
        issues.append(InputIssue(kind, name, detail))

"""Precompute of real pairs with all heatmaps, against an earlier commit on the same machine.

Both sides run the command line of their own code on the same images and weights, with default
options: `s2r ingest`, `s2r model add`, `s2r run add` and, timed, `s2r precompute`.
"""

from __future__ import annotations

import csv
import os
import resource
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch

import s2rstore
from bench.budget import BudgetRow
from bench.measured_stores import lively

COMMIT = "4e2cce5"
BUDGET, BUDGET_WITH_AMX = 0.57, 0.20
PREDICTIONS, ALL_BUT_OCCLUSION = 0.05, 0.20
"""Largest shares of the other commit's time after which these are published."""
_LOOK = 0.05
"""Seconds between two checks of which generation the store has published."""
_ROOT = Path(__file__).resolve().parents[1]
_WARM_UP_PAIRS = 8


@dataclass(frozen=True, slots=True)
class PrecomputeTime:
    """Wall and processor seconds of one `s2r precompute`, and what it said about its backend.

    published: the seconds after which each kind of array was published; empty for a store that this
    code cannot read.
    """

    wall: float
    processor: float
    backend: str
    published: dict[str, float]


def figures(data: Path, pairs: int | None = None, commit: str = COMMIT) -> Iterator[BudgetRow]:
    """Rows of this code and of `commit`, a git revision or the path of a working tree.

    `data` is a folder in the layout of Sim2RealViz; `pairs` of its pairs are used, evenly spread,
    by default all.
    """
    folder = Path(tempfile.mkdtemp(prefix="s2r-bench-"))
    worktree = Path(commit) if Path(commit).is_dir() else folder / "worktree"
    try:
        if worktree != Path(commit):
            _git("worktree", "add", "--detach", str(worktree), commit)
        weights = folder / "posest.pt"
        torch.save(lively("posest").state_dict(), weights)
        count = _copy_pairs(data, folder / "data", pairs)
        _copy_pairs(data, folder / "warm-up", _WARM_UP_PAIRS)
        times = []
        for name, code in (("this code", _ROOT), (commit, worktree)):
            _precompute(code, folder / "warm-up", folder / f"{len(times)}-first.s2r", weights)
            taken = _precompute(code, folder / "data", folder / f"{len(times)}.s2r", weights)
            times.append(taken)
            label = f"posest, {count} real pairs, all kinds, {name}"
            yield BudgetRow(f"{label}{taken.backend}", taken.wall, "s")
            yield BudgetRow(f"... processor time, {name}", taken.processor, "s")
        budget = BUDGET_WITH_AMX if _has_amx() else BUDGET
        now, before = times
        others = [at for kind, at in now.published.items() if not kind.endswith("occlusion")]
        predictions = now.published["embedding"] / before.wall
        yield BudgetRow(f"... predictions published / {commit}", predictions, "ratio", PREDICTIONS)
        yield BudgetRow(f"... all but occlusion published / {commit}", max(others) / before.wall,
                        "ratio", ALL_BUT_OCCLUSION, details=now.published)  # fmt: skip
        yield BudgetRow(f"... this code / {commit}", now.wall / before.wall, "ratio", budget)
        yield BudgetRow("... the same, processor time", now.processor / before.processor, "ratio")
    finally:
        if worktree.is_relative_to(folder) and worktree.exists():
            _git("worktree", "remove", "--force", str(worktree))
        shutil.rmtree(folder)


def _git(*command: str) -> None:
    subprocess.run(["git", "-C", str(_ROOT), *command], check=True, capture_output=True)


def _copy_pairs(data: Path, target: Path, pairs: int | None) -> int:
    """Copy evenly spread pairs of trajectory 1 with their images; returns their number."""
    source = data / "traj1"
    with (source / "sim" / "match.csv").open(newline="") as file:
        header, *rows = csv.reader(file)
    if pairs is not None and pairs < len(rows):
        rows = [rows[n] for n in np.unique(np.linspace(0, len(rows) - 1, pairs).astype(int))]
    named = dict(zip(header, range(len(header)), strict=True))
    for domain in ("real", "sim", "sim_edit"):
        folder = target / "traj1" / domain
        folder.mkdir(parents=True)
        for row in rows:
            rgb = row[named["REAL_RGB" if domain == "real" else "SIM_RGB"]]
            for name in (rgb, rgb.replace("_rgb", "_depth")):
                shutil.copy(source / domain / name, folder / name)
    with (target / "traj1" / "sim" / "match.csv").open("w", newline="") as file:
        csv.writer(file).writerows([header, *rows])
    shutil.copy(data / "map.jpg", target / "map.jpg")
    return len(rows)


def _precompute(code: Path, data: Path, store: Path, weights: Path) -> PrecomputeTime:
    """Make a store and precompute it with the code in a working tree."""
    _s2r(code, "ingest", "sim2realviz", str(data), "--store", str(store))
    _s2r(code, "model", "add", "m", str(weights), "--arch", "posest", "--store", str(store))
    _s2r(code, "run", "add", "r", "--model", "m", "--store", str(store))
    began, used = time.perf_counter(), _processor_seconds()
    with ThreadPoolExecutor(1) as pool:
        running = pool.submit(_s2r, code, "precompute", str(store))
        published = _published(store, running, began) if code == _ROOT else {}
        said = running.result()
    wall, processor = time.perf_counter() - began, _processor_seconds() - used
    lines = [line.strip() for line in said.splitlines() if "float32" in line]
    return PrecomputeTime(wall, processor, f" ({lines[-1]})" if lines else "", published)


def _published(store: Path, running: Future[str], began: float) -> dict[str, float]:
    """The seconds since `began` at which each kind of array of the run `r` was first published."""
    found: dict[str, float] = {}
    current = ""
    while not running.done():
        time.sleep(_LOOK)
        if (present := (store / "CURRENT.json").read_text()) != current:
            current = present
            with s2rstore.open(store) as opened:
                for record in opened.array_kinds("r"):
                    found.setdefault(record.kind, time.perf_counter() - began)
    return found


def _s2r(code: Path, *command: str) -> str:
    """Output of one `s2r` command. Raises RuntimeError with its messages if it fails."""
    path = os.pathsep.join(str(code / part) for part in ("", "store", "tools"))
    done = subprocess.run(
        [sys.executable, "-m", "s2rtui", *command],
        cwd=code, env={**os.environ, "PYTHONPATH": path}, text=True, capture_output=True,
    )  # fmt: skip
    if done.returncode:
        raise RuntimeError(f"s2r {command[0]} of {code}: {done.stderr or done.stdout}")
    return done.stdout + done.stderr


def _processor_seconds() -> float:
    """User and system time of all finished child processes."""
    usage = resource.getrusage(resource.RUSAGE_CHILDREN)
    return usage.ru_utime + usage.ru_stime


def _has_amx() -> bool:
    """Whether the processor has AMX, and `ONEDNN_MAX_CPU_ISA` does not leave it out."""
    allowed = os.environ.get("ONEDNN_MAX_CPU_ISA", "").upper() or "DEFAULT"
    if "AMX" not in allowed and allowed not in ("DEFAULT", "ALL"):
        return False
    cpuinfo = Path("/proc/cpuinfo")
    return cpuinfo.exists() and "amx_bf16" in cpuinfo.read_text()

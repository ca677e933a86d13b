"""False alarm rate and detection rate of the gate.

`python -m bench.false_alarm_rate` freezes one reference on the default world with all factors and
uses it, as `s2r gap` does, to judge fresh evidence of every seed: a tour of 64 views through five
rooms that the model was not trained on, and twelve drives. The gate answers FAIL if the whole 95 %
interval of the worst axis is above the threshold. Without a gap, and with a gap exactly at the
threshold, this may happen for 2.5 % of the seeds. The exit code is 1 if false alarms are
significantly more frequent, or if the verdict of a seed without factors is not PASS. The number
after G of every axis (mean and deviation over the seeds) is the share of seeds whose whole interval
is above that mean: the false alarm rate if the mean were the threshold.

The tours have new poses, which a reference of other poses refuses; the bench writes their hash into
the reference and keeps its scale, which belongs to the same building, model and count.

Without factors sim and real images have the same bytes; `noise` renders both sides with independent
sensor noise, so that the images differ although there is no gap.
"""

from __future__ import annotations

import argparse
import contextlib
import json
import os
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

os.environ.setdefault("OMP_WAIT_POLICY", "PASSIVE")
os.environ.setdefault("GOMP_SPINCOUNT", "0")

import numpy as np
from scipy import stats

import s2rstore
from bench.measured_stores import QUIET
from bench.tour_stores import MODEL, Severities, tours_store
from s2rstore.reader import Store
from s2rtools.gap.axes import THRESHOLD
from s2rtools.gap.axis import Evidence
from s2rtools.gap.gate import gate
from s2rtools.gap.instance_selection import poses_sha256
from s2rtools.motion_logs import Drive
from s2rtools.precompute.pipeline import PrecomputeOptions, precompute
from s2rtools.sysid.synthetic_drives import SEVERITIES, make_drives
from s2rtools.training import pretrained

LEVEL = 0.025
"""Share of false alarms that the lower bound of a 95 % interval allows."""
COUNT = 64
AXES = ("visual", "task", "dynamics", "delay")
WORDS = ("PASS", "FAIL", "INCONCLUSIVE")


@dataclass(frozen=True, slots=True)
class Condition:
    """Factors of both sides' images and of the real robot; `wanted` is the expected outcome.

    `calm` conditions have no gap over the threshold: a FAIL is a false alarm.
    """

    name: str
    real: Severities = field(default_factory=dict)
    sim: Severities = field(default_factory=dict)
    robot: Severities = field(default_factory=dict)
    calm: bool = False
    wanted: str | None = None


@dataclass(frozen=True, slots=True)
class Row:
    """All seeds of a condition: outcomes, and G of every axis with its bounds, (seeds, axes, 3)."""

    condition: Condition
    words: Counter[str]
    gaps: np.ndarray

    @property
    def seeds(self) -> int:
        return self.words.total()

    @property
    def rate(self) -> tuple[float, float, float]:
        """Rate of FAIL with its exact 95 % interval (Clopper and Pearson)."""
        found = stats.binomtest(self.words["FAIL"], self.seeds).proportion_ci()
        return self.words["FAIL"] / self.seeds, float(found.low), float(found.high)

    @property
    def over(self) -> list[float]:
        """Per axis the share of seeds whose whole interval is above the mean of all seeds' G.

        This is the false alarm rate if the mean were the threshold.
        """
        means = self.gaps[:, :, 0].mean(axis=0)
        return [float(share) for share in (self.gaps[:, :, 1] > means + 1e-9).mean(axis=0)]

    @property
    def good(self) -> bool:
        if self.condition.calm and self.rate[1] > LEVEL:
            return False
        return self.condition.wanted in (None, *(w for w in WORDS if self.words[w] == self.seeds))

    def facts(self) -> dict[str, Any]:
        axes = {
            axis: {
                "mean": float(self.gaps[:, k, 0].mean()),
                "deviation": float(self.gaps[:, k, 0].std(ddof=1)) if self.seeds > 1 else None,
                "over_mean": self.over[k],
            }
            for k, axis in enumerate(AXES)
        }
        rate, low, high = self.rate
        named = ("name", "real", "sim", "robot", "calm", "wanted")
        return {**{name: getattr(self.condition, name) for name in named}, "seeds": self.seeds,
                **{word: self.words[word] for word in WORDS}, "fail_rate": rate,
                "fail_low": low, "fail_high": high, "axes": axes, "ok": self.good}  # fmt: skip


def main() -> int:
    parser = argparse.ArgumentParser(prog="python -m bench.false_alarm_rate", description=__doc__)
    parser.add_argument("--seeds", type=int, default=100, help="of each condition without a gap")
    parser.add_argument("--power", type=int, default=20, help="of each condition with one; 0: none")
    parser.add_argument("--first", type=int, default=0, help="the first seed")
    parser.add_argument("--json", action="store_true", help="one JSON object per condition")
    options = parser.parse_args()
    began, good = time.perf_counter(), True
    if not options.json:
        print(_HEAD)
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        reference = frozen(folder)
        for conditions, count in ((calm(reference), options.seeds), (GAPS, options.power)):
            seeds = range(options.first, options.first + count)
            for row in judged(folder / f"{len(conditions)}-{count}", conditions, seeds, reference):
                good &= row.good
                print(json.dumps(row.facts()) if options.json else _line(row), flush=True)
    print(f"{time.perf_counter() - began:.0f} s", file=sys.stderr)
    return 0 if good else 1


def frozen(folder: Path) -> Path:
    """The reference, frozen on the default world with all its factors."""
    from s2rtui.cli import main as s2r

    path, reference = folder / "all.s2r", folder / "reference.json"
    made = ["ingest", "world", "--instances", str(COUNT // 2), "--factors", "all"]
    with contextlib.redirect_stdout(sys.stderr):
        code = s2r([*made, "--store", str(path)])
        pretrained.add_pretrained_models(path)
        precompute(path, QUIET, [MODEL], PrecomputeOptions(kinds=()))
        bad_state = ["--run", MODEL, "--anchor-run", MODEL]
        code += s2r(["gap", str(path), *bad_state, "--freeze", str(reference)])
    if code:
        raise SystemExit("the reference could not be frozen")
    return reference


def calm(reference: Path) -> tuple[Condition, ...]:
    """Conditions without a gap, and one whose delay equals the threshold."""
    scale = json.loads(reference.read_text())["axes"]["delay"]
    limit = scale["floor"] + THRESHOLD / 100 * (scale["anchor"] - scale["floor"])
    latency = limit * scale["fingerprint"]["period"] / SEVERITIES["latency"][1]
    return (
        Condition("no factor", calm=True, wanted="PASS"),
        Condition("noise", real={"sensor": 1.0}, sim={"sensor": 1.0}, calm=True, wanted="PASS"),
        Condition("at the threshold", robot={"latency": latency}, calm=True),
    )


GAPS = (
    Condition("lights=0.3", real={"lights": 0.3}),
    Condition("lights=0.5", real={"lights": 0.5}),
    Condition("lights", real={"lights": 1.0}),
    Condition("exposure", real={"exposure": 1.0}),
    Condition("exposure=2", real={"exposure": 2.0}),
    Condition("objects", real={"objects": 1.0}),
    Condition("latency=0.1", robot={"latency": 0.1}),
    Condition("latency=0.5", robot={"latency": 0.5}, wanted="FAIL"),
    Condition("wheels", robot={"wheels": 1.0}),
    Condition("wheels=2", robot={"wheels": 2.0}),
)


def judged(
    folder: Path, conditions: Sequence[Condition], seeds: Sequence[int], reference: Path
) -> Iterator[Row]:
    """Judge every condition on the same tours, each with separate noise and drives."""
    if not seeds:
        return
    path = folder / "tours.s2r"
    tours_store(path, seeds, COUNT, {look(each): (each.sim, each.real) for each in conditions})
    with s2rstore.open(path) as store:
        for place, condition in enumerate(conditions):
            words: Counter[str] = Counter()
            gaps: list[Any] = []
            for number, seed in enumerate(seeds):
                drives = make_drives(folder / "drives", 1000 * (seed + 1) + place, condition.robot)
                iids = np.flatnonzero(store.instances.trajectory == number)
                word, found = verdict(store, condition, iids, drives, reference)
                words[word] += 1
                gaps.append(found)
            yield Row(condition, words, np.array(gaps))


def look(condition: Condition) -> str:
    """The run whose images a condition sees; conditions of the robot alone share one."""
    sides = {"sim": condition.sim, "real": condition.real}
    named = [f"{side}-{name}{value:g}" for side, f in sides.items() for name, value in f.items()]
    return "+".join(named) or "clean"


def verdict(
    store: Store, condition: Condition, iids: np.ndarray, drives: Sequence[Drive], reference: Path
) -> tuple[str, list[tuple[float, float, float]]]:
    """The outcome of `s2r gap`, and G of every axis with its bounds."""
    evidence = Evidence(store, look(condition), iids, drives=drives)
    _fit(reference, evidence)
    request = gate.GapRequest(run=look(condition), reference=reference)
    found = gate.judge_gap(evidence, request).verdict
    gaps = {each.axis: each.gap for each in found.axes}
    return found.outcome, [(gaps[a].value, gaps[a].low, gaps[a].high) for a in AXES]


def _fit(reference: Path, evidence: Evidence) -> None:
    scale = json.loads(reference.read_text())
    for axis in ("visual", "task"):
        scale["axes"][axis]["fingerprint"]["poses"] = poses_sha256(evidence.store)
    reference.write_text(json.dumps(scale))


_HEAD = (
    f"{'condition':<17} seeds  PASS  FAIL     ?  FAIL (95 %)           "
    f"{'  '.join(f'G {axis:<17}' for axis in AXES)}"
)


def _line(row: Row) -> str:
    rate, low, high = row.rate
    means, spread = row.gaps[:, :, 0].mean(axis=0), row.gaps[:, :, 0].std(axis=0)
    gaps = "  ".join(
        f"{m:6.1f} +- {s:4.1f} {100 * over:3.0f} %"
        for m, s, over in zip(means, spread, row.over, strict=True)
    )
    words = "".join(f"{row.words[word]:6d}" for word in WORDS)
    verdict = "" if row.good else "  OUTSIDE THE LIMIT"
    return (f"{row.condition.name:<17} {row.seeds:5d}{words}  {rate:.2f} ({low:.3f} .. {high:.3f})"
            f"   {gaps}{verdict}")  # fmt: skip


if __name__ == "__main__":
    sys.exit(main())

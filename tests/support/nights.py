"""Synthetic nights: reports as `s2r gap` writes them, and configurations that need no images."""

import datetime
import itertools
import math
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from s2rstore.reader import Store
from s2rtools.nightly import config as configs
from s2rtools.nightly.config import NightlyConfig
from s2rtools.nightly.run import NightRun, nightly

FIRST = datetime.date(2026, 11, 16)
THRESHOLD = 15.0
CLOCK = datetime.datetime(2026, 11, 16, 3, 0, tzinfo=datetime.UTC)


def day(number: int) -> datetime.date:
    """The date of night `number`, counted from 1."""
    return FIRST + datetime.timedelta(days=number - 1)


def clock() -> Callable[[], datetime.datetime]:
    """A clock that advances by one hour per call."""
    hours = itertools.count()
    return lambda: CLOCK + datetime.timedelta(hours=next(hours))


def axis(name: str, gap: float, margin: float = 2.0, **overrides: Any) -> dict[str, Any]:
    """One axis of a report with the gap `gap` +- `margin`, on a scale of 0.1 .. 1.1 m."""
    value = 0.1 + gap / 100
    fields = {
        "axis": name, "measure": f"{name} measure", "unit": "m", "n": 200, "floor": 0.1,
        "floor_low": 0.08, "floor_high": 0.12, "value": value, "value_low": value - margin / 100,
        "value_high": value + margin / 100, "gap": gap, "gap_low": gap - margin,
        "gap_high": gap + margin,
        "anchor": 1.1, "anchor_state": "bad", "fingerprint": {}, "details": {}, "notes": [],
    }  # fmt: skip
    return fields | overrides


def report(store: Store, axes: Mapping[str, float], margin: float = 2.0, **overrides: Any
           ) -> dict[str, Any]:  # fmt: skip
    """A judged report with the given gap G per axis."""
    listed = [axis(name, gap, margin) for name, gap in axes.items()]
    worst = max(listed, key=lambda entry: entry["gap"])
    outcome = "INCONCLUSIVE"
    if worst["gap_high"] < THRESHOLD:
        outcome = "PASS"
    elif worst["gap_low"] > THRESHOLD:
        outcome = "FAIL"
    run = store.run(None)
    fields = {
        "dataset": {"name": store.dataset.name, "hash": store.dataset.hash}, "run": run.run,
        "run_key": run.key, "model": run.model, "model_sha256": "0" * 64, "expression": "all",
        "selected": 40, "drives": [], "settings": {"seed": 1}, "axes": listed, "absent": {},
        "inconclusive": {}, "across": None, "golden": None, "reference": {"sha256": "1" * 64},
        "verdict": {
            "outcome": outcome, "threshold": THRESHOLD, "worst": worst["axis"], "gap": worst["gap"],
            "gap_low": worst["gap_low"], "gap_high": worst["gap_high"],
            "reason": "the interval against the threshold",
        },
    }  # fmt: skip
    return fields | overrides


def golden(change: float, margin: float = 0.05) -> dict[str, Any]:
    """The golden-run section of a report."""
    outcome = "PASS" if change + 0.01 < margin else "FAIL"
    return {"outcome": outcome, "change": change, "change_low": change - 0.01,
            "change_high": change + 0.01, "margin": margin, "n": 40, "missing": 0}  # fmt: skip


def write_config(folder: Path, store: Path, text: str = "", name: str = "lab") -> NightlyConfig:
    """Write a configuration for a store with a folder of drives, and read it."""
    drives = folder / "drives" / "one"
    drives.mkdir(parents=True, exist_ok=True)
    (drives / "real.csv").write_text("time,x,y,heading\n0,0,0,0\n")
    path = folder / f"{name}.toml"
    path.write_text(
        f'name = "{name}"\nstore = "{store}"\n{text}\n[drives]\nfolder = "drives"\n'
        '[output]\nmetrics = "gap.prom"\nreports = "reports"\n[stale]\nafter_days = 2\n'
    )
    return configs.read(path)


class Week:
    """A week of nights, each with new logs and noise; `regression` is added from a day on."""

    def __init__(
        self, config: NightlyConfig, regression: Mapping[str, float], from_day: int
    ) -> None:
        self.config, self.regression, self.from_day = config, regression, from_day
        self.calls = 0
        self._day = 0
        self._clock = clock()
        self._rng = np.random.default_rng(5)

    def measure(self, store: Store, config: NightlyConfig) -> dict[str, Any]:
        self.calls += 1
        gaps = {"visual": 4.0, "task": 7.0, "dynamics": 5.0}
        noise = self._rng.normal(0, 0.8, len(gaps))
        noisy_gaps = {name: gap + e for (name, gap), e in zip(gaps.items(), noise, strict=True)}
        if self._day >= self.from_day:
            noisy_gaps = {
                name: gap + self.regression.get(name, 0.0) for name, gap in noisy_gaps.items()
            }
        change = float(self._rng.normal(0, 0.005))
        absent = {"delay": "no drive has commands"}
        return report(store, noisy_gaps, golden=golden(change), absent=absent)

    def estimate(self, config: object) -> list[dict[str, Any]]:
        return [{"parameter": "damping", "value": 0.8, "value_low": 0.75, "value_high": 0.86,
                 "unit": "1/s"},
                {"parameter": "mass", "value": 12.0, "value_low": None, "value_high": math.nan,
                 "unit": "kg", "note": "not identifiable"}]  # fmt: skip

    def night(self, number: int, new_log: bool = True) -> NightRun:
        self._day = number
        if new_log:
            log = self.config.source.parent / "drives" / f"day{number}" / "real.csv"
            log.parent.mkdir(exist_ok=True)
            log.write_text(f"time,x,y,heading\n0,{number},0,0\n")
        return nightly(self.config, day(number), self.measure, self.estimate, self._clock)

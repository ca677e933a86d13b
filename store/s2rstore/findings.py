"""What a store shows at first glance: the room where reality is worst, the costliest gap."""

from __future__ import annotations

import json
from dataclasses import dataclass
from typing import Any

import numpy as np

from s2rstore import headlines
from s2rstore.reader import Store
from s2rstore.text import printable

MIN_INSTANCES = 5


@dataclass(frozen=True, slots=True)
class Region:
    """A room of one run: median errors in metres over `n` instances new to the model."""

    room: str
    n: int
    real_median: float
    sim_median: float


def regions(store: Store, run: str) -> list[Region]:
    """Rooms with at least five instances new to the model, the largest median real error first."""
    columns = store.run_columns(run)
    fresh = headlines.held_out(store, run)
    truth = store.instances
    found = []
    for code, name in enumerate(truth.room_names):
        members = fresh & (truth.room == code)
        n = int(members.sum())
        if n >= MIN_INSTANCES:
            real = float(np.median(columns.real.error[members]))
            sim = float(np.median(columns.sim.error[members]))
            found.append(Region(name, n, real, sim))
    return sorted(found, key=lambda region: -region.real_median)


def lines(store: Store) -> list[str]:
    """The findings in a dozen lines, for the end of a demo or a log."""
    computed = [name for name, run in store.runs.items() if run.key]
    if not computed:
        return ["no run is computed yet"]
    truth = store.instances
    told = [
        f"{len(truth)} instances, {len(computed)} runs; predicting the mean position scores "
        f"{100 * headlines.baseline(store, computed[0]):.1f} % accuracy"
    ]
    told += [_run_line(store, name) for name in computed]
    best = max(computed, key=lambda name: _accuracy(store, name))
    told.append(f"best in reality: {best} ({100 * _accuracy(store, best):.1f} %)")
    found = regions(store, computed[0])
    if found:
        worst = found[0]
        told.append(
            f"worst region of {computed[0]}: {worst.room} (median real error "
            f"{worst.real_median:.2f} m, sim {worst.sim_median:.2f} m; {worst.n} new instances)"
        )
    return [printable(line) for line in [*told, *_score_lines(store)]]


def _score_lines(store: Store) -> list[str]:
    """Why, and which heatmap to trust: where `s2r score` has noted it."""
    noted = store.provenance("score").get("report")
    if noted is None:
        return []
    report = json.loads(noted)
    told = []
    causes = [row for row in report["factors"] if row["cost"] is not None]
    if causes:
        run = causes[0]["run"]
        worst = max((row for row in causes if row["run"] == run), key=lambda row: row["cost"])
        told.append(
            f"costliest factor of {run}: {worst['factor']}, alone +{worst['cost']:.2f} m "
            f"({worst['cost_low']:.2f} .. {worst['cost_high']:.2f}); leaving it out gains "
            f"{worst['gain']:.2f} m ({worst['gain_low']:.2f} .. {worst['gain_high']:.2f})"
        )
    floors = [row for row in report["heatmaps"]
              if row["place"] == "floor" and row["auroc"] is not None]  # fmt: skip
    if floors:
        best = max(floors, key=lambda row: row["auroc"])
        told.append(
            f"best heatmap: {best['kind']} of {best['run']} finds the changed objects on the floor "
            f"at AUROC {best['auroc']:.2f} ({best['auroc_low']:.2f} .. {best['auroc_high']:.2f}), "
            f"{100 * best['precision']:.0f} % of its top cells are right (chance "
            f"{100 * best['base_rate']:.0f} %)"
        )
        told.append("  beside it: " + ", ".join(_rivals(floors, best)))
    return told


def _rivals(floors: list[dict[str, Any]], best: dict[str, Any]) -> list[str]:
    """The other kinds at their best."""
    found: dict[str, float] = {}
    for row in floors:
        if row["kind"] != best["kind"]:
            found[row["kind"]] = max(row["auroc"], found.get(row["kind"], 0.0))
    ordered = sorted(found.items(), key=lambda item: -item[1])
    return [f"{kind} {auroc:.2f}" for kind, auroc in ordered]


def _accuracy(store: Store, run: str) -> float:
    value = headlines.headline(store, run, "real").accuracy.value
    return value if np.isfinite(value) else -1.0


def _run_line(store: Store, run: str) -> str:
    parts = []
    for side in ("sim", "real"):
        found = headlines.headline(store, run, "sim" if side == "sim" else "real")
        if not found.n:
            parts.append(f"{side} n/a (all {found.trained_on} trained on)")
            continue
        span = f"{100 * found.accuracy.low:.1f} .. {100 * found.accuracy.high:.1f}"
        left_out = f", {found.trained_on} trained on left out" if found.trained_on else ""
        parts.append(
            f"{side} {100 * found.accuracy.value:.1f} % ({span}), median "
            f"{found.median_error:.2f} m, n {found.n}{left_out}"
        )
    return f"  {run}: " + "; ".join(parts)

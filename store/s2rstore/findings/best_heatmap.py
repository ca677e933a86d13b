"""The heatmap kind that finds changed objects best: the store's own score, else as shipped."""

from __future__ import annotations

from s2rstore.findings.finding import Finding
from s2rstore.heatmap_kinds import SHIPPED_PLACE, heatmap_facts
from s2rstore.metrics import heatmap_scores
from s2rstore.reader import Store

KIND = "best heatmap"


def best_heatmap(store: Store, run: str) -> Finding | None:
    """The best heatmap of a run. Raises RequestError for a score that cannot be read.

    It is evident where its interval lies above those of all heatmaps of other kinds, which is
    stricter than intervals of the differences. The intervals hold for all of these comparisons at
    once. Shipped scores were measured elsewhere, so they are never evident
    here. None where the run has no heatmap with a score.
    """
    scores = heatmap_scores.own_scores(store, run)
    if not scores:
        return _shipped(store, run)
    best = scores[0]
    others = [score for score in scores[1:] if score.kind != best.kind]
    other = others[0] if others else None
    evident = all(best.tested.low > score.tested.high for score in others)
    corrected = f", corrected for {len(scores)} heatmaps" if len(others) > 1 else ""
    label = _label(best.kind, best.mode)
    subject = f"{label}: {best.text} for changed objects"
    right = f"{100 * best.precision:.0f} % of its top cells are right, chance {_percent(best)}"
    next_best = (
        f"; next kind: {_label(other.kind, other.mode)}, {other.text}{corrected}" if other else ""
    )
    kinds = len({score.kind for score in scores})
    return Finding(
        kind=KIND,
        text=f"{subject}, n {kinds} kinds",
        run=run,
        n=kinds,
        evidence=f"scored in this store: {right}{next_best}",
        evident=evident,
        values={
            "heatmap": label,
            "auroc": best.auroc.value,
            "precision_of_top_cells": best.precision,
            "chance": best.chance,
            "source": "score of this store",
        },
        interval=best.auroc,
        interval_of="auroc",
        comparisons=max(1, len(others)),
        n_of="heatmap kinds",
        view="map",
        heat=(best.kind, best.mode),
    )


def _shipped(store: Store, run: str) -> Finding | None:
    kinds = [(record.kind, record.mode) for record in store.array_kinds(run)]
    scored = [choice for choice in kinds if choice[1] in heatmap_facts(choice[0]).auroc]
    if not scored:
        return None
    kind, mode = heatmap_scores.ranked(store, run, list(dict.fromkeys(scored)))[0]
    auroc = heatmap_facts(kind).auroc[mode]
    return Finding(
        kind=KIND,
        text=f"{_label(kind, mode)} by the shipped ranking; this store is not scored",
        run=run,
        n=len(dict(scored)),
        evidence=f"AUROC {auroc:.2f} in {SHIPPED_PLACE}; `s2r score` needs a synthetic world",
        evident=False,
        values={"heatmap": _label(kind, mode), "auroc": auroc, "source": "shipped ranking"},
        n_of="heatmap kinds",
        view="map",
        heat=(kind, mode),
    )


def _label(kind: str, mode: str | None) -> str:
    name = kind.replace("_", " ")
    return f"{name} ({mode})" if mode else name


def _percent(score: heatmap_scores.HeatmapScore) -> str:
    return f"{100 * score.chance:.0f} %"

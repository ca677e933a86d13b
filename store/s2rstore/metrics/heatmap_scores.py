"""How well the heatmaps of a run find changed objects: the store's own score, else shipped."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from s2rstore.errors import RequestError
from s2rstore.heatmap_kinds import HEATMAPS, NO_HEAT, SHIPPED_PLACE, heatmap_facts
from s2rstore.intervals import Interval
from s2rstore.reader import Store

HeatmapChoice = tuple[str, str | None]
"""Kind and mode."""


@dataclass(frozen=True, slots=True)
class HeatmapScore:
    """Score of one heatmap on the floor map of both sides, where all kinds cover the same cells.

    The interval of `tested`, which is `auroc` again, holds for all heatmaps of the run at once.
    `precision` is the share of its top cells that is right, `chance` that of a random map.
    """

    kind: str
    mode: str | None
    auroc: Interval
    tested: Interval
    precision: float
    chance: float

    @property
    def text(self) -> str:
        """`AUROC 0.97 (0.95 to 0.99)`; without the bounds where they are unknown."""
        bounds = f" ({self.auroc.bounds_text()})" if self.auroc.is_known else ""
        return f"AUROC {self.auroc.value:.2f}{bounds}"


def own_scores(store: Store, run: str) -> list[HeatmapScore]:
    """The scores of `s2r score` for a run, the best first; none where it was not scored.

    Scores of an earlier computation of the run do not count. Raises RequestError for a report that
    cannot be read.
    """
    report = store.score_report
    try:
        if not report or not store.run(run).key or report["runs"].get(run) != store.run(run).key:
            return []
        rows = [
            row
            for row in report["heatmaps"]
            if (row["run"], row["place"], row["side"]) == (run, "floor", "both")
            and row["auroc"] is not None
        ]
        scores = [
            HeatmapScore(
                str(row["kind"]),
                row["mode"],
                Interval.from_columns(row, "auroc"),
                Interval.from_columns(row, "tested"),
                float(row["precision"]),
                float(row["base_rate"]),
            )
            for row in rows
        ]
    except (AttributeError, KeyError, TypeError, ValueError) as error:
        message = f"{store.path}: the stored score is invalid"
        raise RequestError(f"{message}; run `s2r score` again") from error
    return sorted(scores, key=lambda score: -score.auroc.value)


def ranked(store: Store, run: str, choices: Sequence[HeatmapChoice]) -> list[HeatmapChoice]:
    """Heatmaps from the best to the worst, by the store's own score of the run, else as shipped.

    Equal heatmaps, and those without a score at the end, are in the order of `HEATMAPS`.
    """
    own = {(score.kind, score.mode): score.auroc.value for score in _readable_scores(store, run)}
    places = {kind: place for place, kind in enumerate(HEATMAPS)}

    def rank(choice: HeatmapChoice) -> tuple[float, int]:
        known = own.get(choice) if own else heatmap_facts(choice[0]).auroc.get(choice[1])
        return -(known or 0.0), places.get(choice[0], len(places))

    return sorted(choices, key=rank)


def trust_line(store: Store, run: str, kind: str, mode: str | None) -> str:
    """What a heatmap shows, and how well it finds changed objects; empty for an unknown kind.

    `what changed between sim and real, not what harms; AUROC 0.97 (0.95 to 0.99) in this store`:
    the figure is from the store's own score, else the shipped one.
    """
    facts = heatmap_facts(kind)
    if not facts.shows or kind == NO_HEAT:
        return facts.shows
    if facts.harm_auroc is not None:
        unit = facts.planes.get(mode or facts.default_mode or "")
        sums = "; sums to metres" if facts.sums_up and unit == "m" else ""
        found = f"AUROC {facts.harm_auroc:.2f} for harmful objects in the demo world"
        return f"{facts.shows}{sums}; {found}"
    own = next((s for s in _readable_scores(store, run) if (s.kind, s.mode) == (kind, mode)), None)
    if own is not None:
        found = f"{own.text} in this store"
    elif (shipped := facts.auroc.get(mode)) is not None:
        found = f"AUROC {shipped:.2f} in {SHIPPED_PLACE}"
    else:
        found = f"AUROC about chance in {SHIPPED_PLACE}"
    return f"{facts.shows}; {found}"


def _readable_scores(store: Store, run: str) -> list[HeatmapScore]:
    """As `own_scores`, and none where the report cannot be read."""
    try:
        return own_scores(store, run)
    except RequestError:
        return []

"""What would help a run: the stored answer of `s2r suggest`, of real images or of the simulator."""

from __future__ import annotations

from typing import Any

from s2rstore.errors import RequestError
from s2rstore.findings.finding import Finding
from s2rstore.metrics.bootstrap import Interval
from s2rstore.reader import Store
from s2rstore.records import SIDES, Side

KIND = "suggested change"
_AIMS: dict[Side, str] = {"real": "real images", "sim": "the simulator"}


def suggested_change(store: Store, run: str) -> Finding | None:
    """The stored suggestion for a run's real images, else for its simulator.

    The first that helps is taken. None where none was stored for the run as it is computed now.
    Raises RequestError where a stored one is invalid.
    """
    found = []
    for side in reversed(SIDES):
        data = store.provenance_object(f"suggestion:{run}", side)
        if not data or data.get("key") != store.run(run).key:
            continue
        try:
            found.append(_finding(data, run, side))
        except (AttributeError, IndexError, KeyError, TypeError, ValueError) as error:
            message = f"{store.path}: the stored suggestion for run {run} is invalid"
            raise RequestError(f"{message}; run `s2r suggest` again") from error
    return next((finding for finding in found if finding.evident), next(iter(found), None))


def _finding(data: dict[str, Any], run: str, side: Side) -> Finding:
    n, best = int(data["judged_instances"]), data["best"]
    if best is None:
        return Finding(
            kind=KIND, text=f"no change of {_AIMS[side]} is shown to help, n {n} held out", run=run,
            n=n, evidence=str(data["reason"]), evident=False, n_of="held-out instances",
            view="overview",
        )  # fmt: skip
    answer = data["answers"][int(best)]
    gain = answer["gain"]
    low, value, high = (_number(gain[name]) for name in ("low", "value", "high"))
    interval = Interval(low, value, high, float(gain["level"]))
    changes = ", ".join(f"{each['adjustment']}={each['value']:g}" for each in answer["changes"])
    if side == "real":
        figures, name = f"gains {value:.2f} m ({low:.2f} to {high:.2f} m)", "gain_m"
    else:
        share, bounds = f"{100 * value:.0f} %", f"{100 * low:.0f} to {100 * high:.0f} %"
        figures, name = f"closes {share} of the mismatch of the images ({bounds})", "mismatch_share"
    return Finding(
        kind=KIND,
        text=f"{_AIMS[side]}: {changes} {figures}, n {n} held out",
        run=run,
        n=n,
        evidence=f"fitted on other instances, corrected for {len(data['answers'])} answers; "
        f"`s2r suggest --run {run} --for {side} --apply {int(best) + 1}` makes a run of it",
        evident=interval.low > 0,
        values={"for": side, "factor": str(answer["factor"]), "changes": changes, name: value},
        interval=interval,
        interval_of=name,
        comparisons=len(data["answers"]),
        n_of="held-out instances",
        view="overview",
    )


def _number(value: float | None) -> float:
    return float("nan") if value is None else float(value)

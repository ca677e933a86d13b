"""What would help a run: the stored answer of `s2r suggest`, of real images or of the simulator."""

from __future__ import annotations

from s2rstore.findings.finding import Finding
from s2rstore.reader import Store
from s2rstore.records import SIDES, Side
from s2rstore.suggestions import SuggestReport, read_report

KIND = "suggested change"
_CHANGED: dict[Side, str] = {"real": "real images", "sim": "the simulator"}


def suggested_change(store: Store, run: str) -> Finding | None:
    """The stored suggestion for a run's real images, else for its simulator.

    The first that helps is taken. None where none was stored for the run as it is computed now.
    Raises RequestError where a stored one is invalid.
    """
    reports = [read_report(store, run, side) for side in reversed(SIDES)]
    found = [_finding(report) for report in reports if report is not None]
    return next((finding for finding in found if finding.evident), next(iter(found), None))


def _finding(report: SuggestReport) -> Finding:
    n, side = report.judged_instances, report.side
    if report.best is None:
        return Finding(
            kind=KIND, text=f"no change of {_CHANGED[side]} is shown to help, n {n} held out",
            run=report.run, n=n, evidence=report.reason, evident=False, n_of="held-out instances",
            view="suggestions",
        )  # fmt: skip
    answer = report.answers[report.best]
    gain = answer.gain
    if side == "real":
        figures = f"gains {gain.value:.2f} m ({gain.bounds_text(unit='m')})"
        name = "gain_m"
    else:
        share = f"{100 * gain.value:.0f} %"
        bounds = gain.scaled(100).bounds_text("{:.0f}".format, "%")
        figures, name = f"closes {share} of the mismatch of the images ({bounds})", "mismatch_share"
    return Finding(
        kind=KIND,
        text=f"{_CHANGED[side]}: {answer.changes_text} {figures}, n {n} held out",
        run=report.run,
        n=n,
        evidence=f"fitted on other instances, corrected for {len(report.answers)} answers; "
        f"`s2r suggest --run {report.run} --for {side} --apply {report.best + 1}` "
        "makes a run of it",
        evident=answer.evident,
        values={
            "for": side, "factor": answer.factor, "factors": ", ".join(answer.factors),
            "changes": answer.changes_text, name: gain.value,
        },
        interval=gain,
        interval_of=name,
        comparisons=len(report.answers),
        n_of="held-out instances",
        view="suggestions",
    )  # fmt: skip

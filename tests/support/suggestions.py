"""Made-up results of `s2r suggest`, and stores that keep them."""

from pathlib import Path

import s2rstore
from s2rstore.index.transaction import edit
from s2rstore.intervals import Interval
from s2rstore.records import Side
from s2rstore.suggestions import Agreement, Answer, Change, SuggestReport, section
from s2rstore.suggestions.report import AIMS
from s2rtui.charts.suggestions import Direction, SuggestionsInput

_CHANGES: dict[Side, tuple[Change, ...]] = {
    "real": (
        Change("brightness", "exposure", "", 1.0, 0.85),
        Change("vignette", "exposure", "", 0.0, 0.37),
        Change("depth_blur", "depth", "px", 0.0, 1.2),
    ),
    "sim": (
        Change("camera_height", "camera", "m", 0.0, -0.07, Interval(-0.072, -0.07, -0.068), -0.09),
        Change("lamp_power", "lights", "", 1.0, 0.68, Interval(0.61, 0.68, 0.74)),
        Change("depth_noise", "depth", "", 0.0, 0.0075, Interval(0.007, 0.0075, 0.008)),
    ),
}
AGREEMENT = Agreement(0.54, 2.84, 3.87, 3.91, 2.56, Interval(0.23, 1.35, 2.64), 0.02, 0.64)


def suggest_report(
    side: Side = "real", answers: int = 3, helps: bool = True, run: str = "vanilla", key: str = "k"
) -> SuggestReport:
    """A report whose answer of n changes gains n tenths; the first one is not evident.

    With `helps` the last answer is suggested.
    """
    made = []
    for n in range(1, answers + 1):
        changes = _CHANGES[side][:n]
        chain = tuple({"name": each.name, "value": each.value} for each in changes)
        low = 0.1 * n - 0.05 if n > 1 and helps else -0.04
        gain = Interval(low, 0.1 * n, 0.1 * n + 0.1, 0.983)
        agreement = AGREEMENT if side == "sim" else None
        made.append(Answer(changes, 0.1 * n + 0.02, gain, chain, agreement))
    is_found = helps and answers > 1
    return SuggestReport(
        run=run, side=side, key=key, price=0.02, seed=1, before=2.0,
        gap=Interval(1.0, 2.0, 3.0), fitted_instances=48, judged_instances=50, evaluations=300,
        complete=True, answers=tuple(made), best=answers - 1 if is_found else None,
        reason="" if is_found else "no change that gains its price helps",
    )  # fmt: skip


def suggestions_input(real: int = 3, sim: int = 3, chosen: str | None = None) -> SuggestionsInput:
    """Both directions with these numbers of answers; one with none has no stored report."""
    directions = []
    counts: tuple[tuple[Side, int], ...] = (("real", real), ("sim", sim))
    for side, count in counts:
        if count:
            report = suggest_report(side, count)
            commands = tuple(
                f"s2r run add {each.default_name} --adjust {side}:{each.changes_text}"
                for each in report.answers
            )
            directions.append(Direction(side, AIMS[side], report, commands))
        else:
            note = f"no stored result; `s2r suggest s.s2r --for {side}` computes one"
            directions.append(Direction(side, AIMS[side], note=note))
    return SuggestionsInput(tuple(directions), chosen)


def store_reports(path: Path, run: str, *sides: Side, helps: bool = True) -> None:
    """Store a report of a run for each side, as `s2r suggest` does."""
    with s2rstore.open(path) as store:
        key = str(store.run(run).key)
    with edit(path) as draft:
        for side in sides:
            report = suggest_report(side, helps=helps, run=run, key=key)
            draft.set_provenance(section(run), {side: report.as_json()})

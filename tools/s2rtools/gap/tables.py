"""The text of a gap report: axes, rank consistency, golden run and verdict."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from s2rstore.gap_history.gate_status import report_outcome
from s2rstore.intervals import LEVEL_TEXT
from s2rtools.common.command_line import output
from s2rtools.gap.axes import AXES
from s2rtools.gap.axis import with_interval


def gap_text(report: dict[str, Any], with_details: bool = False, frozen: bool = False) -> str:
    """Return the axes, the axes that are missing, and the outcome.

    `frozen`: a reference scale or a golden run was written from this report.
    """
    return "\n".join([*_lines(report, with_details), _outcome(report, frozen)])


def _lines(report: dict[str, Any], with_details: bool) -> Iterator[str]:
    model = f"model {report['model']}" if report["model"] else "imported predictions"
    yield (
        f"run {report['run']}, {model}, {report['selected']} instances ({report['expression']})\n"
    )
    yield _axes(report["axes"])
    for axis in report["axes"]:
        yield from _notes(axis)
    for axis in report["axes"] if with_details else ():
        yield f"\n{axis['axis'].upper()}\nfloor {axis['floor_is']}"
        yield from AXES[axis["axis"]].load()().describe(axis["details"])
    for name, reason in (report["absent"] | report["inconclusive"]).items():
        yield f"  {name}: not measured: {reason}"
    if report["across"]:
        yield from _rank_consistency(report["across"], with_details)
    if report["exchange"]:
        yield f"  simulation: {report['exchange']['text']}"
    if report["golden"]:
        yield _golden(report["golden"])
    if report["reference"]:
        source = report["reference"]["made_from"]
        parts = (f"{name} {source.get(name, '?')}" for name in ("dataset", "run", "expression"))
        yield f"  reference scale frozen from {', '.join(parts)}"


def _axes(axes: list[dict[str, Any]]) -> str:
    level = f"({LEVEL_TEXT})"
    names = ("axis", "m", f"value {level}", "floor", "unit", "n", f"G {level}")
    rows = [
        (
            axis["axis"], axis["measure"], with_interval(axis, "value"), _floor(axis), axis["unit"],
            axis["n"], with_interval(axis, "gap", 1),
        )
        for axis in axes
    ]  # fmt: skip
    return output.table(names, rows)


def _floor(axis: dict[str, Any]) -> str:
    """Return the floor; without an interval if it is a constant."""
    if axis["floor_low"] == axis["floor"] == axis["floor_high"]:
        return f"{axis['floor']:g}"
    return with_interval(axis, "floor")


def _notes(axis: dict[str, Any]) -> Iterator[str]:
    """Yield the meaning of G = 100, and the notes."""
    if "anchor" in axis:
        yield (
            f"  {axis['axis']}: G 100 is {with_interval(axis, 'anchor')} {axis['unit']}: "
            f"{axis['anchor_state']}"
        )
    yield from (f"  {axis['axis']}: {note}" for note in axis["notes"])


def _rank_consistency(across: dict[str, Any], with_details: bool) -> Iterator[str]:
    if "refused" in across:
        yield f"  across runs: {across['refused']}"
        return
    correlations = ", ".join(
        f"{name} {'-' if across[name.lower()] is None else format(across[name.lower()], '.2f')}"
        for name in ("Kendall", "Pearson")
    )
    yield (
        f"  across {len(across['runs'])} runs: Spearman {with_interval(across, 'spearman', 2)}, "
        f"about {across['scope']}; of these runs only: {correlations}, MMRV "
        f"{across['mmrv']:.2f} m"
    )
    yield (
        f"  regret of {across['chosen_run']}, which simulation ranks first: "
        f"{with_interval(across, 'regret', 2)} m more real error than {across['best_run']}"
    )
    if not with_details or not across["rooms"]:
        return
    rows = [
        (
            room, within["n"], *(within[name] for name in ("spearman", "kendall", "mmrv")),
            within["chosen_run"], within["best_run"], with_interval(within, "regret", 2),
        )
        for room, within in across["rooms"].items()
    ]  # fmt: skip
    names = ("room", "n", "Spearman", "Kendall", "MMRV m", "by sim", "best", "regret m")
    yield output.table(names, rows)


def _golden(golden: dict[str, Any]) -> str:
    missing = f"{golden['missing']} of its instances are missing" if golden["missing"] else ""
    text = (
        f"golden run: {golden['outcome']}: mean real error changed by "
        f"{with_interval(golden, 'change')} m over {golden['n']} instances, "
        f"margin {golden['margin']:g} m"
    )
    return "; ".join(part for part in (text, missing, golden["reason"]) if part)


def _outcome(report: dict[str, Any], frozen: bool) -> str:
    outcome = report_outcome(report)
    if outcome is None and frozen:
        return "\nnot judged yet: give the frozen files to --reference and --golden"
    if outcome is not None and not report["reference"]:
        return f"\n{outcome}: by the golden run alone; give --reference FILE to judge G as well"
    text = _verdict(report["verdict"])
    if outcome is not None and outcome != report["verdict"]["outcome"]:
        text += f"\n{outcome}: with the golden run"
    return text


def _verdict(verdict: dict[str, Any]) -> str:
    if verdict["worst"] is None:
        return f"\n{verdict['outcome']}: {verdict['reason']}"
    return (
        f"\n{verdict['outcome']}: gap {with_interval(verdict, 'gap', 1)}, "
        f"worst axis {verdict['worst']}; {verdict['reason']}"
    )

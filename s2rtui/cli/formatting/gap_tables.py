"""A gap's report as text."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from s2rstore.gap_history.gate_status import of_report
from s2rstore.metrics.bootstrap import LEVEL_TEXT
from s2rtui.cli.formatting import rows as output
from s2rtui.cli.formatting.gap_details import bounds, details


def tables(found: dict[str, Any], with_details: bool = False, froze: bool = False) -> str:
    """The axes, what could not be measured, and last what the exit code says.

    `froze`: a scale or a golden run was taken of it.
    """
    return "\n".join([*_lines(found, with_details), _decided(found, froze)])


def _lines(found: dict[str, Any], with_details: bool) -> Iterator[str]:
    yield (
        f"run {found['run']}, model {found['model']}, {found['selected']} instances "
        f"({found['expression']})\n"
    )
    yield _axes(found["axes"])
    for each in found["axes"]:
        yield from _said(each)
    for each in found["axes"] if with_details else ():
        yield f"\n{each['axis'].upper()}\nfloor {each['floor_is']}"
        yield from details(each)
    for axis, why in (found["absent"] | found["inconclusive"]).items():
        yield f"  {axis}: not measured: {why}"
    if found["across"]:
        yield from _across(found["across"])
    if found["golden"]:
        yield _golden(found["golden"])
    if found["reference"]:
        made = found["reference"]["made_from"]
        told = (f"{name} {made.get(name, '?')}" for name in ("dataset", "run", "expression"))
        yield f"  the scale was frozen of {', '.join(told)}"


def _axes(axes: list[dict[str, Any]]) -> str:
    level = f"({LEVEL_TEXT})"
    names = ("axis", "m", f"value {level}", "floor", "unit", "n", f"G {level}")
    rows = [
        (
            each["axis"], each["measure"], bounds(each, "value"), _floor(each), each["unit"],
            each["n"], bounds(each, "gap", 1),
        )
        for each in axes
    ]  # fmt: skip
    return output.table(names, rows)


def _floor(axis: dict[str, Any]) -> str:
    """Without an interval where nothing about it was measured."""
    if axis["floor_low"] == axis["floor"] == axis["floor_high"]:
        return f"{axis['floor']:g}"
    return bounds(axis, "floor")


def _said(axis: dict[str, Any]) -> Iterator[str]:
    """What 100 is, and the notes."""
    if "anchor" in axis:
        yield (
            f"  {axis['axis']}: G 100 is {bounds(axis, 'anchor')} {axis['unit']}: "
            f"{axis['anchor_state']}"
        )
    yield from (f"  {axis['axis']}: {note}" for note in axis["notes"])


def _across(across: dict[str, Any]) -> Iterator[str]:
    if "refused" in across:
        yield f"  across runs: {across['refused']}"
        return
    for name, key in (("Sim-vs-Real correlation", "srcc"), ("MMRV", "mmrv")):
        yield f"  across {len(across['runs'])} runs: {name} {bounds(across, key, 2)}"


def _golden(golden: dict[str, Any]) -> str:
    missing = f"{golden['missing']} of it are not here" if golden["missing"] else ""
    told = (
        f"golden run: {golden['outcome']}: mean real error changed by {bounds(golden, 'change')} m "
        f"over {golden['n']} instances, margin {golden['margin']:g} m"
    )
    return "; ".join(part for part in (told, missing, golden["reason"]) if part)


def _decided(found: dict[str, Any], froze: bool) -> str:
    word = of_report(found)
    if word is None and froze:
        return "\nnothing is judged yet: `--reference` and `--golden` judge by what was frozen"
    if word is not None and not found["reference"]:
        return f"\n{word}: by the golden run alone; `--reference REF.json` judges G, too"
    told = _verdict(found["verdict"])
    if word is not None and word != found["verdict"]["outcome"]:
        told += f"\n{word}: with the golden run"
    return told


def _verdict(verdict: dict[str, Any]) -> str:
    if verdict["worst"] is None:
        return f"\n{verdict['outcome']}: {verdict['reason']}"
    return (
        f"\n{verdict['outcome']}: gap {bounds(verdict, 'gap', 1)}, worst axis {verdict['worst']}; "
        f"{verdict['reason']}"
    )

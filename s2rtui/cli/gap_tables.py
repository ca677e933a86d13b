"""A gap's report as text."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from s2rtui.cli import output


def tables(found: dict[str, Any]) -> str:
    """The axes, what could not be measured, and the verdict last."""
    return "\n".join(_lines(found))


def _lines(found: dict[str, Any]) -> Iterator[str]:
    yield (
        f"run {found['run']}, model {found['model']}, {found['selected']} instances "
        f"({found['expression']})\n"
    )
    rows = [
        (
            each["axis"], each["measure"], _bounds(each, "value"), _bounds(each, "floor"),
            each["unit"], each["n"], _bounds(each, "gap", 1),
        )
        for each in found["axes"]
    ]  # fmt: skip
    names = ("axis", "m", "value (95 %)", "floor", "unit", "n", "G (95 %)")
    yield output.table(names, rows)
    for each in found["axes"]:
        yield from (f"  {each['axis']}: {note}" for note in each["notes"])
    for axis, why in (found["absent"] | found["inconclusive"]).items():
        yield f"  {axis}: not measured: {why}"
    across = found["across"] or {}
    if "refused" in across:
        yield f"  across runs: {across['refused']}"
    elif across:
        yield "".join(
            f"  across {len(across['runs'])} runs: {name} {_bounds(across, key, 2)}\n"
            for name, key in (("Sim-vs-Real correlation", "srcc"), ("MMRV", "mmrv"))
        ).rstrip()
    golden = found["golden"]
    if golden:
        yield (
            f"golden run: {golden['outcome']}: mean real error changed by "
            f"{_bounds(golden, 'change')} m over {golden['n']} instances, "
            f"margin {golden['margin']:g} m"
            + (f"; {golden['missing']} of it are not here" if golden["missing"] else "")
            + (f"; {golden['reason']}" if golden["reason"] else "")
        )
    yield _verdict(found["verdict"])


def _verdict(verdict: dict[str, Any]) -> str:
    if verdict["worst"] is None:
        return f"\n{verdict['outcome']}: {verdict['reason']}"
    return (
        f"\n{verdict['outcome']}: gap {_bounds(verdict, 'gap', 1)}, worst axis {verdict['worst']}; "
        f"{verdict['reason']}"
    )


def _bounds(row: dict[str, Any], name: str, digits: int = 3) -> str:
    value, low, high = (row.get(f"{name}{end}") for end in ("", "_low", "_high"))
    if value is None:
        return "-"
    bounds = " .. ".join("?" if end is None else f"{end:.{digits}f}" for end in (low, high))
    return f"{value:.{digits}f} ({bounds})"

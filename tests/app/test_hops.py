"""A typed expression takes the way that the documentation lists, and no other."""

from __future__ import annotations

import re
import sys
from pathlib import Path
from types import FrameType
from typing import Any

import s2rtui
from tests.support.application import press, running

PAGE = Path(s2rtui.__file__).parents[1] / "docs" / "architecture.md"
HOP = re.compile(r"^\| \d+ \| `([\w.<>]+)` `([\w.]+)` \|", re.MULTILINE)
MOST = 15
"""Hops from a key to cells."""


def documented() -> list[tuple[str, str]]:
    """Module and function of each hop; the view is that of the errors."""
    hops = HOP.findall(PAGE.read_text(encoding="utf-8"))
    named = ((module.replace("<view>", "errors"), function) for module, function in hops)
    return [
        (module if module.startswith("s2rstore") else f"s2rtui.{module}", function)
        for module, function in named
    ]


async def test_a_typed_expression_takes_the_documented_way(tiny_store):
    hops = documented()
    assert len(hops) <= MOST
    wanted = {function.rsplit(".", 1)[-1]: (place, module)
              for place, (module, function) in enumerate(hops)}  # fmt: skip
    seen: list[int] = []

    def trace(frame: FrameType, event: str, argument: Any) -> None:
        if event == "call" and frame.f_code.co_name in wanted:
            place, module = wanted[frame.f_code.co_name]
            if frame.f_globals.get("__name__", "").startswith(module) and place not in seen:
                seen.append(place)

    async with running(tiny_store, size=(80, 24)) as (app, pilot):
        await press(app, pilot, "c", "7", "slash", "ampersand", *"worst15")
        sys.setprofile(trace)
        try:
            await press(app, pilot, "enter")
        finally:
            sys.setprofile(None)
        assert app.session.state.expression == "all & worst15", app.session.state.message
    missing = [hops[place] for place in set(range(len(hops))) - set(seen)]
    assert not missing
    assert seen == sorted(seen)

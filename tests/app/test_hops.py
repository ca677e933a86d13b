"""The key `w` takes the way from the key to cells that the documentation lists, and no other."""

from __future__ import annotations

import re
import sys
from collections.abc import Iterator
from pathlib import Path
from types import FrameType
from typing import Any

import s2rtui
from s2rstore.language import parser
from tests.support.application import press, running

PAGE = Path(s2rtui.__file__).parents[1] / "docs" / "architecture.md"
HOP = re.compile(r"^\| \d+ \| `([\w.<>]+)` `([\w.]+)` \| `(\w+)` \|", re.MULTILINE)
MOST_FILES, MOST_CHANGES = 15, 8


def documented() -> list[tuple[str, str, str]]:
    """Module, function and type of each hop; the view is that of the errors."""
    return [
        (f"{'' if module.startswith('s2rstore') else 's2rtui.'}{module}"
         .replace("<view>", "errors"), function, kind)
        for module, function, kind in HOP.findall(PAGE.read_text(encoding="utf-8"))
    ]  # fmt: skip


def type_names(values: list[Any]) -> set[str]:
    """The classes of values, and of the first elements of lists."""
    first = (value[0] if isinstance(value, list) and value else value for value in values)
    return {kind.__name__ for value in first for kind in type(value).__mro__}


def modules_from_the_action(frame: FrameType | None) -> Iterator[str]:
    """The modules of the project on the stack below `action_do`, without packages' entries."""
    while frame is not None and frame.f_code.co_name != "action_do":
        module = frame.f_globals.get("__name__", "")
        if module.startswith(("s2rtui.", "s2rstore.")) and "__path__" not in frame.f_globals:
            yield module
        frame = frame.f_back


def test_few_files_and_types_are_on_the_way():
    hops = documented()
    assert len({module for module, _, _ in hops}) == len(hops) <= MOST_FILES
    assert len({kind for _, _, kind in hops}) - 1 <= MOST_CHANGES


async def test_the_key_takes_the_documented_way(tiny_store):
    hops = documented()
    modules = {module: place for place, (module, _, _) in enumerate(hops)}
    entered: list[int] = []
    values: dict[int, set[str]] = {}
    passed: set[str] = set()

    def trace(frame: FrameType, event: str, argument: Any) -> None:
        place = modules.get(frame.f_globals.get("__name__", ""))
        name = frame.f_code.co_qualname.split(".<locals>")[0]
        if place is None or event not in ("call", "return"):
            return
        if not f".{name}".endswith(f".{hops[place][1]}"):
            return
        if place not in entered:
            entered.append(place)
            passed.update(modules_from_the_action(frame))
        kinds = type_names([argument, *frame.f_locals.values()])
        values[place] = values.get(place, set()) | kinds

    async with running(tiny_store, size=(80, 24)) as (app, pilot):
        await press(app, pilot, "c", "7")
        parser.parse.cache_clear()  # another test may have parsed the expression
        sys.setprofile(trace)
        try:
            await press(app, pilot, "w")
        finally:
            sys.setprofile(None)
        assert app.session.state.expression == "worst15", app.session.state.message
    assert entered == sorted(entered)
    assert len(entered) == len(hops), [hop for at, hop in enumerate(hops) if at not in entered]
    assert passed <= {module for module, _, _ in hops}
    for place, (_, function, kind) in enumerate(hops):
        assert kind in values[place], (function, kind, values[place])

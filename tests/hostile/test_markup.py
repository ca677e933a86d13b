"""No text from outside is parsed as markup: not by Textual, not by rich, not by matplotlib."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from pathlib import Path

import pytest
import rich.markup
import rich.text
from textual.content import Content
from textual.pilot import Pilot
from textual.screen import ModalScreen
from textual.widgets import Static

import s2rtui
from s2rtui.app.actions import ACTIONS
from s2rtui.app.app import S2RApp
from s2rtui.app.pilot import settle, take_screenshot
from s2rtui.app.status_line import Bar
from s2rtui.canvas import RenderOptions
from s2rtui.session import Session
from s2rtui.user_data.notebook import Notebook, SavedSelection
from tests.support import hostile
from tests.support.copies import copy_store

SOURCES = Path(s2rtui.__file__).parent
WIDGETS = {"Static", "Label", "Button", "Checkbox", "Link", "OptionList", "SelectionList"}
TEXTS = {"Option", "Selection", "Toast", "Notification"}
BAD_NAMES = ("[/", "[ @click=app.quit]CLICK", "[b", "[link=file:///]x[/link]")


@pytest.fixture
def no_foreign_markup(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """Parsed markup that comes from a store: a list that must stay empty."""
    found: list[str] = []
    parsed = Content.from_markup

    def from_markup(markup: str | Content, **variables: object) -> Content:
        if any(sign in str(markup) for sign in ("CLICK", "[/ ", "@click")):
            found.append(str(markup))
        return parsed(markup, **variables)

    def rendered(markup: str, *options: object, **named: object) -> rich.text.Text:
        if any(sign in markup for sign in ("CLICK", "[/ ", "@click")):
            found.append(markup)
        return rich.text.Text(markup)

    monkeypatch.setattr(Content, "from_markup", staticmethod(from_markup))
    monkeypatch.setattr(rich.markup, "render", rendered)
    monkeypatch.setattr(rich.text, "render", rendered, raising=False)
    return found


def calls() -> Iterator[tuple[str, str, ast.Call]]:
    """Place, name and call of all calls in the application."""
    for path in sorted(SOURCES.rglob("*.py")):
        tree = ast.parse(path.read_text(encoding="utf-8"))
        uses_textual = any(
            isinstance(node, ast.ImportFrom) and (node.module or "").startswith("textual")
            for node in ast.walk(tree)
        )
        for node in ast.walk(tree):
            if isinstance(node, ast.Call):
                name = node.func.attr if isinstance(node.func, ast.Attribute) else (
                    node.func.id if isinstance(node.func, ast.Name) else ""
                )  # fmt: skip
                place = f"{path.relative_to(SOURCES)}:{node.lineno}"
                yield place, name if uses_textual or name != "update" else "", node


def is_off(call: ast.Call) -> bool:
    """Whether a call says `markup=False`."""
    return any(
        word.arg == "markup" and isinstance(word.value, ast.Constant) and word.value.value is False
        for word in call.keywords
    )


def is_content(call: ast.Call) -> bool:
    """Whether the first argument of a call is made by `Content`, not by its markup parser."""
    first = call.args[0] if call.args else None
    if not isinstance(first, ast.Call):
        return False
    made = ast.unparse(first.func)
    return made in ("Content", "Content.assemble", "dict", "dict.fromkeys")


def test_no_widget_takes_a_string_with_markup_on() -> None:
    wrong = []
    for place, name, call in calls():
        if (name in WIDGETS or (name == "notify" and call.args)) and not is_off(call):
            wrong.append(f"{place}: {name} without markup=False")
        if name in TEXTS and not is_content(call):
            wrong.append(f"{place}: {name} of a string")
        if name == "update" and call.args and not is_content(call):
            wrong.append(f"{place}: update with a string")
        if name in ("from_markup", "print_markup", "rprint"):
            wrong.append(f"{place}: {name}")
        if name == "TextColumn" and not is_off(call):
            wrong.append(f"{place}: TextColumn without markup=False")
        if ast.unparse(call.func).endswith("console.print") and not is_off(call):
            wrong.append(f"{place}: console.print without markup=False")
    assert not wrong


def test_no_widget_has_a_title_or_a_tooltip_that_is_markup() -> None:
    attributes = {"tooltip", "border_title", "border_subtitle", "title", "sub_title"}
    wrong = []
    for path in sorted(SOURCES.rglob("*.py")):
        text = path.read_text(encoding="utf-8")
        if "from textual" not in text:
            continue
        for node in ast.walk(ast.parse(text)):
            targets = node.targets if isinstance(node, ast.Assign) else ()
            wrong += [f"{path.name}:{t.lineno} {t.attr}" for t in targets
                      if isinstance(t, ast.Attribute) and t.attr in attributes]  # fmt: skip
    assert not wrong


async def drive(app: S2RApp, pilot: Pilot[None]) -> None:
    """Press every key of the registry, and leave each screen that opens."""
    for action in ACTIONS:
        if action.name in ("quit", "report", "adjust", "save_run"):
            continue
        await pilot.press(action.keys[0])
        await settle(app, pilot)
        assert app.fault is None, action.name
        assert app.is_running, action.name
        take_screenshot(app)
        while isinstance(app.screen, ModalScreen) or app.prompt.is_open:
            await pilot.press("escape")


async def test_the_whole_application_parses_no_markup_of_a_store(
    hostile_store: Path, user_data_folder: Path, tmp_path: Path, no_foreign_markup: list[str]
) -> None:
    book = hostile.saved_entry(f'room:"{hostile.MARKUP}"', run=hostile.MARKUP)
    hostile.notebook(user_data_folder, selections={"[ @click=app.quit]CLICK": book, "[b": book},
                     remarks={"3": {"tags": ["[/", "CLICK"], "note": hostile.MARKUP}},
                     history=[hostile.MARKUP])  # fmt: skip
    app = S2RApp(Session(hostile_store, "vanilla", Notebook), RenderOptions(), tmp_path)
    app.load_scheduler.debounce_seconds = 0.001
    async with app.run_test(size=(150, 44)) as pilot:
        await settle(app, pilot)
        await drive(app, pilot)
        await pilot.press("ctrl+p")
        await pilot.pause()
        await pilot.press(*"CLICK")
        await pilot.pause()
        await pilot.press("escape", "escape")
        app.show_error(hostile.MARKUP)
        await pilot.pause()
        assert app.is_running
    assert app.fault is None
    assert not no_foreign_markup


@pytest.mark.parametrize("name", BAD_NAMES)
async def test_a_room_is_text_and_not_an_action(store_copy: Path, name: str) -> None:
    hostile.edit(store_copy, ("UPDATE room SET room = ? || room", [name]),
                 ("UPDATE instance SET room = ? || room", [name]))  # fmt: skip
    app = S2RApp(Session(store_copy), RenderOptions())
    app.load_scheduler.debounce_seconds = 0.001
    async with app.run_test(size=(160, 44)) as pilot:
        await settle(app, pilot)
        app.session.select(f'room:"{name}right"')
        app.refresh_views()
        await pilot.pause()
        segments = [segment for line in take_screenshot(app).lines for segment in line]
        assert f"{name}right" in "".join(segment.text for segment in segments)
        metas = [segment.style.meta for segment in segments if segment.style]
        assert not any("@click" in meta for meta in metas)
        for column in range(0, 160, 4):
            await pilot.click(Static, offset=(column, 0))
        assert app.is_running
        assert app.fault is None


async def test_names_of_a_folder_a_tag_and_a_saved_selection(
    tiny_store: Path, tmp_path: Path
) -> None:
    store = copy_store(tiny_store, tmp_path / "[ [@click=app.quit].s2r")
    book = Notebook("0" * 64)
    for name in BAD_NAMES:
        book.save(name, SavedSelection("worst15", 1, "vanilla", 6))
    book.toggle_tag([3], "[ tag")
    app = S2RApp(Session(store, notebooks=Notebook), RenderOptions())
    app.load_scheduler.debounce_seconds = 0.001
    async with app.run_test(size=(160, 44)) as pilot:
        await settle(app, pilot)
        assert "[ [@click=app.quit].s2r" in app.status_text()
        app.session.select('@"[b"')
        app.refresh_views()
        await pilot.press("f")
        await pilot.pause()
        await pilot.press("escape", "slash", *"@", "tab", "tab")
        await pilot.pause()
        assert app.is_running
    assert app.fault is None


async def test_a_bar_shows_pieces_as_they_are() -> None:
    content = Bar("status")
    content.show("[b]a[/b]", ("[ @click=app.quit]", "bold"), "\x1b[31m")
    shown = content.visual
    assert isinstance(shown, Content)
    assert shown.plain == "[b]a[/b][ @click=app.quit]\\x1b[31m"

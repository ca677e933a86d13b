"""Permissions of a session: paths, models and actions."""

from pathlib import Path

import pytest
import textual.actions
from hypothesis import given
from hypothesis import strategies as st

from s2rstore.errors import RequestError
from s2rtui.app import key_bindings
from s2rtui.app.action import Action
from s2rtui.app.key_bindings import ACTIONS, find_action, footer, permitted_actions
from s2rtui.app.pilot import settle, take_screenshot
from s2rtui.app.screens.help_content import help_lines
from s2rtui.security import Permissions
from s2rtui.session import view_settings
from s2rtui.session.session import Session
from tests.support.application import press, running

MODEL_ACTION = Action(
    "side", "d", "heat", "mist in the images", view_settings.change_side, "mist", needs="models"
)
NAMES = st.lists(st.sampled_from(["..", ".", "a", "b", "s2rtui", "own"]), max_size=6)


def restricted(folder: Path) -> Permissions:
    return Permissions(folder / "s.s2r", folder / "own", True)


@given(NAMES)
def test_a_restricted_session_writes_only_in_the_user_data_folder(names):
    access = restricted(Path("/srv"))
    path = access.user_data_dir.joinpath(*names)
    is_inside = Path("/srv/own") in [path.resolve(), *path.resolve().parents]
    assert access.may_write(path) == is_inside


def test_the_store_and_links_to_outside_are_not_writable(tmp_path):
    access = restricted(tmp_path)
    access.user_data_dir.mkdir()
    (access.user_data_dir / "out").symlink_to(tmp_path)
    assert access.may_write(access.user_data_dir / "a.png")
    assert not access.may_write(access.user_data_dir / "out" / "a.png")
    assert not access.may_write(access.store / "CURRENT.json")
    with pytest.raises(RequestError, match="can write only in"):
        access.require_writable(tmp_path / "a.png")


def test_an_unrestricted_session_may_do_everything(tmp_path):
    access = Permissions(tmp_path / "s.s2r", tmp_path / "own")
    assert access.allows("models")
    assert access.require_writable(tmp_path / "a.png") == tmp_path / "a.png"
    assert permitted_actions(access) == list(ACTIONS)


@pytest.fixture
def action_that_loads_models(monkeypatch: pytest.MonkeyPatch) -> None:
    """Replaces an action by one that loads models."""
    changed = tuple(MODEL_ACTION if action.name == "side" else action for action in ACTIONS)
    monkeypatch.setattr(key_bindings, "ACTIONS", changed)
    monkeypatch.setattr(key_bindings, "BY_NAME", {action.name: action for action in changed})


@pytest.mark.usefixtures("action_that_loads_models")
def test_forbidden_actions_are_not_offered(tiny_store, tmp_path):
    access = restricted(tmp_path)
    session = Session(tiny_store)
    assert MODEL_ACTION not in permitted_actions(access)
    assert {action.needs for action in permitted_actions(access)} == {""}
    assert "mist" not in [word for _, word in footer(900, session.state, access)]
    assert "mist in the images" not in "".join(help_lines(access))
    unrestricted = Permissions(tmp_path, tmp_path)
    assert "mist" in [word for _, word in footer(900, session.state, unrestricted)]
    assert "mist in the images" in "".join(help_lines(unrestricted))
    session.close()


def test_actions_are_found_by_their_call():
    for action in ACTIONS:
        _, name, parameters = textual.actions.parse(action.call)
        assert find_action(name, parameters) is action


@pytest.mark.usefixtures("action_that_loads_models")
async def test_a_forbidden_action_shows_a_message(tiny_store):
    async with running(tiny_store, restricted=True) as (app, pilot):
        before = app.session.state.heat
        for call in ("do('side')", "app.do('side')"):
            app.session.show_message("")
            await app.run_action(call)
            assert "restricted" in app.session.state.message
        app.session.show_message("")
        await press(app, pilot, "d")
        assert app.session.state.heat == before
        assert "not in a restricted session: mist in the images" in take_screenshot(app).text
        titles = [command.title for command in app.get_system_commands(app.screen)]
        assert len(titles) > 10
        assert not any("mist in the images" in title for title in titles)


async def test_actions_of_textual_are_disabled(tiny_store, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    calls = ("screenshot('a.svg', '.')", "app.suspend_process", "app.simulate_key('w')",
             "change_theme", "app.push_screen('x')", "app.toggle('animation_level')")  # fmt: skip
    async with running(tiny_store, restricted=True, size=(80, 24)) as (app, pilot):
        for call in calls:
            app.session.show_message("")
            await app.run_action(call)
            await settle(app, pilot)
            assert "not in a restricted session" in app.session.state.message, call
        for key in ("w", "question_mark", "escape", "tab", "ctrl+z", "ctrl+p", "escape"):
            await press(app, pilot, key)
    assert [path.name for path in tmp_path.iterdir()] == ["share"]  # of the user's data

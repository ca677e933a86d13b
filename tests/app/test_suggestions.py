"""Answers of `s2r suggest` in the application: choosing and applying them."""

from pathlib import Path

import pytest

from s2rtui.app.pilot import take_screenshot
from s2rtui.charts.suggestions import VIEW
from s2rtui.loaders.live_prediction import LivePredictor
from s2rtui.session import adjusting
from s2rtui.session.adjusting import adjustment_chains
from s2rtui.session.session import Session
from tests.app.test_screen_snapshots import StoredPredictor
from tests.support.application import make_app, press, running
from tests.support.suggestions import store_reports, suggest_report


@pytest.fixture
def store(store_copy: Path) -> Path:
    store_reports(store_copy, "vanilla", "real", "sim")
    return store_copy


@pytest.fixture(autouse=True)
def stored_predictions(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(LivePredictor, "model", lambda _, store, run: StoredPredictor(store, run))


async def test_enter_shows_an_answer_for_real_images_as_live_adjustment(store):
    async with running(store) as (app, pilot):
        await press(app, pilot, "J", "up", "enter")
        state = app.session.state
        assert state.view == "adjust"
        answer = suggest_report("real").answers[1]
        chains = adjustment_chains(app.session.store, state.adjust)
        expected = [{"name": change.name, "value": change.value} for change in answer.changes]
        assert chains == {"real": expected, "sim": []}
        assert state.adjust.sliders[state.adjust.active].name == "brightness"
        assert state.message == "answer 2: brightness=0.85, vignette=0.37; S saves it as a run"
        assert "0.37" in take_screenshot(app).text
    assert app.fault is None


async def test_enter_copies_the_command_for_the_simulator(store, monkeypatch):
    app = make_app(store)
    copied: list[str] = []
    monkeypatch.setattr(app, "copy_to_clipboard", copied.append)
    async with app.run_test(size=(120, 40)) as pilot:
        await press(app, pilot, "J", "down", "enter")
        assert app.session.state.view == "suggestions"
        (command,) = copied
        assert command.startswith("s2r run add vanilla-height --model vanilla")
        assert "--adjust sim:camera_height=-0.07" in command
        assert command in app.session.state.message


async def test_a_restricted_session_copies_commands_alone(store, monkeypatch):
    app = make_app(store, restricted=True)
    copied: list[str] = []
    monkeypatch.setattr(app, "copy_to_clipboard", copied.append)
    async with app.run_test(size=(120, 40)) as pilot:
        await press(app, pilot, "J", "enter")
        assert "--adjust real:brightness=0.85,vignette=0.37" in copied[0]
        assert app.session.state.adjust is None


async def test_a_run_without_results_has_nothing_to_apply(store):
    async with running(store) as (app, pilot):
        await press(app, pilot, "J", "r", "enter")
        assert app.session.state.message == "there is no answer to apply"
        notes = VIEW.drawing(app.updater.scene, 80).notes
        assert any("--run dataaug --for real" in note for note in notes)


async def test_a_step_without_slider_is_not_applied(store):
    session = Session(store)
    sliders, reason = adjusting.available_sliders(session.store, "vanilla")
    session.dispatch(adjusting.open_sliders, sliders, reason)
    before = session.state.adjust
    chain = [{"name": "brightness", "value": 0.9}, {"name": "translate:gone", "value": 1.0}]
    state = session.dispatch(adjusting.set_chain, "real", chain)
    assert state.adjust == before
    assert state.is_error
    assert "translate:gone" in state.message
    session.close()


async def test_the_finding_leads_to_the_view(store):
    async with running(store) as (app, pilot):
        await press(app, pilot, "I")
        kinds = [finding.kind for finding in app.loaded.findings.findings]
        await press(app, pilot, *["down"] * kinds.index("suggested change"), "enter")
        assert app.session.state.view == "suggestions"

"""Adjustment sliders on runs that already have adjustment chains."""

from dataclasses import replace
from pathlib import Path

import pytest

import s2rstore
from s2rstore.errors import RequestError
from s2rstore.records import Run
from s2rtools.precompute.run_registration import add_run
from s2rtui.session import adjusting, navigation
from s2rtui.session.session import Session

BRIGHT, FLAT = ({"name": name, "value": 0.8} for name in ("brightness", "contrast"))


def with_chain(path: Path, *steps: dict[str, object]) -> Session:
    """A session whose run has these adjustments on its real side."""
    session = Session(path)
    record: Run = session.store.run(session.state.run)
    record.real_adjustments[:] = steps
    session.dispatch(adjusting.open_sliders, *adjusting.available_sliders(session.store))
    return session


@pytest.mark.parametrize(
    ("channels", "missing", "reason"),
    [("rgb", {"depth_range", "depth_blur", "depth_noise", "depth_holes", "depth_steps"},
      "takes no depth"),
     ("depth", {"brightness", "contrast", "temperature", "vignette", "motion_blur",
                "rolling_shutter"}, "takes no colours")],
)  # fmt: skip
def test_sliders_of_images_that_the_model_does_not_take_are_left_out(
    store_copy, channels, missing, reason
):
    session = Session(store_copy)
    store, run = session.store, session.state.run
    every = {slider.name for slider in adjusting.available_sliders(store, run)[0]}
    assert missing < every
    model = store.models[store.run(run).model]
    store.models[model.model] = replace(model, input={"channels": channels})
    sliders, told = adjusting.available_sliders(store, run)
    assert {slider.name for slider in sliders} == every - missing
    assert told.startswith(f"the model {reason}")
    session.dispatch(adjusting.open_sliders, *adjusting.available_sliders(store, run))
    state = session.dispatch(adjusting.follow_run)
    assert {slider.name for slider in state.adjust.sliders} == every - missing


def names_after_move(session: Session, name: str, value: float) -> list[object]:
    adjust = session.state.adjust
    index = [slider.name for slider in adjust.sliders].index(name)
    state = session.dispatch(adjusting.set_slider, index, value)
    assert state.adjust is not None
    return [
        step["name"] for step in adjusting.adjustment_chains(session.store, state.adjust)["real"]
    ]


@pytest.mark.parametrize(
    ("chain", "expected"),
    [
        ((BRIGHT, FLAT), ["brightness", "contrast", "black"]),
        ((FLAT, BRIGHT), ["contrast", "brightness", "black"]),
        ((FLAT,), ["contrast", "black"]),
    ],
)
def test_the_order_of_a_run_s_adjustments_is_preserved(tiny_store, chain, expected):
    session = with_chain(tiny_store, *chain)
    adjust = session.state.adjust
    assert adjust is not None
    assert adjusting.adjustment_chains(session.store, adjust)["real"] == list(chain)
    assert names_after_move(session, "black", 0.5) == expected
    session.close()


def test_a_repeated_adjustment_is_rejected(store_copy):
    session = with_chain(store_copy, BRIGHT, FLAT, BRIGHT)
    assert session.state.adjust is not None
    with pytest.raises(RequestError, match="run vanilla: applies an adjustment twice"):
        adjusting.adjustment_chains(session.store, session.state.adjust)
    session.close()
    chains = {"sim": [], "real": [BRIGHT, FLAT, BRIGHT]}
    with pytest.raises(RequestError, match="--adjust real: brightness twice"):
        add_run(store_copy, "later", "vanilla", None, None, chains)
    with s2rstore.open(store_copy) as store:
        assert "later" not in store.runs


def test_a_missing_package_is_reported_for_every_run(tiny_store):
    session = Session(tiny_store)
    session.dispatch(adjusting.report_missing_package, "torch")
    session.dispatch(navigation.change_run, 1)
    adjust = session.dispatch(adjusting.follow_run).adjust
    assert adjust.run == session.state.run != "vanilla"
    assert "need torch" in adjust.missing
    session.close()

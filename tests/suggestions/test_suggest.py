"""Suggestions for small worlds with one factor and with none, their storage and their command."""

import json
import shlex
from pathlib import Path

import numpy as np
import pytest

import s2rstore
from s2rstore.errors import RequestError
from s2rstore.index.transaction import edit
from s2rstore.suggestions import SuggestReport, from_json, read_report
from s2rtools.suggestions import simulator_match
from s2rtools.suggestions.command import apply_answer, save_report
from s2rtools.suggestions.held_out_split import split_instances
from s2rtools.suggestions.search import Candidate, FactorFit, SearchResult
from s2rtools.suggestions.settings import SuggestSettings, parse_duration, parse_share
from s2rtools.suggestions.simulator_match import SimulatorMatch
from s2rtools.suggestions.sliders import Slider, sliders_of
from s2rtools.suggestions.suggest import _on_whole_frames, suggest
from s2rtui.cli import main
from tests.support.copies import copy_store
from tests.support.silent_reporter import SilentReporter


def searched(path: Path, **more) -> SuggestReport:
    options = {"side": "sim", "budget": 1e6, "frames": 8, "judged": 56, "evaluations": 10,
               "changes": 2, **more}  # fmt: skip
    return suggest(path, "r", SuggestSettings(**options), SilentReporter())


@pytest.fixture(scope="module")
def report(camera_world: Path) -> SuggestReport:
    return searched(camera_world)


def test_a_moved_camera_is_found_with_its_values(report):
    assert report.helps
    assert report.factors[0].factor == "camera"
    best = report.answers[report.best]
    found = {change.name: change for change in best.changes}
    assert set(found) == {"camera_height", "camera_fov"}
    assert found["camera_height"].value == pytest.approx(-0.09, abs=0.02)
    assert found["camera_fov"].value == pytest.approx(found["camera_fov"].truth, abs=1.0)
    assert best.gain.low > 0.5
    assert best.agreement.shift < best.agreement.shift_before


def test_the_front_grows_with_the_number_of_changes(report):
    sizes = [len(answer.changes) for answer in report.answers]
    gains = [answer.fitted for answer in report.answers]
    assert sizes == sorted(set(sizes))
    assert gains == sorted(gains)
    assert all(
        change.interval.low <= change.value <= change.interval.high
        for answer in report.answers
        for change in answer.changes
    )


def test_the_gain_on_the_fit_is_that_of_the_values_shown(camera_world, report):
    with s2rstore.open(camera_world) as store:
        match = SimulatorMatch(store, store.run("r"), *split_instances(store, "r", 8, 16))
        start = match.whole.cost({})
        shown = [
            ({change.name: change.value for change in answer.changes}, answer.fitted)
            for answer in report.answers
        ] + [(each.values, each.fitted) for each in report.factors]
        for values, fitted in shown:
            assert fitted == pytest.approx(1 - match.whole.cost(values) / start, abs=1e-9)


class _Bowl:
    """A match whose whole frames have the minimum at a=0.5, b=0, and a cost of 1 there."""

    def cost(self, values) -> float:
        return 1 + (values.get("a", 0.0) - 0.5) ** 2 + values.get("b", 0.0) ** 2

    def refined(self, values, sliders, has_time):
        return {name: {"a": 0.5, "b": 0.0}[name] for name in values}


def test_candidates_are_compared_by_their_refined_values_on_whole_frames():
    sliders = {name: Slider(name, name, "m", 0.0, -1.0, 1.0, 3) for name in "ab"}
    searched = SearchResult(9.0)
    searched.candidates = {
        1: Candidate({"b": 0.2}, 5.0), 2: Candidate({"a": 0.3, "b": 0.2}, 3.0),
    }  # fmt: skip
    searched.factors = [FactorFit("b", {"b": 0.2}, 5.0), FactorFit("a", {"a": 0.3}, 6.0)]
    whole = _on_whole_frames(_Bowl(), searched, sliders)
    assert whole.start == 1.25
    assert whole.candidates == {1: Candidate({"a": 0.5}, 1.0)}
    assert [(each.factor, each.cost) for each in whole.factors] == [
        ("a", pytest.approx(1.04)), ("b", pytest.approx(1.29)),
    ]  # fmt: skip


@pytest.mark.parametrize(("side", "reason"), [("sim", "do not differ"), ("real", "no gap")])
def test_nothing_helps_in_a_world_without_factors(null_world, side, reason):
    report = searched(null_world, side=side)
    assert not report.helps
    assert report.answers == ()
    assert reason in report.reason


def test_a_price_that_no_change_gains_leaves_nothing(camera_world):
    report = searched(camera_world, price=0.99, changes=1, evaluations=10)
    assert not report.helps
    assert "price" in report.reason


def test_a_report_survives_its_json(report):
    text = json.dumps(report.as_json(), allow_nan=False)
    assert from_json(json.loads(text)).as_json() == report.as_json()


def test_a_stored_report_is_read_until_the_run_changes(camera_world, report, tmp_path):
    path = copy_store(camera_world, tmp_path / "own.s2r")
    save_report(path, report)
    with s2rstore.open(path) as store:
        read = read_report(store, "r", "sim")
        assert read.as_json() == report.as_json()
        assert read_report(store, "r", "real") is None
    with edit(path) as draft:
        draft.update("run", {"run": "r"}, {"key": "another"})
    with s2rstore.open(path) as store:
        assert read_report(store, "r", "sim") is None


def test_the_printed_command_and_apply_register_the_same_run(
    camera_world, report, tmp_path, capsys
):
    path = copy_store(camera_world, tmp_path / "own.s2r")
    with s2rstore.open(path) as store:
        command = report.answers[-1].command(str(path), store.run("r"), "sim", "typed")
    assert main(shlex.split(command)[1:]) == 0
    assert apply_answer(path, report, len(report.answers), "applied") == "applied"
    with s2rstore.open(path) as store:
        typed, applied = store.run("typed"), store.run("applied")
        assert typed.sim_adjustments == applied.sim_adjustments
        assert typed.real_adjustments == applied.real_adjustments == []
    with pytest.raises(RequestError, match=r"--apply 9: no answer of that number"):
        apply_answer(path, report, 9, "more")


def test_the_command_prints_stores_draws_and_applies(null_world, tmp_path, s2r):
    path, figure = copy_store(null_world, tmp_path / "own.s2r"), tmp_path / "front.png"
    arguments = ["suggest", str(path), "--for", "sim", "--frames", "8"]
    assert "nothing helps" in s2r(*arguments, "--figure", figure).checked(3).out
    assert figure.stat().st_size > 1000
    assert json.loads(s2r(*arguments, "--json", "--no-keep").checked(3).out)["helps"] is False
    s2r(*arguments, "--apply", "1", "--name", "x").assert_refused(
        "--frames: --apply takes the stored result of run r"
    )
    s2r("suggest", path, "--for", "sim", "--apply", "1", "--name", "x").assert_refused(
        "it has no answer"
    )
    kinds = [each["kind"] for each in s2r("findings", path, "--json").json["findings"]]
    assert "suggested change" in kinds


def test_the_finding_states_the_answer(camera_world, report, tmp_path, s2r):
    path = copy_store(camera_world, tmp_path / "own.s2r")
    save_report(path, report)
    findings = {each["kind"]: each for each in s2r("findings", path, "--json").json["findings"]}
    found = findings["suggested change"]
    assert found["evident"]
    assert "camera_height" in found["text"]
    assert f"--apply {report.best + 1}" in found["evidence"]
    with edit(path) as draft:
        broken = {**report.as_json(), "answers": []}
        draft.set_provenance("suggestion:r", {"sim": broken})
    assert any("suggest" in line for line in s2r("findings", path, "--json").json["missing"])


def test_sliders_start_at_the_values_of_the_run(camera_world):
    with s2rstore.open(camera_world) as store:
        run = store.run("r")
        real = {slider.name for slider in sliders_of(store, run, "real")}
        sim = {slider.name: slider for slider in sliders_of(store, run, "sim")}
    assert not {"camera_height", "black", "depth_noise"} & real
    assert {"camera_height", "lamp_power", "depth_noise", "brightness"} <= set(sim)
    for slider in sim.values():
        assert slider.base not in slider.screening()
        assert slider.value(slider.position(slider.base)) == pytest.approx(slider.base, abs=1e-2)
        positions = np.linspace(0, 1, 7)
        values = [slider.value(position) for position in positions]
        assert values == sorted(values)
        assert (values[0], values[-1]) == (slider.low, slider.high)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["--budget", "soon"], "--budget soon: a time such as 90s, 5m or 1h"),
        (["--price", "much"], "--price much: a share such as 2%"),
        (["--changes", "9"], "--changes 9: 1 .. 6"),
        (["--name", "x"], "--name: names the run of --apply"),
        (["--apply", "1", "--name", "a/b"], "a/b"),
        (["--apply", "1", "--name", "dataaug"], "already in"),
        (["--figure", "front.txt"], "--figure front.txt: must end in .png, .svg, .pdf"),
        (["--run", "nobody"], "nobody"),
    ],
)
def test_invalid_options_name_the_argument(tiny_store, options, message, s2r):
    s2r("suggest", tiny_store, "--no-keep", *options).assert_refused(message)


def test_times_and_shares_are_parsed():
    assert [parse_duration(text) for text in ("90s", "5m", "1.5h")] == [90.0, 300.0, 5400.0]
    assert [parse_share(text) for text in ("2%", "0.02", "0")] == [0.02, 0.02, 0.0]


class _Clock:
    """A clock that only moves when images are compared, by a second for each 8 images."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.seconds = 0.0
        compare = simulator_match._Pairs.residuals

        def residuals(pairs, chain):
            made = compare(pairs, chain)
            self.seconds += len(made) / 8
            return made

        monkeypatch.setattr(simulator_match._Pairs, "residuals", residuals)

    def __call__(self) -> float:
        return self.seconds


@pytest.mark.parametrize("budget", [80.0, 120.0])
def test_the_budget_is_kept(camera_world, monkeypatch, budget):
    clock = _Clock(monkeypatch)
    settings = SuggestSettings("sim", budget=budget, frames=8, judged=16, changes=2)
    report = suggest(camera_world, "r", settings, SilentReporter(), clock)
    assert 0.4 * budget < clock() <= budget
    assert not report.complete
    assert report.answers

"""Search and judge changes of a run: adapt real images, or tune the simulator."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

import s2rstore
from s2rstore.errors import RequestError, counted
from s2rstore.geometry import camera_offset
from s2rstore.geometry.camera_offset import hfov
from s2rstore.intervals import Interval
from s2rstore.reader import Store
from s2rstore.records import Run
from s2rstore.run_inputs import run_render_change
from s2rstore.suggestions import Agreement, Answer, Change, FactorGain, SuggestReport
from s2rtools.common.command_line.progress import Reporter
from s2rtools.precompute.pose_predictor import PosePredictor
from s2rtools.suggestions.held_out_split import SplitPart, split_instances
from s2rtools.suggestions.objective import (
    Floats,
    Objective,
    PoseErrors,
    Values,
)
from s2rtools.suggestions.robust_fit import RobustFit
from s2rtools.suggestions.search import (
    Candidate,
    FactorFit,
    Search,
    SearchResult,
    pareto_front,
    preferred,
)
from s2rtools.suggestions.settings import SuggestSettings, TimeBudget
from s2rtools.suggestions.simulator_match import SimulatorMatch
from s2rtools.suggestions.sliders import Slider, changed_chain, sliders_of
from s2rtools.synthetic_world.dataset import WorldData

_LEAST_SEARCH = 0.4
"""Share of the wall time that is left to the search where the judgement takes long."""
_EVALUATION, _JUDGED, _WHOLE = "evaluation", "judged", "whole frames"
"""Steps of a search that are timed."""
_JUDGED_SIM = 96
"""Most instances on which a simulator is judged, whose frames have to be rendered."""
_LEAST_MISMATCH = 1e-6
NO_GAP = "the real error does not evidently exceed the sim error, so there is no gap to close"
NO_MISMATCH = "the sim images do not differ from the real ones"
NO_SLIDER = "no adjustment can be changed on this side"
NO_PRICE = "no change gains its price on the instances of the fit"
NOT_EVIDENT = "no change that gains its price has an interval above zero on held-out instances"


def suggest(
    root: Path, run: str | None, settings: SuggestSettings, reporter: Reporter,
    clock: Callable[[], float] = time.monotonic,
) -> SuggestReport:  # fmt: skip
    """Search the changes of a run that help, and judge them on held-out instances.

    Raises RequestError for a run that is not computed, imported, or unknown, InconclusiveError
    where its new instances are too few.
    """
    budget = TimeBudget(settings.budget, clock)
    with s2rstore.open(root) as store:
        store.require_poses("suggest")
        record = store.run(run)
        record.network("suggestions")
        if record.key is None:
            raise RequestError(f"{root}: run {record.run} is not computed; run `s2r precompute`")
        most = settings.judged if settings.side == "real" else min(settings.judged, _JUDGED_SIM)
        fit, judge = split_instances(store, record.run, settings.frames, most)
        sliders = sliders_of(store, record, settings.side)
        return _Judgement(store, record, settings, fit, judge, budget).report(sliders, reporter)


class _Judgement:
    """The search of one run, and what it is judged on."""

    def __init__(
        self, store: Store, run: Run, settings: SuggestSettings, fit: SplitPart, judge: SplitPart,
        budget: TimeBudget,
    ) -> None:  # fmt: skip
        self._store, self._run, self._settings = store, run, settings
        self._fit, self._judge, self._budget = fit, judge, budget
        self._predictor = PosePredictor(store, run, "suggestions", settings.trust)
        self._match: SimulatorMatch | None = None
        if settings.side == "sim":
            self._match = SimulatorMatch(store, run, fit, judge)
            self._objective: Objective = self._match
        else:
            self._objective = PoseErrors(store, run, "real", self._predictor, fit, judge)

    def report(self, sliders: Sequence[Slider], reporter: Reporter) -> SuggestReport:
        """Search, judge the front, and choose the answer."""
        settings, judged = self._settings, self._judged({})
        columns = self._store.run_columns(self._run.run)
        gap = self._judge.mean(columns.gap[self._judge.iids].astype(np.float64))
        reason = self._nothing_to_do(sliders, judged, gap)
        searched = SearchResult(float(judged.mean()))
        if not reason:
            searched = self._search(sliders, reporter)
        by_name = {slider.name: slider for slider in sliders}
        fits = searched
        if self._match is not None:
            fits = _on_whole_frames(
                self._match.whole, searched, by_name, self._has_time_on_whole_frames
            )
        front = pareto_front(fits.candidates.values(), fits.start)
        order = _order(fits)
        truth = true_values(self._store, self._run) if settings.side == "sim" else {}
        reporter.begin("judge", len(front) + len(fits.factors))
        best_first = _preferred_first(front, fits.start, settings.price)
        made: dict[int, Answer] = {}
        for place in best_first:
            if made and not self._budget.fits(_JUDGED):
                break
            made[place] = self._answer(front[place], len(front), by_name, order, truth, judged,
                                       fits.start)  # fmt: skip
            reporter.advance(1)
        front = [front[place] for place in sorted(made)]
        answers = [made[place] for place in sorted(made)]
        factors = []
        for fitted in fits.factors:
            if not self._budget.fits(_JUDGED):
                break
            gain = self._judged_gain(judged, self._judged(fitted.values), len(fits.factors))
            share = self._gain(fits.start - fitted.cost, fits.start)
            factors.append(FactorGain(fitted.factor, fitted.values, share, gain))
            reporter.advance(1)
        is_judged = len(made) == len(best_first)
        searched = replace(searched, complete=searched.complete and is_judged)
        best, why = self._choice(front, answers, fits.start)
        if best is None and not searched.complete:
            evaluations = counted(searched.evaluations, "evaluation")
            why = f"the time was used up after {evaluations}; give a larger --budget"
        return SuggestReport(
            run=self._run.run, side=settings.side, key=str(self._run.key), price=settings.price,
            seed=settings.seed, before=float(judged.mean()), gap=gap,
            fitted_instances=int(self._fit.iids.size),
            judged_instances=int(self._judge.iids.size), evaluations=searched.evaluations,
            complete=searched.complete, answers=tuple(answers), best=best, reason=reason or why,
            screening=tuple(
                (each.slider.name, each.value, self._gain(searched.start - each.cost,
                                                          searched.start))
                for each in searched.screening
            ),
            factors=tuple(factors), truth=truth,
        )  # fmt: skip

    def _search(self, sliders: Sequence[Slider], reporter: Reporter) -> SearchResult:
        """Search in the time that the judgement leaves."""
        settings, budget = self._settings, self._budget
        planned = _planned(sliders, settings)
        reporter.begin("search", planned)
        reserve = self._judgement_seconds(sliders)

        def costs(values: Values) -> Floats:
            with budget.step(_EVALUATION):
                return self._objective.fitted(values)

        return Search(
            costs, sliders, settings.price, settings.changes, settings.evaluations, settings.seed,
            lambda: budget.fits(_EVALUATION, reserve), _at_most(planned, reporter.advance),
        ).run()  # fmt: skip

    def _judgement_seconds(self, sliders: Sequence[Slider]) -> float:
        """About how long the judgement takes, by what its steps took once."""
        factors = len({slider.factor for slider in sliders})
        answers = min(self._settings.changes, len(sliders))
        judged = self._budget.seconds(_JUDGED)
        seconds = (answers + factors) * judged
        if self._match is not None:
            moving = next((slider for slider in sliders if slider.moves_camera), None)
            changed = {} if moving is None else {moving.name: moving.screening()[0]}
            for values in ({}, changed):
                with self._budget.step(_WHOLE):
                    self._match.whole.cost(values)
            whole = self._budget.seconds(_WHOLE)
            judged = max(judged, whole * self._judge.iids.size / self._fit.iids.size)
            # The cost of each candidate, and central differences for its intervals.
            seconds = (factors + answers * (answers + 3)) * whole
            # The judged images of an answer are made twice more, for its predictions.
            seconds += (3 * answers + factors) * judged
        return min(seconds, (1 - _LEAST_SEARCH) * self._settings.budget)

    def _has_time_on_whole_frames(self, costs: int) -> bool:
        """Whether the budget allows some more evaluations on whole frames before the judgement."""
        needed = (costs - 1) * self._budget.seconds(_WHOLE)
        needed += self._settings.changes * self._budget.seconds(_JUDGED)
        return self._budget.fits(_WHOLE, needed)

    def _judged(self, values: Values) -> Floats:
        with self._budget.step(_JUDGED):
            return self._objective.judged(values)

    def _nothing_to_do(self, sliders: Sequence[Slider], judged: Floats, gap: Interval) -> str:
        if not sliders:
            return NO_SLIDER
        if self._settings.side == "real":
            return "" if gap.is_positive else NO_GAP
        return "" if judged.mean() > _LEAST_MISMATCH else NO_MISMATCH

    def _answer(
        self, candidate: Candidate, compared: int, sliders: dict[str, Slider],
        order: dict[str, int], truth: dict[str, float], judged: Floats, start: float,
    ) -> Answer:  # fmt: skip
        """A candidate with its gain on the held-out instances."""
        names = sorted(candidate.values, key=lambda name: order[name])
        values = candidate.values
        gain = self._judged_gain(judged, self._judged(values), compared)
        chain = changed_chain(self._store, self._run, self._settings.side, values)
        intervals: dict[str, Interval] = {}
        agreement = None
        if self._match is not None:
            chosen = [sliders[name] for name in names]
            intervals = self._match.whole.intervals(values, chosen)
            agreement = self._agreement(chain)
        changes = tuple(
            Change(name, sliders[name].factor, sliders[name].unit, sliders[name].base,
                   values[name], intervals.get(name), truth.get(name))
            for name in names
        )  # fmt: skip
        fitted = self._gain(start - candidate.cost, start)
        return Answer(changes, fitted, gain, tuple(chain), agreement)

    def _judged_gain(self, before: Floats, after: Floats, compared: int) -> Interval:
        """The gain on the held-out instances: mean decrease, or its share of the mismatch."""
        if self._settings.side == "real":
            return self._judge.mean(before - after, compared)
        return self._judge.share_of_decrease(before, after, compared)

    def _gain(self, decrease: float, start: float) -> float:
        """A decrease of the cost in the unit of the report."""
        return decrease if self._settings.side == "real" else decrease / max(start, 1e-12)

    def _choice(
        self, front: Sequence[Candidate], answers: Sequence[Answer], start: float
    ) -> tuple[int | None, str]:
        """The evident answer with the largest net gain on the fit, else why there is none."""
        if preferred(front, start, self._settings.price) is None:
            return None, NO_PRICE
        evident = [place for place, answer in enumerate(answers) if answer.evident]
        chosen = preferred([front[place] for place in evident], start, self._settings.price)
        return (None, NOT_EVIDENT) if chosen is None else (evident[chosen], "")

    def _agreement(self, chain: Sequence[dict[str, object]]) -> Agreement:
        """How the predictions from the changed sim images agree with the real ones."""
        assert self._match is not None
        images, iids = self._match.sim_images, self._judge.iids
        columns = self._store.run_columns(self._run.run)
        real = np.stack([columns.real.x[iids], columns.real.y[iids]], axis=1).astype(np.float64)
        real_error = columns.real.error[iids].astype(np.float64)
        shifts, errors = [], []
        for each in (self._run.sim_adjustments, chain):
            inputs = images.inputs(each, self._predictor.contract)
            poses = self._predictor.poses(inputs)[:, :2]
            shifts.append(np.hypot(*(poses - real).T))
            errors.append(np.hypot(*(poses - images.truth[:, :2]).T))
        return Agreement(
            float(errors[0].mean()), float(errors[1].mean()), float(real_error.mean()),
            float(shifts[0].mean()), float(shifts[1].mean()),
            self._judge.mean(shifts[0] - shifts[1]),
            _correlation(errors[0], real_error), _correlation(errors[1], real_error),
        )  # fmt: skip


def _on_whole_frames(
    match: RobustFit, searched: SearchResult, sliders: dict[str, Slider],
    has_time: Callable[[int], bool] = lambda costs: True,
) -> SearchResult:  # fmt: skip
    """The result of a search with refined candidates and all costs on whole frames of the fit.

    A refined value that is the one of the run is no change. Candidates are refined while there is
    time for it: `has_time` tells whether there is for a number of costs on whole frames.
    """
    factors = [
        FactorFit(each.factor, each.values, match.cost(each.values)) for each in searched.factors
    ]
    candidates: dict[int, Candidate] = {}
    for found in pareto_front(searched.candidates.values(), searched.start):
        values = match.refined(found.values, [sliders[name] for name in found.values], has_time)
        values = {name: value for name, value in values.items() if value != sliders[name].base}
        made = Candidate(values, match.cost(values))
        known = candidates.get(made.changes)
        if values and (known is None or made.cost < known.cost):
            candidates[made.changes] = made
    factors.sort(key=lambda fitted: fitted.cost)
    start = match.cost({})
    return replace(searched, start=start, factors=factors, candidates=candidates)


def _preferred_first(front: Sequence[Candidate], start: float, price: float) -> list[int]:
    """The places of the front, that of the preferred candidate first."""
    best = preferred(front, start, price)
    places = list(range(len(front)))
    return places if best is None else [best, *(place for place in places if place != best)]


def _order(searched: SearchResult) -> dict[str, int]:
    """The place of each slider among the changes of an answer: by factor, then alone."""
    factors = [each.factor for each in searched.factors]
    ranked = sorted(
        searched.screening,
        key=lambda each: (
            factors.index(each.slider.factor) if each.slider.factor in factors else len(factors)
        ),
    )
    return {each.slider.name: place for place, each in enumerate(ranked)}


def _correlation(first: Floats, second: Floats) -> float:
    if first.size < 2 or not (first.std() > 0 and second.std() > 0):
        return float("nan")
    return float(np.corrcoef(first, second)[0, 1])


def _at_most(total: int, advance: Callable[[int], None]) -> Callable[[int], None]:
    """Report steps up to `total`, because a search may make more evaluations than planned."""
    left = total

    def report(steps: int) -> None:
        nonlocal left
        advance(min(steps, left))
        left -= min(steps, left)

    return report


def _planned(sliders: Sequence[Slider], settings: SuggestSettings) -> int:
    """About how many evaluations a search makes."""
    joint = 2 * max(0, min(settings.changes, len(sliders)) - 1)
    return 10 * len(sliders) + joint * (settings.evaluations + 20)


def true_values(store: Store, run: Run) -> dict[str, float]:
    """True differences of the real camera from the declared sim camera, by adjustment.

    Metres, degrees and degrees; adjustments of the run's real camera included. Empty where the
    data was not generated.
    """
    data = WorldData.of_store(store)
    if data is None:
        return {}
    move = run_render_change(store, run, "real")
    sim = data.camera("sim")
    real = data.camera("real").moved(move.height, move.pitch, move.zoom)
    width = data.recipe.frame
    return {
        camera_offset.HEIGHT: round(real.height - sim.height, 6),
        camera_offset.PITCH: round(math.degrees(real.lens.pitch - sim.lens.pitch), 6),
        camera_offset.FOV: round(hfov(real.lens, width) - hfov(sim.lens, width), 6),
    }

"""Search of the changes that lower the mean cost of the fit, for each number of changes.

Every slider is screened alone, and the sliders of each factor are fitted one after another. Those
of the best factor are then fitted together, because sliders may make up for one another, as the
height and the pitch of a camera do, so that each alone seems useless. From the best single change,
the slider that helps most beside the present ones is added and CMA-ES fits all values together, up
to one more than the largest number of changes. From both sets the change that costs least is
removed again and again, so that a change which others replace does not stay. The best set of each
number is a candidate.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field

import numpy as np
from scipy.optimize import minimize_scalar

from s2rtools.suggestions.objective import Floats, Values
from s2rtools.suggestions.sliders import TRANSLATOR, Slider

MOST_SCREENED = 6
"""Sliders of the screening that joint searches take."""
_REFINED, _REFINED_BASE = 7, 4
"""Evaluations by which the best screened value is refined; fewer where it is that of the run."""
_LEAST_ALONE = 0.25
"""Share of the price that a factor must gain alone, or joint searches leave out its sliders."""
_SPREAD = 0.05
"""First deviation of CMA-ES, as a share of a slider's range."""
_LEAST_GAIN = 0.1
"""Share of the price that one more change must gain, or the search of larger sets ends."""

Costs = Callable[[Values], Floats]
Advance = Callable[[int], None]


@dataclass(frozen=True, slots=True)
class Screened:
    """The best value of one slider alone, and its mean cost on the fit."""

    slider: Slider
    value: float
    cost: float


@dataclass(frozen=True, slots=True)
class Candidate:
    """Changed values by slider, none of them that of the run, and their mean cost on the fit."""

    values: dict[str, float]
    cost: float

    @property
    def changes(self) -> int:
        return len(self.values)


@dataclass(frozen=True, slots=True)
class FactorFit:
    """All useful sliders of one factor fitted together, and their mean cost on the fit."""

    factor: str
    values: dict[str, float]
    cost: float


@dataclass(slots=True)
class SearchResult:
    """Mean cost without changes, screening and factors (best first), and candidates by size."""

    start: float
    screening: list[Screened] = field(default_factory=list)
    factors: list[FactorFit] = field(default_factory=list)
    candidates: dict[int, Candidate] = field(default_factory=dict)
    evaluations: int = 0
    complete: bool = True


class _OutOfTimeError(Exception):
    """The wall time of the search is used up."""


class Search:
    """Search the values of `sliders` that cost least; `costs` maps values to costs (n,).

    `price` is the share of the first cost that a change must gain, `evaluations` the limit of each
    joint search. `has_time` tells whether there is time for another evaluation.
    """

    def __init__(
        self, costs: Costs, sliders: Sequence[Slider], price: float, most_changes: int,
        evaluations: int, seed: int, has_time: Callable[[], bool] = lambda: True,
        advance: Advance = lambda steps: None,
    ) -> None:  # fmt: skip
        self._costs, self._sliders = costs, {slider.name: slider for slider in sliders}
        self._price, self._most, self._evaluations = price, most_changes, evaluations
        self._seed, self._has_time, self._advance = seed, has_time, advance
        self._known: dict[tuple[tuple[str, float], ...], float] = {}
        self._result = SearchResult(self._cost({}))

    def run(self) -> SearchResult:
        """Search until every size is done or the time is used up."""
        result = self._result
        try:
            if result.start > 0:
                self._screen()
                self._fit_factors()
                self._shrink(self._fit_best_factor())
                self._shrink(self._grow())
        except _OutOfTimeError:
            result.complete = False
        result.screening.sort(key=lambda screened: screened.cost)
        result.factors.sort(key=lambda fitted: fitted.cost)
        result.evaluations = len(self._known)
        return result

    def _cost(self, values: Values) -> float:
        """Mean cost of values, of which those of the run count as no change."""
        changed = self._changed(values)
        key = tuple(sorted(changed.items()))
        if key not in self._known:
            if self._known and not self._has_time():
                raise _OutOfTimeError
            self._known[key] = float(self._costs(changed).mean())
            self._advance(1)
        return self._known[key]

    def _note(self, values: Values) -> None:
        """Keep a set of values as candidate of its size if it is the best."""
        changed = self._changed(values)
        size = len(changed)
        if 0 < size <= self._most:
            made = Candidate(changed, self._cost(changed))
            known = self._result.candidates.get(size)
            if known is None or made.cost < known.cost:
                self._result.candidates[size] = made

    def _screen(self) -> None:
        for slider in self._sliders.values():
            value, cost = self._best_value(slider, {})
            self._result.screening.append(Screened(slider, value, cost))
            self._note({slider.name: value})

    def _fit_factors(self) -> None:
        """Fit the sliders of each factor one after another, beside those fitted before."""
        for factor in dict.fromkeys(slider.factor for slider in self._sliders.values()):
            own = [each for each in self._result.screening if each.slider.factor == factor]
            own = sorted((each for each in own if each.cost < self._result.start),
                         key=lambda each: each.cost)  # fmt: skip
            values: dict[str, float] = {}
            for each in own[: 1 if factor == TRANSLATOR else None]:
                value, _ = self._best_value(each.slider, values)
                if value != each.slider.base:
                    values[each.slider.name] = value
            if values:
                self._result.factors.append(FactorFit(factor, values, self._cost(values)))

    def _fit_best_factor(self) -> dict[str, float]:
        """Fit all sliders of the factor that gains most together; return their values."""
        best = min(self._result.factors, key=lambda fitted: fitted.cost, default=None)
        if best is None or best.factor == TRANSLATOR:
            return {}
        own = [slider for slider in self._sliders.values() if slider.factor == best.factor]
        values = {slider.name: best.values.get(slider.name, slider.base) for slider in own}
        values = self._changed(self._fit_together(values))
        self._result.factors.remove(best)
        self._result.factors.append(FactorFit(best.factor, values, self._cost(values)))
        self._note(values)
        return values

    def _changed(self, values: Values) -> dict[str, float]:
        """The values that are not those of the run."""
        return {name: value for name, value in values.items() if value != self._sliders[name].base}

    def _best_value(
        self, slider: Slider, beside: Values, refine: bool = True
    ) -> tuple[float, float]:
        """The best value of a slider beside others, and the mean cost."""

        def cost(value: float) -> float:
            return self._cost({**beside, slider.name: value})

        tried = {value: cost(value) for value in slider.screening()}
        tried[slider.base] = self._cost(beside)
        values = sorted(tried)
        best = values.index(min(values, key=lambda value: tried[value]))
        low = values[best - 1] if best else slider.low
        high = values[best + 1] if best + 1 < len(values) else slider.high
        if refine and high > low:
            positions = slider.position(low), slider.position(high)
            steps = _REFINED_BASE if values[best] == slider.base else _REFINED

            def cost_at(position: float) -> float:
                value = slider.value(float(position))
                tried[value] = cost(value)
                return tried[value]

            minimize_scalar(
                cost_at, bounds=positions, method="bounded",
                options={"maxiter": steps, "xatol": 1e-3},
            )  # fmt: skip
        chosen = min(tried, key=lambda value: (tried[value], abs(value - slider.base)))
        return chosen, tried[chosen]

    def _grow(self) -> dict[str, float]:
        """Add changes one by one, from the best single one; return the largest set."""
        start, ranked = self._result.start, sorted(self._result.screening, key=lambda s: s.cost)
        needed = start * (1 - _LEAST_ALONE * self._price)
        factors = {each.factor for each in self._result.factors if each.cost < needed}
        useful = [each for each in ranked if each.slider.factor in factors][:MOST_SCREENED]
        if not useful or useful[0].value == useful[0].slider.base:
            return {}
        present = {useful[0].slider.name: useful[0].value}
        reached = useful[0].cost
        for _ in range(self._most):
            options = []
            for each in useful:
                if not self._fits(each.slider, present):
                    continue
                value, cost = self._best_value(each.slider, present, refine=False)
                if value != each.slider.base:
                    options.append((cost, {**present, each.slider.name: value}))
            if not options:
                break
            _, widened = min(options, key=lambda option: option[0])
            widened = self._fit_together(widened)
            self._note(widened)
            gain = reached - self._cost(widened)
            present, reached = widened, self._cost(widened)
            if gain < _LEAST_GAIN * self._price * start:
                break
        return present

    def _fits(self, slider: Slider, present: Values) -> bool:
        """Whether a slider can join: each one once, and one translator at most."""
        if slider.name in present:
            return False
        chosen = [self._sliders[name].factor for name in present]
        return slider.factor != TRANSLATOR or TRANSLATOR not in chosen

    def _shrink(self, present: dict[str, float]) -> None:
        """Remove changes one by one from a set."""
        while len(present) > 1:
            without = [
                {other: value for other, value in present.items() if other != name}
                for name in present
            ]
            kept = min(without, key=self._cost)
            present = self._fit_together(kept)
            self._note(present)

    def _fit_together(self, values: Values) -> dict[str, float]:
        """Fit several values together by CMA-ES; a single one by a bounded search."""
        sliders = [self._sliders[name] for name in values]
        if len(sliders) == 1:
            value, _ = self._best_value(sliders[0], {})
            return {sliders[0].name: value}
        import cma

        rng = np.random.default_rng((self._seed, len(self._known)))
        start = [slider.position(values[slider.name]) for slider in sliders]
        options = {
            "bounds": [0.0, 1.0], "maxfevals": self._evaluations, "verbose": -10, "verb_log": 0,
            "tolx": 5e-4, "tolfun": 1e-5 * self._result.start,
            "tolfunhist": 1e-5 * self._result.start,
            "seed": np.nan, "randn": lambda *shape: rng.standard_normal(shape),
        }  # fmt: skip
        strategy = cma.CMAEvolutionStrategy(start, _SPREAD, options)
        best = dict(values)
        while not strategy.stop():
            points = strategy.ask()
            made = [_values(sliders, point) for point in points]
            costs = [self._cost(each) for each in made]
            strategy.tell(points, costs)
            lowest = made[int(np.argmin(costs))]
            if self._cost(lowest) < self._cost(best):
                best = lowest
        return best


def _values(sliders: Sequence[Slider], point: Floats) -> dict[str, float]:
    return {
        slider.name: slider.value(float(position))
        for slider, position in zip(sliders, point, strict=True)
    }


def pareto_front(candidates: Iterable[Candidate], start: float) -> list[Candidate]:
    """Non-dominated candidates that cost less than `start`, by number of changes, ascending."""
    front: list[Candidate] = []
    for candidate in sorted(candidates, key=lambda each: (each.changes, each.cost)):
        if candidate.cost < (front[-1].cost if front else start):
            front.append(candidate)
    return front


def net_gain(candidate: Candidate, start: float, price: float) -> float:
    """Decrease of the cost minus `price` times `start` for each change."""
    return start - candidate.cost - price * start * candidate.changes


def preferred(front: Sequence[Candidate], start: float, price: float) -> int | None:
    """The place of the candidate with the largest net gain; None where none pays its price."""
    gains = [net_gain(candidate, start, price) for candidate in front]
    best = max(range(len(front)), key=lambda place: gains[place], default=None)
    return best if best is not None and gains[best] > 0 else None

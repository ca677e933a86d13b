"""Identify the parameters of a simulator from recorded drives, with intervals and diagnostics.

The search is CMA-ES from several seeds, each refined by least squares of SciPy.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

import numpy as np

from s2rstore.errors import InconclusiveError, RequestError
from s2rstore.intervals import LEVEL
from s2rtools.motion_logs import Drive
from s2rtools.sysid.identifiability import (
    Identifiability,
    Structure,
    at_range_limits,
    identifiability,
    normal_equations,
    parameter_bounds,
    range_warning,
    structure,
)
from s2rtools.sysid.parameter_space import Range, Space, check, space_of, with_ranges
from s2rtools.sysid.prediction_error import HeldOut, PredictionError, held_out_error
from s2rtools.sysid.simulators import SIMULATORS
from s2rtools.sysid.simulators.simulator import Floats, Integers, Simulator
from s2rtools.sysid.windows import cut_windows

if TYPE_CHECKING:
    from s2rtools.common.command_line.progress import Reporter


Advance = Callable[[int], None]
"""Receives the number of new evaluations; the sum is the permitted number."""
_SPREAD = 0.25
"""Standard deviation of the first points of CMA-ES, in the unit cube."""
_MAX_SECONDS = 40.0
"""Seconds of driving that the search of one seed uses; the refinement uses all."""
_WEIGHT_ROUNDS = 2
"""Rounds of estimating the noise of positions and headings from the residuals."""
MIN_FITTED = 4
"""Fewest fitted drives, for the intervals over drives."""


@dataclass(frozen=True, slots=True)
class SearchTrace:
    """Search of one seed: best `costs` (k,) after `evaluations` (k,) on the windows of the search,
    and the `cost` of its refined end on all windows.
    """

    seed: int
    evaluations: Floats
    costs: Floats
    cost: float


def search(problem: PredictionError, seeds: int, first_seed: int, evaluations: int,
           advance: Advance) -> tuple[PredictionError, Floats, list[SearchTrace]]:  # fmt: skip
    """Search with at most `evaluations` per seed; `advance` receives those of each generation.

    Returns the problem with the best start states and weights, the optimum (p,), and the traces.
    """
    ends, traces = [], []
    for number in range(seeds):
        rng = np.random.default_rng((first_seed, number))
        start = problem.space.start()
        if number:
            start = rng.uniform(0.2, 0.8, len(start))
        part = problem.of(problem.windows.only(_random_windows(problem, rng)))
        counts, costs, end = _minimize(part.cost, start, rng, evaluations, advance)
        refined, cube = problem.refined(end)
        ends.append((refined, cube))
        traces.append(SearchTrace(number, counts, costs, refined.cost(cube)))
    problem, cube = ends[int(np.argmin([trace.cost for trace in traces]))]
    for _ in range(_WEIGHT_ROUNDS):
        problem, cube = replace(problem, sigma=_residual_noise(problem, cube)).refined(cube)
    return problem, cube, traces


def _random_windows(problem: PredictionError, rng: np.random.Generator) -> Integers:
    """Windows of together `_MAX_SECONDS` seconds, drawn without replacement."""
    count = len(problem.windows)
    size = max(1, int(count * min(1.0, _MAX_SECONDS / problem.windows.seconds())))
    return np.sort(rng.permutation(count)[:size])


def _residual_noise(problem: PredictionError, cube: Floats) -> Floats:
    """Standard deviation of the residuals of positions (x and y pooled) and headings."""
    rms = np.sqrt((problem.residuals(cube) ** 2).mean(axis=0)) * problem.sigma
    place = float(np.hypot(rms[0], rms[1]) / np.sqrt(2.0))
    return np.maximum([place, place, rms[2]], 1e-6)


def _minimize(
    cost: Callable[[Floats], float], start: Floats, rng: np.random.Generator, evaluations: int,
    advance: Advance,
) -> tuple[Floats, Floats, Floats]:  # fmt: skip
    """CMA-ES: evaluations and best costs after each generation, and the best point (p,)."""
    import cma

    options = {
        "bounds": [0.0, 1.0], "maxfevals": evaluations, "verbose": -10, "verb_log": 0,
        "tolx": 1e-4, "tolfun": 1e-4, "tolfunhist": 1e-4,
        "seed": np.nan, "randn": lambda *shape: rng.standard_normal(shape),
    }  # fmt: skip
    strategy = cma.CMAEvolutionStrategy(start, _SPREAD, options)
    counts, costs = [], []
    done = 0
    while not strategy.stop():
        points = strategy.ask()
        strategy.tell(points, [np.log(cost(np.asarray(point))) for point in points])
        counts.append(float(strategy.result.evaluations))
        costs.append(float(np.exp(strategy.result.fbest)))
        step = min(len(points), evaluations - done)
        if step > 0:
            advance(step)
        done += step
    if done < evaluations:
        advance(evaluations - done)
    return np.array(counts), np.array(costs), np.clip(strategy.result.xbest, 0.0, 1.0)


@dataclass(frozen=True, slots=True)
class SysidSettings:
    """Settings of an identification, with limits.

    `parameters` None: those searched by default. `held_out` is a number of drives, None: a quarter,
    at least one. `evaluations` per seed, None: the simulator's default. `window` in s. `ranges`
    replace those that the simulator declares.
    """

    simulator: str = "planar"
    parameters: tuple[str, ...] | None = None
    fixed: Mapping[str, float] = field(default_factory=dict)
    seeds: int = 3
    held_out: int | None = None
    window: float = 3.0
    evaluations: int | None = None
    seed: int = 1
    ranges: Mapping[str, Range] = field(default_factory=dict)

    def __post_init__(self) -> None:
        held_out, evaluations = self.held_out, self.evaluations
        for valid, message in (
            (1 <= self.seeds <= 100, "--seeds: 1 .. 100"),
            (held_out is None or held_out >= 1, "--held-out: at least 1"),
            (0.2 <= self.window <= 600, "--window: 0.2 .. 600 s"),
            (evaluations is None or 10 <= evaluations <= 10**6, "--evaluations: 10 .. 1000000"),
            (0 <= self.seed < 2**31, "--seed: 0 .. 2147483647"),
        ):
            if not valid:
                raise RequestError(message)


@dataclass(frozen=True, slots=True)
class ParameterEstimate:
    """Estimate of one parameter; `untuned` is its value in the simulator before identification.

    `low` and `high` are the whole range if `open`: the drives do not determine the parameter, or
    the estimate reaches the end of the range.
    """

    name: str
    unit: str
    meaning: str
    untuned: float
    value: float
    low: float
    high: float
    open: bool


@dataclass(frozen=True, slots=True)
class Identification:
    """Result of an identification.

    `problem` covers the fitted drives with the best start states; `everything` covers all windows,
    those of fitted drives first, with start states as measured.
    """

    settings: SysidSettings
    space: Space
    cube: Floats
    estimates: tuple[ParameterEstimate, ...]
    fitted: tuple[str, ...]
    held_out: tuple[str, ...]
    traces: tuple[SearchTrace, ...]
    problem: PredictionError
    everything: PredictionError
    error: HeldOut
    identifiability: Identifiability
    structure: Structure
    at_ends: tuple[str, ...]
    warnings: tuple[str, ...]

    @property
    def values(self) -> dict[str, float]:
        """Identified and fixed values of all parameters of the simulator."""
        return self.space.values(self.cube)

    @property
    def unsettled(self) -> tuple[str, ...]:
        """Parameters whose interval excludes the estimate: the search did not converge."""
        return tuple(one.name for one in self.estimates if not one.low <= one.value <= one.high)

    @property
    def conclusive(self) -> bool:
        return not (self.identifiability.undetermined or self.at_ends or self.unsettled)


def identify(
    drives: Sequence[Drive], settings: SysidSettings, reporter: Reporter
) -> Identification:
    """Raises RequestError for an invalid request, InconclusiveError for too few drives."""
    simulator = configured_simulator(settings)
    fitted, held = _split(drives, settings)
    windows = cut_windows([*fitted, *held], simulator, settings.window)
    known = _torques_known(drives, simulator)
    space = space_of(simulator, settings.parameters, settings.fixed, known)
    number = np.arange(len(windows))
    is_held = windows.replays.drive >= len(fitted)
    problem = PredictionError.of_windows(space, windows.only(number[~is_held]))
    evaluations = settings.evaluations or simulator.evaluations
    reporter.begin(f"search with {simulator.name}", settings.seeds * evaluations)
    problem, cube, traces = search(
        problem, settings.seeds, settings.seed, evaluations, reporter.advance
    )
    normal = normal_equations(problem, cube)
    information = identifiability(normal, space)
    limits = parameter_bounds(normal, cube, LEVEL)
    held_problem = problem.of(windows.only(number[is_held]))
    everything = problem.of(windows)
    shape = structure(held_problem, everything, cube)
    error = held_out_error(held_problem, space.start(), cube)
    ends = tuple(
        name
        for name in at_range_limits(space, cube, limits)
        if name not in information.undetermined
    )
    warnings = [warning for drive in drives for warning in drive.real.warnings]
    if space.lumped:
        warnings.append(
            f"the wheel torques are unknown: only ratios to the {simulator.shared[0]} are "
            f"identified ({', '.join(space.divided)})"
        )
    warnings += [*information.warnings, *shape.sentences()]
    values = zip(space.parameters, space.natural(cube).tolist(), strict=True)
    warnings += [range_warning(one, value) for one, value in values if one.name in ends]
    return Identification(
        settings, space, cube, _estimates(space, cube, limits, (*information.undetermined, *ends)),
        tuple(drive.name for drive in fitted), tuple(drive.name for drive in held),
        tuple(traces), problem, everything, error, information, shape, ends, tuple(warnings),
    )  # fmt: skip


def configured_simulator(settings: SysidSettings) -> Simulator:
    """The simulator with the requested ranges.

    Raises RequestError for unknown names and values, and for a simulator whose program is not
    installed.
    """
    name = settings.simulator
    if name not in SIMULATORS:
        raise RequestError(f"--simulator {name}: unknown (known: {', '.join(SIMULATORS)})")
    simulator = with_ranges(SIMULATORS[name](), settings.ranges)
    check(simulator, settings.parameters, settings.fixed, settings.ranges)
    return simulator


def _split(drives: Sequence[Drive], settings: SysidSettings) -> tuple[list[Drive], list[Drive]]:
    """Fitted and held-out drives; held-out drives are spread evenly over the order."""
    count = settings.held_out or max(1, round(len(drives) / 4))
    if len(drives) - count < MIN_FITTED:
        raise InconclusiveError(
            f"{len(drives)} drives, {count} of them held out: identification needs "
            f"{MIN_FITTED} to fit and 1 to hold out; record more"
        )
    held = {round((i + 0.5) * len(drives) / count - 0.5) for i in range(count)}
    fitted = [drive for i, drive in enumerate(drives) if i not in held]
    return fitted, [drives[i] for i in sorted(held)]


def _torques_known(drives: Sequence[Drive], simulator: Simulator) -> bool:
    """Raises RequestError where drives disagree."""
    known = {
        simulator.channels(drive.commands) == simulator.torques
        for drive in drives
        if drive.commands is not None
    }
    if len(known) > 1:
        raise RequestError("some drives have torques and some efforts; identify them separately")
    return known.pop()


def _estimates(space: Space, cube: Floats, limits: Floats,
               unknown: tuple[str, ...]) -> tuple[ParameterEstimate, ...]:  # fmt: skip
    low_ends, high_ends = space.natural(np.clip(limits, 0.0, 1.0)).tolist()
    estimates = []
    for one, value, low, high in zip(
        space.parameters, space.natural(cube).tolist(), low_ends, high_ends, strict=True
    ):
        is_open = one.name in unknown
        if is_open:
            low, high = one.low, one.high
        estimates.append(
            ParameterEstimate(
                one.name, one.unit, one.meaning, one.default, value, low, high, is_open
            )
        )
    return tuple(estimates)

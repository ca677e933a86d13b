"""Answers of a search: changes of a run with their judged gain, and the data that is stored."""

from __future__ import annotations

import math
import shlex
from dataclasses import dataclass, field, replace
from typing import Any

from s2rstore.intervals import Interval
from s2rstore.intervals.interval import finite
from s2rstore.records import SIDES, Run, Side
from s2rstore.run_inputs import chain_text
from s2rstore.security.printable_text import printable

VERSION = 2
_LARGEST = 1e9
"""Above every gain, in metres or as a share."""
AIMS: dict[Side, str] = {
    "real": "adapt the real images so that the model works",
    "sim": "tune the simulator so that it predicts the real images and errors",
}


@dataclass(frozen=True, slots=True)
class Change:
    """One changed value: of the run, fitted, its interval (`--for sim`), and the true one."""

    name: str
    factor: str
    unit: str
    before: float
    value: float
    interval: Interval | None = None
    truth: float | None = None


@dataclass(frozen=True, slots=True)
class Agreement:
    """How the sim predictions agree with the real ones on judged instances, in metres.

    sim_error, real_error: mean errors. shift: mean distance between the predicted positions;
    closer: its decrease by the change, with interval. correlation: of sim and real errors.
    """

    sim_error_before: float
    sim_error: float
    real_error: float
    shift_before: float
    shift: float
    closer: Interval
    correlation_before: float
    correlation: float


@dataclass(frozen=True, slots=True)
class Answer:
    """A change of the run with its gain on the instances of the judgement.

    fitted: gain of these values on whole frames of the fit. gain: in the unit of the report, with
    an interval that holds for all answers at once. chain: the chain of the side.
    """

    changes: tuple[Change, ...]
    fitted: float
    gain: Interval
    chain: tuple[dict[str, Any], ...]
    agreement: Agreement | None = None

    @property
    def evident(self) -> bool:
        """Whether the whole interval is above zero."""
        return self.gain.is_positive

    @property
    def factor(self) -> str:
        """The factor of its first change: of its factors, the one that alone gains most."""
        return self.changes[0].factor

    @property
    def factors(self) -> tuple[str, ...]:
        """The factors that its changes belong to, each once, in the order of the changes."""
        return tuple(dict.fromkeys(change.factor for change in self.changes))

    @property
    def changes_text(self) -> str:
        """Names and values of its changes as text, such as `brightness=0.85, vignette=0.3`."""
        return ", ".join(f"{change.name}={change.value:g}" for change in self.changes)

    @property
    def default_name(self) -> str:
        """A name for the run, from the changed adjustments."""
        names = [change.name.partition(":")[2] or change.name for change in self.changes]
        return "-".join(name.removeprefix("camera_") for name in names)

    def command(self, store: str, run: Run, side: Side, name: str | None = None) -> str:
        """The command that registers it as a run."""
        chains = {"sim": run.sim_adjustments, "real": run.real_adjustments, side: list(self.chain)}
        parts = ["s2r", "run", "add", name or f"{run.run}-{self.default_name}"]
        parts += ["--model", str(run.model), "--sim", run.sim_domain, "--real", run.real_domain]
        for each, chain in chains.items():
            if chain:
                parts += ["--adjust", f"{each}:{chain_text(chain).replace(', ', ',')}"]
        return shlex.join([*parts, "--store", store])


@dataclass(frozen=True, slots=True)
class FactorGain:
    """The gain of the adjustments of one factor alone, as that of an answer."""

    factor: str
    values: dict[str, float]
    fitted: float
    gain: Interval


@dataclass(frozen=True, slots=True)
class SuggestReport:
    """What a search found about a run.

    before: mean cost on the judged instances: real error in metres (`real`), or mismatch (`sim`).
    gap: real minus sim error of the judged instances, metres. answers: by number of changes.
    best: place of the suggested answer, None where nothing helps; reason says why.
    screening: sliders with their best value alone and its gain in the search, which may take
    subsampled frames of the fit, best first.
    factors: what each factor alone gains, by the gain on the fit, best first.
    """

    run: str
    side: Side
    key: str
    price: float
    seed: int
    before: float
    gap: Interval
    fitted_instances: int
    judged_instances: int
    evaluations: int
    complete: bool
    answers: tuple[Answer, ...] = ()
    best: int | None = None
    reason: str = ""
    screening: tuple[tuple[str, float, float], ...] = ()
    factors: tuple[FactorGain, ...] = ()
    truth: dict[str, float] = field(default_factory=dict)

    @property
    def helps(self) -> bool:
        return self.best is not None

    @property
    def is_unfinished(self) -> bool:
        """Whether the time was used up before an answer was found."""
        return self.best is None and not self.complete

    @property
    def unit(self) -> str:
        """Unit of gains: metres of the real error, or the share of the mismatch."""
        return "m" if self.side == "real" else "share"

    @property
    def aim(self) -> str:
        """What its direction is for."""
        return AIMS[self.side]

    @property
    def price_of_a_change(self) -> float:
        """What each change must gain, in the unit of the report."""
        return self.price * self.before if self.side == "real" else self.price

    @property
    def verdict(self) -> str:
        """The suggested answer with its gain, or why nothing helps."""
        if self.best is None:
            return f"{'not known' if self.is_unfinished else 'nothing helps'}: {self.reason}"
        answer = self.answers[self.best]
        return (
            f"suggested: {answer.changes_text} ({', '.join(answer.factors)}), which gains "
            f"{self.gain_interval(answer.gain)} on held-out instances"
        )

    def gain_text(self, value: float) -> str:
        """A gain in its unit: `+0.412 m` or `+35.6 %`."""
        return f"{value:+.3f} m" if self.side == "real" else f"{100 * value:+.1f} %"

    def gain_interval(self, gain: Interval) -> str:
        """A gain with its interval: `+0.412 m (+0.100 .. +0.800)`."""
        if self.side == "real":
            return bounds_text(gain, "m", signed=True, digits=3)
        return bounds_text(gain.scaled(100), "%", signed=True, digits=1)

    def as_json(self) -> dict[str, Any]:
        """Plain data with unknown numbers as None; `from_json` reads it."""
        return {
            "version": VERSION, "run": self.run, "for": self.side, "key": self.key,
            "price": self.price, "seed": self.seed, "before": finite(self.before),
            "unit": self.unit, "gap_m": self.gap.as_json(),
            "fitted_instances": self.fitted_instances,
            "judged_instances": self.judged_instances, "evaluations": self.evaluations,
            "complete": self.complete, "helps": self.helps, "best": self.best,
            "reason": self.reason,
            "answers": [_answer(answer) for answer in self.answers],
            "screening": [
                {"adjustment": name, "value": value, "fitted_gain": finite(gain)}
                for name, value, gain in self.screening
            ],
            "factors": [
                {
                    "factor": each.factor, "values": each.values,
                    "fitted_gain": finite(each.fitted), "gain": each.gain.as_json(),
                }
                for each in self.factors
            ],
            "truth": self.truth,
        }  # fmt: skip


def bounds_text(interval: Interval, unit: str, signed: bool = False, digits: int = 2) -> str:
    """A value with its interval: `1.35 m (0.23 .. 2.64)`."""
    form = f"{'+' if signed else ''}.{digits}f"
    bounds = interval.bounds_text(lambda bound: f"{bound:{form}}", to=" .. ")
    return f"{interval.value:{form}} {unit} ({bounds})"


def from_json(data: dict[str, Any]) -> SuggestReport:
    """Read a report of `as_json`.

    Raises ArithmeticError, AttributeError, KeyError, TypeError or ValueError for other data.
    """
    if data["version"] != VERSION or data["for"] not in SIDES:
        raise ValueError("another version")
    report = SuggestReport(
        run=_text(data["run"]), side="real" if data["for"] == "real" else "sim",
        key=str(data["key"]), price=float(data["price"]), seed=int(data["seed"]),
        before=_float(data["before"]), gap=_read_interval(data["gap_m"]),
        fitted_instances=int(data["fitted_instances"]),
        judged_instances=int(data["judged_instances"]), evaluations=int(data["evaluations"]),
        complete=bool(data["complete"]),
        answers=tuple(_read_answer(each) for each in data["answers"]),
        best=None if data["best"] is None else int(data["best"]), reason=_text(data["reason"]),
        screening=tuple(
            (_text(each["adjustment"]), float(each["value"]), _float(each["fitted_gain"]))
            for each in data["screening"]
        ),
        factors=tuple(
            FactorGain(
                _text(each["factor"]),
                {_text(name): float(value) for name, value in each["values"].items()},
                _float(each["fitted_gain"]), _read_interval(each["gain"]),
            )
            for each in data["factors"]
        ),
        truth={_text(name): float(value) for name, value in data["truth"].items()},
    )  # fmt: skip
    if report.best is not None and not 0 <= report.best < len(report.answers):
        raise ValueError("no answer of that number")
    return report


def _answer(answer: Answer) -> dict[str, Any]:
    agreement = None
    if answer.agreement is not None:
        made = answer.agreement
        agreement = {
            "sim_error_before_m": finite(made.sim_error_before),
            "sim_error_m": finite(made.sim_error), "real_error_m": finite(made.real_error),
            "shift_before_m": finite(made.shift_before), "shift_m": finite(made.shift),
            "closer_m": made.closer.as_json(),
            "correlation_before": finite(made.correlation_before),
            "correlation": finite(made.correlation),
        }  # fmt: skip
    return {
        "changes": [
            {
                "adjustment": change.name, "factor": change.factor, "unit": change.unit,
                "before": change.before, "value": change.value,
                "interval": change.interval and change.interval.as_json(),
                "truth": change.truth,
            }
            for change in answer.changes
        ],
        "factor": answer.factor, "factors": list(answer.factors),
        "fitted_gain": finite(answer.fitted),
        "gain": answer.gain.as_json(), "evident": answer.evident,
        "chain": [dict(step) for step in answer.chain], "agreement": agreement,
    }  # fmt: skip


def _read_answer(data: dict[str, Any]) -> Answer:
    made = data["agreement"]
    agreement = None
    if made is not None:
        agreement = Agreement(
            _float(made["sim_error_before_m"]), _float(made["sim_error_m"]),
            _float(made["real_error_m"]), _float(made["shift_before_m"]), _float(made["shift_m"]),
            _read_interval(made["closer_m"]), _float(made["correlation_before"]),
            _float(made["correlation"]),
        )  # fmt: skip
    changes = tuple(
        Change(
            _text(each["adjustment"]), _text(each["factor"]), _text(each["unit"]),
            float(each["before"]), float(each["value"]),
            None if each["interval"] is None else _read_interval(each["interval"]),
            None if each["truth"] is None else float(each["truth"]),
        )
        for each in data["changes"]
    )  # fmt: skip
    if not changes:
        raise ValueError("an answer without changes")
    chain = tuple(
        {**step, "name": _text(step["name"]), "value": float(step["value"])}
        for step in data["chain"]
    )
    return Answer(
        changes, _float(data["fitted_gain"]), _read_interval(data["gain"]), chain, agreement
    )


def _read_interval(data: dict[str, Any]) -> Interval:
    """Raises ValueError for values that no gain has, which could not be drawn."""
    interval = Interval.from_json(data)
    ends = interval.ends or (0.0, 0.0)
    numbers = (interval.low, interval.value, interval.high, *ends)
    if any(_LARGEST < abs(each) < math.inf for each in numbers):
        raise ValueError("a gain out of range")
    return replace(interval, reason=_text(interval.reason))


def _text(value: Any) -> str:
    """A text of the store without control characters."""
    return printable(str(value))


def _float(value: Any) -> float:
    return math.nan if value is None else float(value)

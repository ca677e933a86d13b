"""What executors have in common: tasks, the function that computes one in any process, workers."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field
from typing import Protocol

from s2rstore.files.compute_environment import ComputeEnvironment
from s2rtools.heatmaps import HEATMAP_KINDS
from s2rtools.precompute.unit_computer import Computation
from s2rtools.precompute.unit_results import Receipt
from s2rtools.precompute.work_units import WorkUnit


@dataclass(frozen=True, slots=True)
class Task:
    """A unit and what computes it.

    `environment` is the one in which the first values of the unit's arrays were computed, None
    where there are none.
    """

    computation: Computation
    unit: WorkUnit
    environment: ComputeEnvironment | None = None


class Executor(Protocol):
    """Computes tasks somewhere.

    `run` gives a receipt for each task as soon as it is computed, in any order. A caller that
    leaves the iterator ends the work that was begun. Workers write results under unique names;
    only the caller gives them their final names, writes the ledger and publishes. `is_remote` tells
    whether results come from workers that this process did not start on this machine.
    """

    is_remote: bool

    def run(self, tasks: Iterable[Task]) -> Iterator[Receipt]: ...


_opened: tuple[Computation, int, Callable[[WorkUnit], Receipt]] | None = None


def compute(task: Task, threads: int) -> Receipt:
    """Compute a task with some threads; what the next task needs, too, stays open."""
    global _opened
    if _opened is None or _opened[:2] != (task.computation, threads):
        _opened = None
        _opened = (task.computation, threads, task.computation.open(threads))
    return _opened[2](task.unit)


def close() -> None:
    """Drop what `compute` keeps open."""
    global _opened
    _opened = None


def by_threads(tasks: Iterable[Task], requested: int | None, usual: int) -> dict[int, list[Task]]:
    """Tasks by the number of threads with which a worker of this machine computes them.

    Without a requested number, an array that is begun keeps that with which it was.
    """
    groups: dict[int, list[Task]] = {}
    for task in tasks:
        begun = None if task.environment is None else task.environment.threads
        groups.setdefault(requested or begun or usual, []).append(task)
    return groups


def largest_first(units: Iterable[WorkUnit]) -> list[WorkUnit]:
    """Units in the order in which several processes finish them the earliest."""

    def key(unit: WorkUnit) -> tuple[bool, int]:
        kind = HEATMAP_KINDS.get(unit.stage.name)
        return kind is None or kind.cost == "forward", -len(unit.instances)

    return sorted(units, key=key)


@dataclass
class RequestedWorkers:
    """`count` workers, each by a job or process of its own.

    `refused` are the errors of jobs that could not be submitted, by the names of their workers.
    Another thread may change them meanwhile.
    """

    count: int
    refused: dict[str, str] = field(default_factory=dict)
    _told: int = 0

    @property
    def arriving(self) -> int:
        """How many workers run or are on their way."""
        return self.count - len(self.refused)

    @property
    def refusal(self) -> str:
        """How many jobs were refused, with the last error; empty where none were."""
        errors = [*self.refused.values()]
        return f"{len(errors)} of {self.count} jobs were refused ({errors[-1]})" if errors else ""

    def news(self) -> str:
        """The refusal, where more jobs are refused than at the last call, else nothing."""
        before, self._told = self._told, len(self.refused)
        return self.refusal if self._told > before else ""

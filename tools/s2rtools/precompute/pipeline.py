"""Compute the missing arrays of runs, and publish each round of a run when it is done."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import s2rstore
from s2rstore.errors import RequestError, StoreBusyError
from s2rstore.files import atomic_writes, layout, locks
from s2rstore.files.lease import Lease
from s2rstore.maintenance.prune import remove_superseded
from s2rstore.reader import Store
from s2rstore.records import Part, Run
from s2rtools.common.command_line.progress import Reporter
from s2rtools.heatmaps import HEATMAP_KINDS
from s2rtools.models.load_model import model_outline
from s2rtools.precompute import domain_calibration
from s2rtools.precompute.backend_choice import run_backends
from s2rtools.precompute.chosen_kinds import default_kinds, kinds_without_network, usable_kinds
from s2rtools.precompute.executors.executor import Executor, Task, largest_first
from s2rtools.precompute.executors.local_executors import LocalExecutor, WorkerPool
from s2rtools.precompute.input_hashes import InputHashes
from s2rtools.precompute.label_gains import update_label_gains
from s2rtools.precompute.merged_arrays import merge_arrays
from s2rtools.precompute.publish_results import publish_run
from s2rtools.precompute.restart import discard_incomplete
from s2rtools.precompute.run_backends import RunBackends
from s2rtools.precompute.run_stages import (
    PROJECTION,
    ROUNDS,
    Round,
    RunStages,
    imported_run_stages,
    model_run_stages,
)
from s2rtools.precompute.shared_progress import SharedProgress
from s2rtools.precompute.tasks.map_grids import merge_grids
from s2rtools.precompute.unit_computer import Computation
from s2rtools.precompute.unit_plan import UnitPlan
from s2rtools.precompute.work_units import Stage


@dataclass(frozen=True, slots=True)
class PrecomputeOptions:
    """Options of `precompute`; `kinds` are heatmap kinds, all by default.

    `workers` is the number of processes, by default as many as pay off, and `threads` how many each
    computes with, by default so many that they use all processors; `executor` replaces both.
    `refit` fits projections on all instances again. `backend` names that of the predictions; `auto`
    keeps the recorded one of a run, else it takes the first that this machine has and that is
    accurate (`backend_choice`). `restart` begins arrays again that are not complete.
    """

    kinds: tuple[str, ...] | None = None
    workers: int | None = None
    backend: str = "auto"
    trust: bool = False
    refit: bool = False
    threads: int | None = None
    restart: bool = False
    executor: Executor | None = None


def precompute(
    root: Path,
    reporter: Reporter,
    runs: Sequence[str] = (),
    options: PrecomputeOptions | None = None,
) -> list[str]:
    """Compute and publish the named runs (all by default); return those that were published.

    All runs are computed in rounds (`run_stages.ROUNDS`): first the predictions of all, then their
    heatmaps, those that take the longest last. Each round of a run is published when it is done;
    of the generations that this makes, the newest stay, see `prune.remove_superseded`.

    Arrays that are published or that the ledger records are not computed again. Raises
    StoreBusyError if another process computes, RequestError for unknown runs or kinds, and after
    the other runs for one that cannot be computed or whose model needs `options.trust`.
    """
    options = options or PrecomputeOptions()
    for kind in options.kinds or ():
        if kind not in HEATMAP_KINDS:
            raise RequestError(f"heatmap kind {kind!r}: one of {', '.join(HEATMAP_KINDS)}")
    with (
        locks.compute_lock(root, report_line=reporter.say) as lease,
        CurrentStore(root) as current,
        WorkerPool(reporter.say) as pool,
        SharedProgress(root, reporter) as progress,
    ):
        store = current.get()
        store.require_poses("precompute")
        names = [store.run(name).run for name in runs] or list(store.runs)
        if not names:
            raise RequestError(f"{root}: {store.no_run}")
        untrusted = [name for name in names if not options.trust and _needs_trust(store, name)]
        local = LocalExecutor(pool, options.workers, options.threads)
        call = _Call(current, options, progress, lease, local)
        computed = [_Run(call, name) for name in names if name not in untrusted]
        for number in range(len(ROUNDS)):
            for place, run in enumerate(computed, 1):
                if run.error is not None:
                    continue
                count = len(current.get().instances)
                progress.expect(number, count, len(computed) - place, len(computed))
                run.try_to_compute(number)
        if labelled := update_label_gains(root, lease.check):
            reporter.say(f"gains of labelled objects: {', '.join(labelled)}")
        for run in computed:
            if run.error is not None:
                raise run.error
        if untrusted:
            raise RequestError(
                f"{root}: not computed: {', '.join(untrusted)}; loading the model executes code: "
                "add --trust if you trust it"
            )
        return [run.name for run in computed if run.is_published]


def _needs_trust(store: Store, name: str) -> bool:
    model = store.models.get(store.run(name).model or "")
    return model is not None and model.needs_trust


@dataclass(frozen=True, slots=True)
class _Call:
    """What the runs of one call of `precompute` share.

    `lease` is that of the compute lock, `published` are the generations of this call. `local`
    computes where the options name no executor.
    """

    current: CurrentStore
    options: PrecomputeOptions
    reporter: Reporter
    lease: Lease
    local: LocalExecutor
    published: list[int] = field(default_factory=list)


class _Run:
    """A run while it is brought up to date, round by round.

    `is_published` tells whether a new generation was published; `error` is why the run cannot be
    computed.
    """

    def __init__(self, call: _Call, name: str) -> None:
        self._call, self.name = call, name
        self.is_published = False
        self.error: RequestError | None = None
        self._run = call.current.get().run(name)
        self._was_computed = self._run.key is not None
        self._parts: Sequence[Part] = ()
        self._stages: RunStages | None = None
        self._has_predictions_only = False
        self._backends: RunBackends | None = None

    def try_to_compute(self, number: int) -> None:
        """As `compute`, but an error of this run alone is kept, so that others are computed."""
        try:
            self.compute(number)
        except StoreBusyError:
            raise
        except RequestError as error:
            self.error = error

    def compute(self, number: int) -> None:
        """Compute and publish a round, and those before it of instances that were added meanwhile.

        The predictions of instances that are added to a published run are published with their
        projection. Raises StoreBusyError when the compute lock was taken over.
        """
        call = self._call
        call.lease.check()
        while (
            (stages := self._stages) is None
            or self._parts != call.current.get().parts
            or (number > 0 and self._has_predictions_only)
        ):
            if stages is not None and self._parts != call.current.get().parts:
                too = "" if self._run.is_imported else "; computing them, too"
                call.reporter.say(f"{self.name}: instances were added meanwhile{too}")
            self._stages = self._plan(number, is_new=stages is None)
            for earlier in self._stages.rounds[:number]:
                self._compute_round(earlier)
        self._compute_round(stages.rounds[number])
        store = call.current.get()
        if self._parts != store.parts:
            return self.compute(number)
        if number >= PROJECTION or not self._was_computed:
            self._publish(store, stages, number)
        if number == len(ROUNDS) - 1:
            root = call.current.root
            atomic_writes.remove(root, f"{layout.UNITS}/{self.name}")  # with the choice of backends
            call.reporter.say(f"{self.name}: {'published' if self.is_published else 'up to date'}")
        return None

    def _plan(self, number: int, is_new: bool) -> RunStages:
        """The stages of the run in the published generation; `is_new` for the first plan.

        The first round of a run of which nothing is published has a plan without heatmaps, so that
        predictions do not wait for what is measured for these.
        """
        call = self._call
        store, options = call.current.get(), call.options
        run = self._run = store.run(self.name)
        kinds: Sequence[str] = tuple(HEATMAP_KINDS) if options.kinds is None else options.kinds
        say = call.reporter.say if is_new else lambda line: None
        if run.is_imported:
            kinds = kinds_without_network(self.name, kinds, say)
        kinds = usable_kinds(store, run, kinds, say)
        is_first = is_new or self._has_predictions_only
        self._has_predictions_only = run.model is not None and number == 0 and run.key is None
        if run.model is None:
            stages = self._imported_stages(run, kinds)
        else:
            stages = self._model_stages(run, kinds, say)
        if options.restart and is_first:
            discard_incomplete(call.current.get(), stages.stages, call.lease.check)
        return stages

    def _imported_stages(self, run: Run, kinds: Sequence[str]) -> RunStages:
        """What needs no network: heatmaps and their map grids, with embeddings the projection.

        Instances that were appended after the import stay without predictions.
        """
        call = self._call
        _calibrate(call, run, kinds)
        store = call.current.get()
        self._parts = store.parts
        return imported_run_stages(store, call.current.hashes, run, kinds, call.options.refit)

    def _model_stages(
        self, run: Run, kinds: Sequence[str], say: Callable[[str], None]
    ) -> RunStages:
        call, options = self._call, self._call.options
        store = call.current.get()
        model = model_outline(store, run.network("precompute"), options.trust)
        if run.key is None and options.executor is None:
            call.local.start(len(store.instances))
        if not self._has_predictions_only:
            _calibrate(call, run, kinds)
        allowed = [kind for kind in kinds if HEATMAP_KINDS[kind].suits(model)]
        if options.kinds is None:
            allowed = default_kinds(call.current.get(), self.name, model, allowed, say)
        self._backends = run_backends(
            call.current.get(),
            run,
            options.trust,
            allowed,
            options.backend,
            call.reporter.say,
            call.lease.check,
            call.local.threads(len(store.instances)),
            not self._has_predictions_only,
        )
        store = call.current.get()
        self._parts = store.parts
        planned = () if self._has_predictions_only else allowed
        return model_run_stages(
            store, call.current.hashes, run, model, self._backends, planned, options.refit
        )

    def _compute_round(self, planned: Round) -> None:
        """Compute what is missing of a round, group by group, and merge the arrays of parts."""
        call = self._call
        for group in planned.groups:
            call.lease.check()
            _compute_stages(call, group, self._backends)
        if planned.merges:
            call.reporter.begin(f"{self.name}: merging parts", len(planned.merges))
            merge_arrays(
                call.current.root, self.name, planned.merges, call.lease.check,
                call.reporter.advance,
            )  # fmt: skip

    def _publish(self, store: Store, stages: RunStages, number: int) -> None:
        """Publish a round with those before it, unless the index lists all of it already.

        Generations of this call that are superseded by then are removed.
        """
        call, published = self._call, stages.rounds[number].published
        check = call.lease.check
        generation = publish_run(store, self._run, published, self._backends, check, stages.earlier)
        if generation is not None:
            self.is_published = True
            call.published.append(generation)
            remove_superseded(call.current.root, call.published)


def _calibrate(call: _Call, run: Run, kinds: Sequence[str]) -> None:
    """Calibrate the run's pair of domains as far as the heatmap kinds need it."""
    current, check = call.current, call.lease.check
    pair = f"{run.sim_domain} | {run.real_domain}"
    if any(HEATMAP_KINDS[kind].aligned for kind in kinds) and domain_calibration.ensure_calibrated(
        current.get(), run, check
    ):
        call.reporter.say(f"{pair}: rigs calibrated")
    if any(HEATMAP_KINDS[kind].compares_depth for kind in kinds) and (
        domain_calibration.ensure_depth_tolerance(current.get(), run, check)
    ):
        call.reporter.say(f"{pair}: noise of the depth sensor estimated")


def _compute_stages(call: _Call, stages: Sequence[Stage], backends: RunBackends | None) -> None:
    """Compute what is missing of some stages, each array in one environment."""
    store, options, lease = call.current.get(), call.options, call.lease
    root = store.path
    plan = UnitPlan(root, stages, store.array_paths, merge_grids)
    if plan.units:
        names = list(dict.fromkeys(unit.stage.name for unit in plan.units))
        label = names[0] if len(names) == 1 else f"{names[0]} .. {names[-1]}"
        total = sum(len(unit.instances) for unit in plan.units)
        call.reporter.begin(f"{plan.units[0].stage.run}: {label}", total)
        computation = Computation(
            root, store.generation, backends, options.trust, identity=store.identity
        )
        precision = computation.precision
        tasks = [
            Task(computation, unit, plan.environment(unit, precision(unit.stage)))
            for unit in largest_first(plan.units)
        ]
        executor = options.executor or call.local
        for receipt in executor.run(tasks):
            lease.raise_if_lost()
            unit = plan.finish(receipt, is_checked=executor.is_remote)
            call.reporter.advance(len(unit.instances))
        lease.check()
    plan.close()


class CurrentStore:
    """Keeps the published generation open and opens it again when there is a newer one."""

    def __init__(self, root: Path) -> None:
        self.root = root
        self._store = s2rstore.open(root)
        self.hashes = InputHashes(self._store)

    def __enter__(self) -> CurrentStore:
        return self

    def __exit__(self, *error: object) -> None:
        self._store.close()

    def get(self) -> Store:
        """The generation that is published now; the store of an earlier call may be closed."""
        if self._store.latest_generation() != self._store.generation:
            self._store.close()
            self._store = s2rstore.open(self.root)
            self.hashes = InputHashes(self._store, self.hashes)
        return self._store

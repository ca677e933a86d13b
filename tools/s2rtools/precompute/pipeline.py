"""Compute the missing arrays of runs and publish each run as soon as it is complete."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from s2rstore.errors import RequestError
from s2rstore.files import atomic_writes, layout, locks
from s2rstore.files.lease import Lease
from s2rstore.reader import Store
from s2rstore.records import Run
from s2rtools.common.command_line.progress import Reporter
from s2rtools.common.processors import available_processors
from s2rtools.heatmaps import HEATMAP_KINDS, IMAGE_KINDS
from s2rtools.inference.cuda_backend import CudaBackend
from s2rtools.models.load_model import model_outline
from s2rtools.models.pose_network import LoadedModel
from s2rtools.precompute import depth_calibration, rig_calibration
from s2rtools.precompute.backend_choice import run_backends
from s2rtools.precompute.current_store import CurrentStore
from s2rtools.precompute.executors.executor import Executor, Task, by_threads, largest_first
from s2rtools.precompute.executors.local_executors import (
    WorkerPool,
    default_threads,
    default_workers,
    local_executor,
)
from s2rtools.precompute.merged_arrays import merge_arrays
from s2rtools.precompute.publish_results import publish_run
from s2rtools.precompute.restart import discard_incomplete
from s2rtools.precompute.run_backends import RunBackends
from s2rtools.precompute.run_stages import RunStages, imported_run_stages, model_run_stages
from s2rtools.precompute.tasks.map_grids import merge_grids
from s2rtools.precompute.unit_computer import Computation
from s2rtools.precompute.unit_plan import UnitPlan
from s2rtools.precompute.usable_kinds import usable_kinds
from s2rtools.precompute.work_units import Stage, WorkUnit


@dataclass(frozen=True, slots=True)
class PrecomputeOptions:
    """Options of `precompute`; `kinds` are heatmap kinds, all by default.

    `workers` is the number of processes, by default as many as pay off, and `threads` how many each
    computes with, by default so many that they use all processors; `executor` replaces both.
    `refit` fits projections on all instances again. `backend` names that of the predictions; `auto`
    keeps the recorded one of a run, else it measures which is the fastest. `restart` begins arrays
    again that are not complete.
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

    Arrays that are published or that the ledger records are not computed again. Raises
    StoreBusyError if another process computes, RequestError for unknown runs or kinds, and after
    the other runs for those whose model needs `options.trust`.
    """
    options = options or PrecomputeOptions()
    for kind in options.kinds or ():
        if kind not in HEATMAP_KINDS:
            raise RequestError(f"heatmap kind {kind!r}: one of {', '.join(HEATMAP_KINDS)}")
    kinds = tuple(HEATMAP_KINDS) if options.kinds is None else options.kinds
    with (
        locks.compute_lock(root, report_line=reporter.say) as lease,
        CurrentStore(root) as current,
        WorkerPool(reporter.say) as pool,
    ):
        store = current.get()
        store.require_poses("precompute")
        names = [store.run(name).run for name in runs] or list(store.runs)
        if not names:
            raise RequestError(f"{root}: {store.no_run}")
        untrusted = [name for name in names if not options.trust and _needs_trust(store, name)]
        published = [
            name for name in names
            if name not in untrusted
            and _compute_run(current, name, kinds, options, reporter, lease, pool)
        ]  # fmt: skip
        if untrusted:
            raise RequestError(
                f"{root}: not computed: {', '.join(untrusted)}; loading the model executes code: "
                "add --trust if you trust it"
            )
        return published


def _needs_trust(store: Store, name: str) -> bool:
    model = store.models.get(store.run(name).model or "")
    return model is not None and model.needs_trust


def _compute_run(
    current: CurrentStore,
    name: str,
    kinds: Sequence[str],
    options: PrecomputeOptions,
    reporter: Reporter,
    lease: Lease,
    pool: WorkerPool,
) -> bool:
    """Bring one run up to date; True if a new generation was published.

    Raises StoreBusyError when the compute lock, held as `lease`, was taken over.
    """
    lease.check()
    root, run = current.root, current.get().run(name)
    if run.is_imported:
        kinds = _without_network(name, kinds, reporter)
    kinds = usable_kinds(current.get(), run, kinds, reporter.say)
    if run.model is None:
        _calibrate(current, run, kinds, reporter, lease)
        return _compute_imported(current, run, kinds, options, reporter, lease, pool)
    model = model_outline(current.get(), run.model, options.trust)
    if run.key is None:
        _start_workers(pool, len(current.get().instances), options)
    _calibrate(current, run, kinds, reporter, lease)
    allowed = [kind for kind in kinds if HEATMAP_KINDS[kind].suits(model)]
    if options.kinds is None:
        allowed = _default_kinds(current.get(), name, model, allowed, reporter)
    workers = options.workers or default_workers(len(current.get().instances))
    backends = run_backends(
        current.get(),
        run,
        options.trust,
        allowed,
        options.backend,
        reporter.say,
        lease.check,
        options.threads or default_threads(workers),
    )
    store = current.get()
    planned = store.parts
    stages = model_run_stages(store, current.hashes, run, model, backends, allowed, options.refit)
    _compute_groups(current, stages, backends, options, reporter, lease, pool)
    if current.get().parts != planned:
        reporter.say(f"{name}: instances were added meanwhile; computing them, too")
        options = replace(options, restart=False)
        return _compute_run(current, name, kinds, options, reporter, lease, pool)
    _merge(root, stages, reporter, lease)
    is_new = publish_run(
        current.get(), run, stages.published, backends.record(), lease.check, stages.earlier
    )
    atomic_writes.remove(root, f"{layout.UNITS}/{name}")  # with the choice of backends
    reporter.say(f"{name}: {'published' if is_new else 'up to date'}")
    return is_new


def _default_kinds(
    store: Store, run: str, model: LoadedModel, kinds: Sequence[str], reporter: Reporter
) -> list[str]:
    """Those kinds that are computed where none are named; reports the others.

    A kind that the run has already is computed for new instances, too.
    """
    published = {record.kind for record in store.array_parts(run)}
    usual = [k for k in kinds if k in published or HEATMAP_KINDS[k].is_default(model)]
    left_out = [kind for kind in kinds if kind not in usual]
    if left_out:
        reporter.say(
            f"{run}: {', '.join(left_out)} left out, which take long for inputs of "
            f"{model.contract.size[1]} x {model.contract.size[0]}; "
            f"--kinds {','.join(left_out)} adds them"
        )
    return usual


def _calibrate(
    current: CurrentStore,
    run: Run,
    kinds: Sequence[str],
    reporter: Reporter,
    lease: Lease,
) -> None:
    """Calibrate the run's pair of domains as far as the heatmap kinds need it."""
    pair = f"{run.sim_domain} | {run.real_domain}"
    if any(HEATMAP_KINDS[kind].aligned for kind in kinds) and rig_calibration.ensure_calibrated(
        current.get(), run, lease.check
    ):
        reporter.say(f"{pair}: rigs calibrated")
    if any(HEATMAP_KINDS[kind].compares_depth for kind in kinds) and (
        depth_calibration.ensure_depth_tolerance(current.get(), run, lease.check)
    ):
        reporter.say(f"{pair}: noise of the depth sensor estimated")


def _without_network(name: str, kinds: Sequence[str], reporter: Reporter) -> tuple[str, ...]:
    """Those of the heatmap kinds that need no network; reports the others."""
    others = [kind for kind in kinds if kind not in IMAGE_KINDS]
    if others:
        reporter.say(f"{name}: imported predictions; {', '.join(others)} left out (no network)")
    return tuple(kind for kind in kinds if kind in IMAGE_KINDS)


def _compute_imported(
    current: CurrentStore,
    run: Run,
    kinds: Sequence[str],
    options: PrecomputeOptions,
    reporter: Reporter,
    lease: Lease,
    pool: WorkerPool,
) -> bool:
    """Bring a run of imported predictions up to date; True if a new generation was published.

    Computes what needs no network: the heatmaps of `kinds` and their map grids, and with embeddings
    projection and outliers. Instances that were appended after the import stay without predictions.
    """
    stages = imported_run_stages(current.get(), current.hashes, run, kinds, options.refit)
    _compute_groups(current, stages, None, options, reporter, lease, pool)
    _merge(current.root, stages, reporter, lease)
    is_new = publish_run(current.get(), run, stages.published, None, lease.check)
    atomic_writes.remove(current.root, f"{layout.UNITS}/{run.run}")
    reporter.say(f"{run.run}: {'published' if is_new else 'up to date'}")
    return is_new


def _compute_groups(
    current: CurrentStore,
    stages: RunStages,
    backends: RunBackends | None,
    options: PrecomputeOptions,
    reporter: Reporter,
    lease: Lease,
    pool: WorkerPool,
) -> None:
    """Compute what is missing of the stages of a run, group by group."""
    store = current.get()
    if options.restart:
        discard_incomplete(store, [*stages.computed, *stages.published], lease.check)
        store = current.get()
    for group in stages.groups:
        lease.check()
        _compute_stages(store, group, backends, options, reporter, lease, pool)


def _merge(root: Path, stages: RunStages, reporter: Reporter, lease: Lease) -> None:
    """Merge the arrays of parts to those of segments."""
    if stages.merges:
        reporter.begin(f"{stages.run}: merging parts", len(stages.merges))
        merge_arrays(root, stages.run, stages.merges, lease.check, reporter.advance)


def _compute_stages(
    store: Store,
    stages: Sequence[Stage],
    backends: RunBackends | None,
    options: PrecomputeOptions,
    reporter: Reporter,
    lease: Lease,
    pool: WorkerPool,
) -> None:
    """Compute what is missing of some stages, each array in one environment."""
    root = store.path
    plan = UnitPlan(root, stages, store.array_paths, merge_grids)
    if plan.units:
        names = list(dict.fromkeys(unit.stage.name for unit in plan.units))
        label = names[0] if len(names) == 1 else f"{names[0]} .. {names[-1]}"
        total = sum(len(unit.instances) for unit in plan.units)
        reporter.begin(f"{plan.units[0].stage.run}: {label}", total)
        computation = Computation(
            root, store.generation, backends, options.trust, identity=store.identity
        )
        precision = computation.precision
        tasks = [
            Task(computation, unit, plan.environment(unit, precision(unit.stage)))
            for unit in largest_first(plan.units)
        ]
        for executor, some in _assigned(tasks, _passes(plan.units), options, pool):
            for receipt in executor.run(some):
                lease.raise_if_lost()
                unit = plan.finish(receipt, is_checked=executor.is_remote)
                reporter.advance(len(unit.instances))
        lease.check()
    plan.close()


def _passes(units: Iterable[WorkUnit]) -> int:
    """Instances of units; twice those of units with kinds that need one pass and many passes."""
    return sum(
        len(unit.instances) * len({_needs_many_passes(spec.kind) for spec in unit.missing})
        for unit in units
    )


def _needs_many_passes(kind: str) -> bool:
    return kind in HEATMAP_KINDS and HEATMAP_KINDS[kind].cost == "many"


def _start_workers(pool: WorkerPool, instances: int, options: PrecomputeOptions) -> None:
    """Start the processes that will compute a new run, while its backends are measured."""
    workers = min(options.workers or available_processors(), default_workers(instances))
    if workers > 1 and options.executor is None and CudaBackend.unavailable_reason() is not None:
        pool.start(workers)


def _assigned(
    tasks: Sequence[Task], instances: int, options: PrecomputeOptions, pool: WorkerPool
) -> Iterator[tuple[Executor, list[Task]]]:
    """Executors with the tasks that each computes, one after the other."""
    if options.executor is not None:
        yield options.executor, list(tasks)
        return
    workers = options.workers or default_workers(instances)
    workers = min(workers, len(tasks), available_processors())
    if any(task.computation.uses_gpu(task.unit.stage) for task in tasks):
        workers = 1
    groups = by_threads(tasks, options.threads, default_threads(workers))
    for threads, some in groups.items():
        yield local_executor(workers, threads, pool), some

"""`s2r demo`: build a demo store and open the application on it, while the rest is computed."""

from __future__ import annotations

import argparse
import sys
import textwrap
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import s2rstore
from s2rstore.errors import RequestError
from s2rtui.cli import main
from s2rtui.jobs.background_demo import LOG, PAUSE, BackgroundDemo, ChildCommand, start_compiling

if TYPE_CHECKING:
    from s2rstore.reader import Store

STORE = "demo.s2r"
WORLD = "world.s2r"
TRAINING = "training.s2r"
QUICK = "quick"
INSTANCES = 50
_PRETRAINED_SEED = 1
_QUICK_VIEWS = 1500
_QUICK_MINUTES = 2.0
_SCORED_INSTANCES = 60
_NOTHING_HELPS = 3
"""The exit code of `s2r suggest` where no change clearly helps."""
_SUGGESTED = ("--evaluations", "30", "--frames", "24")
_SHOWN = {"score": "scores of heatmaps and causes", "suggest": "suggestions"}
"""What applications show while these commands run, which report no progress to them."""
_LINE_WIDTH = 80


@dataclass(frozen=True, slots=True)
class _Stage:
    """One command of the demo; the application can be open during one that `is_late`.

    is_parallel: whether another process runs it beside the stages after it. accepted: its exit
    codes that are no failure.
    """

    arguments: tuple[str, ...]
    is_late: bool = False
    is_parallel: bool = False
    accepted: tuple[int, ...] = (0,)

    @property
    def command_line(self) -> str:
        return f"$ s2r {' '.join(self.arguments)}"

    @property
    def label(self) -> str:
        return " ".join(self.arguments[:2])

    def failure(self, code: int) -> int:
        """The exit code `code`, or 0 if the stage accepts it."""
        return 0 if code in self.accepted else code


EXAMPLE = "s2r demo --out demo-out --workers 4"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--out", type=Path, default=Path("demo-out"),
                        help="folder for store and images (default demo-out)")  # fmt: skip
    parser.add_argument(
        "--workers", type=int, help="worker processes (default: as many as pay off)"
    )
    parser.add_argument(
        "--no-open",
        action="store_true",
        help="do not open the application, and wait for everything",
    )
    parser.add_argument("--minutes", type=float,
                        help="time per training (default 2; with --data 1.5)")  # fmt: skip
    add = parser.add_argument_group("synthetic world").add_argument
    add("--seed", type=int, default=_PRETRAINED_SEED,
        help="random seed of the building (default 1); for any other seed a model "
        "is trained")  # fmt: skip
    add("--instances", type=int, help=f"instances of each trajectory (default {INSTANCES})")
    add(
        "--factors",
        default="all",
        metavar="NAME[=SEVERITY],...",
        help="differences of the real side: names with severities, all or none (default all)",
    )
    add("--retrain", choices=(QUICK,), help="train one more model beside the pretrained ones")
    add = parser.add_argument_group("your images").add_argument
    add("--data", type=Path, metavar="DIR", help="folder in the Sim2RealViz layout (traj1/ ...)")


def execute(options: argparse.Namespace) -> int:
    _check(options)
    options.out.mkdir(parents=True, exist_ok=True)
    store = options.out / (STORE if options.data else WORLD)
    opens = not options.no_open and sys.stdin.isatty() and sys.stdout.isatty()
    stages = _data_stages(options, store) if options.data else _world_stages(options, store)
    return _open_early(options, store, stages) if opens else _complete(options, store, stages)


def _complete(options: argparse.Namespace, store: Path, stages: Iterator[_Stage]) -> int:
    """Run all stages, print the findings, and export figures."""
    from s2rstore.files import locks
    from s2rstore.findings import store_summary

    start = time.monotonic()
    timings: list[tuple[str, float]] = []
    with locks.file_lock(options.out / LOG, timeout=0.0):
        if code := _run_all(stages, store, timings):
            return code
        with s2rstore.open(store) as opened:
            for line in store_summary.summary_lines(opened):
                print(textwrap.fill(line, _LINE_WIDTH, subsequent_indent="      "))
            if QUICK in opened.runs:
                print(_training_summary(opened))
        began = time.monotonic()
        _export_pictures(options.out, store)
        timings.append(("images", time.monotonic() - began))
    for label, seconds in [*timings, ("total", time.monotonic() - start)]:
        print(f"{seconds:7.1f} s  {label}", file=sys.stderr)
    print(f"open it with: s2r {store}")
    return 0


def _run_all(stages: Iterator[_Stage], store: Path, timings: list[tuple[str, float]]) -> int:
    """Run the stages and append the seconds that each took; returns 0, or the code of a failure.

    Applications on the store show what is computed, as for `s2r precompute`.
    """
    from s2rstore.files import compute_progress

    shown: list[str] = []
    children: list[tuple[_Stage, ChildCommand]] = []
    with ExitStack() as exits:
        for stage in stages:
            began = time.monotonic()
            if stage.arguments[0] in _SHOWN:
                if not shown:
                    exits.callback(compute_progress.remove, store)
                shown.append(_SHOWN[stage.arguments[0]])
                compute_progress.write(store, ", ".join(shown), 0, 0, None)
            if stage.is_parallel:
                print(stage.command_line, file=sys.stderr)
                children.append((stage, ChildCommand(stage.arguments)))
                exits.callback(children[-1][1].stop)
                continue
            if code := _run(stage):
                return code
            timings.append((stage.label, time.monotonic() - began))
        for stage, child in children:
            began = time.monotonic()
            if code := stage.failure(child.wait()):
                return code
            timings.append((f"rest of {stage.label}", time.monotonic() - began))
    return 0


def _run(stage: _Stage) -> int:
    """Run a command of the demo; returns 0, or the exit code with which it failed."""
    print(stage.command_line, file=sys.stderr)
    return stage.failure(main(list(stage.arguments)))


def _open_early(options: argparse.Namespace, store: Path, stages: Iterator[_Stage]) -> int:
    """Open the application once the predictions are published; another process goes on."""
    for stage in stages:
        if stage.is_late:
            break
        if code := _run(stage):
            return code
    else:
        return main(["tui", str(store)])
    if _is_being_completed(options.out):
        print(f"another process completes this demo (see {options.out / LOG})", file=sys.stderr)
        while not _read(store, _is_predicted):
            time.sleep(PAUSE)
        return main(["tui", str(store)])
    rest = BackgroundDemo(options.out, _arguments(options))
    try:
        has_predictions = rest.wait_until(lambda: bool(_read(store, _is_predicted)))
    except BaseException:
        rest.stop()
        raise
    if not has_predictions:
        print(rest.last_line, file=sys.stderr)
        return 1
    code = main(["tui", str(store)])
    if rest.has_failed:
        print(rest.last_line, file=sys.stderr)
        return 1
    if rest.is_running:
        computing = _read(store, _computing) or "it is being computed"
        print(f"The demo is not complete: {computing} (see {rest.log}).")
        if not _is_confirmed("Go on in the background? [Y/n] "):
            rest.stop()
            print("stopped; the next `s2r demo` goes on")
    return code


def _is_being_completed(out: Path) -> bool:
    """Whether another process runs the stages of the demo in a folder."""
    from s2rstore.errors import StoreBusyError
    from s2rstore.files import locks

    try:
        with locks.file_lock(out / LOG, timeout=0.0):
            return False
    except StoreBusyError:
        return True


def _is_confirmed(question: str) -> bool:
    try:
        return input(question).strip().lower() in ("", "y", "yes")
    except (EOFError, KeyboardInterrupt):
        return False


def _arguments(options: argparse.Namespace) -> list[str]:
    """The options of the demo for the process that completes it."""
    named = {
        "--out": options.out, "--workers": options.workers, "--minutes": options.minutes,
        "--seed": options.seed, "--instances": options.instances, "--factors": options.factors,
        "--retrain": options.retrain, "--data": options.data,
    }  # fmt: skip
    if options.data is not None:
        del named["--seed"], named["--factors"]
    given = {name: str(value) for name, value in named.items() if value is not None}
    return [text for pair in given.items() for text in pair]


def _computing(store: Store) -> str:
    """The progress text of the process that completes the demo; empty if none runs."""
    from s2rstore.files import compute_progress

    progress = compute_progress.read(store.files)
    return "" if progress is None else progress.text


def _is_predicted(store: Store) -> bool:
    return bool(store.runs) and all(run.key is not None for run in store.runs.values())


def _check(options: argparse.Namespace) -> None:
    """Raise RequestError for options that a later stage would refuse."""
    if options.workers is not None and options.workers < 1:
        raise RequestError(f"--workers {options.workers}: must be at least 1")
    if options.minutes is not None and not 0 < options.minutes < 10_000:
        raise RequestError(f"--minutes {options.minutes:g}: must be more than 0")
    if options.data is not None:
        world = options.instances, options.retrain
        if options.seed != _PRETRAINED_SEED or options.factors != "all" or any(world):
            raise RequestError("--data: cannot be combined with options of the synthetic world")
        if not options.data.is_dir():
            raise RequestError(f"--data {options.data}: is not a folder")


def _world_stages(options: argparse.Namespace, store: Path) -> Iterator[_Stage]:
    """Yield the stages of the synthetic world; each is requested after the previous one is done."""
    path = str(store)
    world = ["--seed", str(options.seed)]
    world += ["--factors", options.factors] if options.factors != "all" else []
    if not store.exists():
        start_compiling()
        count = str(options.instances or INSTANCES)
        yield _Stage(("ingest", "world", *world, "--instances", count, "--store", path))
    _check_same_options(options, store, count=options.instances)
    if options.seed == _PRETRAINED_SEED and not _has_run(store, "vanilla"):
        yield _Stage(("model", "pretrained", "--store", path))
    if options.retrain or options.seed != _PRETRAINED_SEED:
        yield from _live_training(options, store, world)
    if not _read(store, _is_complete):
        yield _Stage(("precompute", path, *_workers(options)), is_late=True)
        scored = "--instances", str(_SCORED_INSTANCES), "--quiet"
        yield _Stage(("score", path, *scored), is_late=True, is_parallel=True)
    yield from _check_stages(store)
    if not _read(store, _has_suggestions):
        yield _Stage(("suggest", path, *_SUGGESTED), is_late=True, accepted=(0, _NOTHING_HELPS))


def _live_training(options: argparse.Namespace, store: Path, world: list[str]) -> Iterator[_Stage]:
    """Yield the stages that train a model on other views of the same world and register it."""
    if _has_run(store, QUICK):
        return
    training = options.out / TRAINING
    minutes = f"{options.minutes or _QUICK_MINUTES:g}"
    if not training.exists():
        views = ("--survey", str(_QUICK_VIEWS), "--instances", "0")
        yield _Stage(("ingest", "world", *world, *views, "--store", str(training)))
    _check_same_options(options, training, survey=_QUICK_VIEWS)
    if not _has_run(training, QUICK):
        budget = ("--minutes", minutes, "--name", QUICK)
        yield _Stage(("train", "--recipe", "vanilla", *budget, "--store", str(training)))
    digest = _read(training, lambda opened: opened.models[QUICK].sha256)
    weights = training / "models" / f"{digest}.safetensors"
    if not _read(store, lambda opened: QUICK in opened.models):
        added = ("model", "add", QUICK, str(weights), "--arch", "resposenet")
        yield _Stage((*added, "--store", str(store)))
    yield _Stage(("run", "add", QUICK, "--model", QUICK, "--store", str(store)))


_FACTORS = ("lights", "exposure", "sensor", "depth", "camera", "objects", "latency", "wheels")
_OPTIONS = {"count": "--instances", "survey": "--survey", "seed": "--seed", "factors": "--factors"}


def _check_same_options(options: argparse.Namespace, store: Path, **counts: int | None) -> None:
    from s2rstore.files.documents import parse_json

    recipe = _read(store, lambda opened: opened.provenance("world").get("recipe"))
    if recipe is None:
        raise RequestError(f"{store}: holds other data; choose another --out")
    try:
        stored = dict(parse_json(recipe, str(store)))
        factors = {name: float(v) for name, v in stored["factors"].items() if v}
    except (RequestError, ValueError, TypeError, KeyError, AttributeError) as error:
        raise RequestError(
            f"{store}: the recipe of the world is unreadable; choose another --out"
        ) from error
    stored["factors"] = factors
    requested = {**counts, "seed": options.seed, "factors": _severities(options.factors)}
    for name, value in requested.items():
        if value is not None and stored.get(name) != value:
            raise RequestError(
                f"{store}: was created with {_OPTIONS[name]} {_text(stored.get(name))}, "
                f"not {_text(value)}; choose another --out"
            )


def _severities(text: str) -> dict[str, float]:
    """Return the active factors; the usual case does not import the synthetic world."""
    if text == "all":
        return dict.fromkeys(_FACTORS, 1.0)
    from s2rtools.synthetic_world.factors import parse_factors

    return {name: value for name, value in parse_factors(text).items() if value}


def _text(value: object) -> str:
    if not isinstance(value, dict):
        return str(value)
    return ",".join(f"{name}={severity:g}" for name, severity in sorted(value.items())) or "none"


def _is_complete(store: Store) -> bool:
    """Return whether the store has a score that covers the current state of all runs."""
    try:
        scored = dict(store.provenance_object("score", "report").get("runs", {}))
    except (RequestError, ValueError, TypeError):
        return False
    return bool(store.runs) and all(
        run.key is not None and scored.get(run.run) == run.key for run in store.runs.values()
    )


def _has_suggestions(store: Store) -> bool:
    """Whether the store has suggestions for its first run."""
    from s2rstore.suggestions import section

    return bool(store.provenance(section(next(iter(store.runs)))))


def _training_summary(store: Store) -> str:
    from s2rstore.metrics.run_metrics import side_metrics

    real, sim = (side_metrics(store, QUICK, side) for side in ("real", "sim"))
    text = (
        f"trained by this demo: median error {sim.median_error:.2f} m in simulation, "
        f"{real.median_error:.2f} m in reality"
    )
    if "vanilla" in store.runs:
        error = side_metrics(store, "vanilla", "sim").median_error
        text += f"; pretrained vanilla, trained longer: {error:.2f} m in simulation"
    return text


def _data_stages(options: argparse.Namespace, store: Path) -> Iterator[_Stage]:
    path, data, minutes = str(store), str(options.data), f"{options.minutes or 1.5:g}"
    if not store.exists():
        yield _Stage(("ingest", "sim2realviz", data, "--store", path))
    runs: dict[str, tuple[str, ...]] = {
        recipe: ("train", "--recipe", recipe, *start, "--minutes", minutes)
        for recipe, start in (("vanilla", ()), ("dataaug", ()), ("perlin", ()),
                              ("finetune", ("--from", "dataaug")))
    }  # fmt: skip
    if _read(store, lambda opened: "sim_edit" in opened.domains):
        added = "run", "add", "dataaug-edit", "--model", "dataaug", "--sim", "sim_edit"
        runs["dataaug-edit"] = added
    adjustments = (("vanilla-bright", "real:brightness=1.15"), ("vanilla-black", "real:black"))
    for name, chain in adjustments:
        runs[name] = ("run", "add", name, "--model", "vanilla", "--adjust", chain)
    for name, arguments in runs.items():
        if not _has_run(store, name):
            yield _Stage((*arguments, "--store", path))
    yield _Stage(("precompute", path, *_workers(options)), is_late=True)
    yield from _check_stages(store)


def _check_stages(store: Path) -> Iterator[_Stage]:
    """Yield the stage that checks the images for faults, unless they have been checked."""
    if not _read(store, lambda opened: opened.checked_domains):
        yield _Stage(("check", str(store)), is_late=True)


def _workers(options: argparse.Namespace) -> list[str]:
    """The option for the number of worker processes, if one was given."""
    return [] if options.workers is None else ["--workers", str(options.workers)]


def _has_run(store: Path, run: str) -> bool:
    return bool(_read(store, lambda opened: run in opened.runs))


def _read(store: Path, query: Callable[[Store], Any]) -> Any:
    """Return the result of a query on a store; None if there is no store."""
    if not store.exists():
        return None
    with s2rstore.open(store) as opened:
        return query(opened)


def _export_pictures(out: Path, store: Path) -> None:
    """Write figures of the first run and a screenshot of the application."""
    for name, command, *options in (
        ("overview", "export", "--view", "overview"),
        ("geomap", "export", "--view", "geomap", "--select", "worst15"),
        ("instance", "export", "--view", "instance"),
        ("screen", "snapshot", "--size", "200x60"),
    ):
        path = str(out / f"{name}.png")
        if main([command, str(store), *options, "--out", path]) == 0:
            print(f"wrote {path}")

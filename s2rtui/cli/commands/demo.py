"""`s2r demo`: from nothing (or a folder of images) to findings, pictures and the application."""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from s2rstore.reader import Store

STORE = "demo.s2r"
WORLD = "world.s2r"
TRAINING = "training.s2r"
QUICK = "quick"
INSTANCES = 50
_KNOWN_WORLD = 1
_QUICK_VIEWS = 1500
_QUICK_MINUTES = 2.0
_SCORED = 48


@dataclass(frozen=True, slots=True)
class _Stage:
    """One command of the demo; skipped where `run` is already in the store."""

    words: tuple[str, ...]
    run: str | None = None


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--out", type=Path, default=Path("demo-out"),
                        help="folder for store and pictures (default demo-out)")  # fmt: skip
    parser.add_argument("--workers", type=int, default=1)
    parser.add_argument("--no-open", action="store_true", help="do not open the application")
    parser.add_argument("--minutes", type=float, help="per training (default 2; with --data 1.5)")
    world = parser.add_argument_group("the default world")
    world.add_argument("--seed", type=int, default=_KNOWN_WORLD,
                       help="which building; another than 1 is trained live")  # fmt: skip
    world.add_argument("--instances", type=int, help=f"on each trajectory (default {INSTANCES})")
    world.add_argument("--factors", default="all", help="as in s2r ingest world")
    world.add_argument(
        "--retrain", choices=(QUICK,), help="train one model live, beside the others"
    )
    data = parser.add_argument_group("your own images")
    data.add_argument("--data", type=Path, help="a folder in the Sim2RealViz layout (traj1/ ...)")


def execute(options: argparse.Namespace) -> int:
    import s2rstore
    from s2rstore.metrics import store_summary
    from s2rtui.cli import main

    _check(options)
    options.out.mkdir(parents=True, exist_ok=True)
    store = options.out / (STORE if options.data else WORLD)
    timings = []
    stages = _data_stages(options, store) if options.data else _world_stages(options, store)
    for stage in stages:
        if stage.run is not None and _has_run(store, stage.run):
            continue
        began = time.monotonic()
        print(f"$ s2r {' '.join(stage.words)}", file=sys.stderr)
        code = main(list(stage.words))
        if code:
            return code
        timings.append((" ".join(stage.words[:3]), time.monotonic() - began))
    with s2rstore.open(store) as opened:
        print("\n".join(store_summary.summary_lines(opened)))
        if QUICK in opened.runs:
            print(_worth(opened))
    opens = not options.no_open and sys.stdin.isatty() and sys.stdout.isatty()
    if timings or not opens:
        began = time.monotonic()
        _pictures(options.out, store)
        timings.append(("pictures", time.monotonic() - began))
    for what, seconds in [*timings, ("in all", sum(seconds for _, seconds in timings))]:
        print(f"{seconds:7.1f} s  {what}", file=sys.stderr)
    if not opens:
        print(f"open it with: s2r {store}")
        return 0
    return main(["tui", str(store)])


def _check(options: argparse.Namespace) -> None:
    """Raises RequestError for options that a later stage would refuse."""
    from s2rstore.errors import RequestError

    if options.workers < 1:
        raise RequestError("--workers: at least 1")
    if options.minutes is not None and not 0 < options.minutes < 10_000:
        raise RequestError("--minutes: more than 0")
    if options.data is not None:
        world = options.instances, options.retrain
        if options.seed != _KNOWN_WORLD or options.factors != "all" or any(world):
            raise RequestError("--data: takes no options of the default world")
        if not options.data.is_dir():
            raise RequestError(f"--data {options.data}: no such folder")


def _world_stages(options: argparse.Namespace, store: Path) -> Iterator[_Stage]:
    """The default world; each stage is asked for when those before it are done."""
    path = str(store)
    world = ["--seed", str(options.seed)]
    world += ["--factors", options.factors] if options.factors != "all" else []
    if not store.exists():
        count = str(options.instances or INSTANCES)
        words = ("ingest", "world", *world, "--instances", count, "--store", path)
        yield _Stage(words)
    _refuse_other(options, store, count=options.instances)
    if options.seed == _KNOWN_WORLD and not _has_run(store, "vanilla"):
        yield _Stage(("model", "shipped", "--store", path))
    if options.retrain or options.seed != _KNOWN_WORLD:
        yield from _live_training(options, store, world)
    if not _asked(store, _is_complete):
        yield _Stage(("precompute", path, "--workers", str(options.workers)))
        yield _Stage(("score", path, "--instances", str(_SCORED), "--quiet"))


def _live_training(options: argparse.Namespace, store: Path, world: list[str]) -> Iterator[_Stage]:
    """Train a model on views of its own of the same world, and take it over."""
    if _has_run(store, QUICK):
        return
    training = options.out / TRAINING
    minutes = f"{options.minutes or _QUICK_MINUTES:g}"
    if not training.exists():
        views = ("--survey", str(_QUICK_VIEWS), "--instances", "0")
        yield _Stage(("ingest", "world", *world, *views, "--store", str(training)))
    _refuse_other(options, training, survey=_QUICK_VIEWS)
    if not _has_run(training, QUICK):
        budget = ("--minutes", minutes, "--name", QUICK)
        yield _Stage(("train", "--recipe", "vanilla", *budget, "--store", str(training)))
    digest = _asked(training, lambda opened: opened.models[QUICK].sha256)
    weights = training / "models" / f"{digest}.safetensors"
    if not _asked(store, lambda opened: QUICK in opened.models):
        words = ("model", "add", QUICK, str(weights), "--arch", "resposenet", "--store", str(store))
        yield _Stage(words)
    yield _Stage(("run", "add", QUICK, "--model", QUICK, "--store", str(store)))


_FACTORS = (
    "lights", "exposure", "sensor", "depth", "camera", "objects", "latency", "wheels",
)  # fmt: skip
_OPTIONS = {"count": "--instances", "survey": "--survey", "seed": "--seed", "factors": "--factors"}


def _refuse_other(options: argparse.Namespace, store: Path, **asked: int | None) -> None:
    """Raises RequestError where a store was not made by the options of now."""
    from s2rstore.errors import RequestError
    from s2rstore.files.input_files import parse_json

    noted = _asked(store, lambda opened: opened.provenance("world").get("recipe"))
    if noted is None:
        raise RequestError(f"{store}: holds other data; choose another --out")
    try:
        held = dict(parse_json(noted, str(store)))
        severities = held["factors"] = {name: float(v) for name, v in held["factors"].items() if v}
    except (RequestError, ValueError, TypeError, KeyError, AttributeError) as error:
        raise RequestError(f"{store}: its note on the world's recipe makes no sense") from error
    wanted = {**asked, "seed": options.seed, "factors": _severities(options.factors)}
    for name, value in wanted.items():
        if value is not None and held.get(name) != value:
            told = _text(severities) if name == "factors" else held.get(name)
            raise RequestError(
                f"{store}: was made with {_OPTIONS[name]} {told}, not {_text(value)}; "
                "choose another --out"
            )


def _severities(text: str) -> dict[str, float]:
    """The active factors; without importing the world for the usual case."""
    if text == "all":
        return dict.fromkeys(_FACTORS, 1.0)
    from s2rtools.synthetic_world.factors import parse_factors

    return {name: value for name, value in parse_factors(text).items() if value}


def _text(value: object) -> str:
    if not isinstance(value, dict):
        return str(value)
    return ",".join(f"{name}={severity:g}" for name, severity in sorted(value.items())) or "none"


def _is_complete(store: Store) -> bool:
    """Whether the score that the store keeps is of all runs as they are."""
    from s2rstore.errors import RequestError

    try:
        noted = dict(store.provenance_object("score", "report").get("runs", {}))
    except (RequestError, ValueError, TypeError):
        return False
    return bool(store.runs) and all(
        run.key is not None and noted.get(run.run) == run.key for run in store.runs.values()
    )


def _worth(store: Store) -> str:
    """What the live training is worth, in a line."""
    from s2rstore.metrics.run_metrics import side_metrics

    real, sim = (side_metrics(store, QUICK, side) for side in ("real", "sim"))
    told = (
        f"trained live: median error {sim.median_error:.2f} m in simulation, "
        f"{real.median_error:.2f} m in reality"
    )
    if "vanilla" in store.runs:
        shipped = side_metrics(store, "vanilla", "sim")
        told += f"; the shipped vanilla, trained longer, {shipped.median_error:.2f} m in simulation"
    return told


def _data_stages(options: argparse.Namespace, store: Path) -> Iterator[_Stage]:
    path, data, minutes = str(store), str(options.data), f"{options.minutes or 1.5:g}"
    if not store.exists():
        yield _Stage(("ingest", "sim2realviz", data, "--store", path))
    for recipe, start in (("vanilla", ()), ("dataaug", ()), ("perlin", ()),
                          ("finetune", ("--from", "dataaug"))):  # fmt: skip
        words = ("train", "--recipe", recipe, *start, "--minutes", minutes, "--store", path)
        yield _Stage(words, recipe)
    if _asked(store, lambda opened: "sim_edit" in opened.domains):
        words = ("run", "add", "dataaug-edit", "--model", "dataaug", "--sim", "sim_edit")
        yield _Stage((*words, "--store", path), "dataaug-edit")
    adjusted = (("vanilla-bright", "real:brightness=1.15"), ("vanilla-black", "real:black"))
    for name, chain in adjusted:
        words = ("run", "add", name, "--model", "vanilla", "--adjust", chain, "--store", path)
        yield _Stage(words, name)
    yield _Stage(("precompute", path, "--workers", str(options.workers)))


def _has_run(store: Path, run: str) -> bool:
    return bool(_asked(store, lambda opened: run in opened.runs))


def _asked(store: Path, question: Callable[[Store], Any]) -> Any:
    """What a store answers; None where there is none."""
    import s2rstore

    if not store.exists():
        return None
    with s2rstore.open(store) as opened:
        return question(opened)


def _pictures(out: Path, store: Path) -> None:
    """The figures of the first run, and the screen as the application shows it."""
    from s2rtui.cli import main

    views: list[tuple[str, ...]] = [
        ("export", "--view", "overview", "--out", str(out / "overview.png")),
        ("export", "--view", "geomap", "--select", "worst15", "--out", str(out / "geomap.png")),
        ("export", "--view", "instance", "--out", str(out / "instance.png")),
        ("snapshot", "--size", "200x60", "--out", str(out / "screen.png")),
    ]
    for words in views:
        if main([words[0], str(store), *words[1:]]) == 0:
            print(f"wrote {words[-1]}")

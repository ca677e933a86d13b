"""`s2r demo`: from a folder of paired images to findings, pictures and the application."""

from __future__ import annotations

import argparse
import sys
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

STORE = "demo.s2r"


@dataclass(frozen=True, slots=True)
class _Stage:
    """One command of the demo; skipped where `run` is already in the store."""

    words: tuple[str, ...]
    run: str | None = None


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--data", type=Path, required=True,
                        help="a folder in the Sim2RealViz layout (it holds traj1/)")  # fmt: skip
    parser.add_argument("--out", type=Path, default=Path("demo-out"))
    parser.add_argument("--minutes", type=float, default=1.5, help="per training (default 1.5)")
    parser.add_argument("--workers", type=int, default=1)
    parser.add_argument("--no-open", action="store_true", help="do not open the application")


def execute(options: argparse.Namespace) -> int:
    import s2rstore
    from s2rstore import findings
    from s2rtui.cli import main

    options.out.mkdir(parents=True, exist_ok=True)
    store = options.out / STORE
    timings = []
    for stage in _stages(options, store):
        if stage.run is not None and _has_run(store, stage.run):
            continue
        began = time.monotonic()
        print(f"$ s2r {' '.join(stage.words)}", file=sys.stderr)
        code = main(list(stage.words))
        if code:
            return code
        timings.append((" ".join(stage.words[:3]), time.monotonic() - began))
    with s2rstore.open(store) as opened:
        print("\n".join(findings.lines(opened)))
    _pictures(options.out, store)
    for what, seconds in timings:
        print(f"{seconds:7.1f} s  {what}", file=sys.stderr)
    if options.no_open or not (sys.stdin.isatty() and sys.stdout.isatty()):
        print(f"open it with: s2r {store}")
        return 0
    return main(["tui", str(store)])


def _stages(options: argparse.Namespace, store: Path) -> list[_Stage]:
    path, data, minutes = str(store), str(options.data), f"{options.minutes:g}"
    stages = []
    if not store.exists():
        stages.append(_Stage(("ingest", "sim2realviz", data, "--store", path)))
    for recipe, start in (("vanilla", ()), ("dataaug", ()), ("perlin", ()),
                          ("finetune", ("--from", "dataaug"))):  # fmt: skip
        words = ("train", "--recipe", recipe, *start, "--minutes", minutes, "--store", path)
        stages.append(_Stage(words, recipe))
    if (options.data / "traj1" / "sim_edit").is_dir() or _has_domain(store, "sim_edit"):
        words = ("run", "add", "dataaug-edit", "--model", "dataaug", "--sim", "sim_edit")
        stages.append(_Stage((*words, "--store", path), "dataaug-edit"))
    adjusted = (("vanilla-bright", "real:brightness=1.15"), ("vanilla-black", "real:black"))
    for name, chain in adjusted:
        words = ("run", "add", name, "--model", "vanilla", "--adjust", chain, "--store", path)
        stages.append(_Stage(words, name))
    stages.append(_Stage(("precompute", path, "--workers", str(options.workers))))
    return stages


def _has_run(store: Path, run: str) -> bool:
    return _asked(store, lambda opened: run in opened.runs)


def _has_domain(store: Path, domain: str) -> bool:
    return _asked(store, lambda opened: domain in opened.domains)


def _asked(store: Path, question: Any) -> bool:
    import s2rstore

    if not store.exists():
        return False
    with s2rstore.open(store) as opened:
        return bool(question(opened))


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

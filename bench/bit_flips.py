"""Flip bits of a store and search for changes that `s2r verify` does not report.

    python -m bench.bit_flips STORE                every bit of every file: days for a large store
    python -m bench.bit_flips STORE --sample 500   500 seeded flips, spread evenly over the files

Works on a copy. After each flip `verify` must report damage. Otherwise everything that can be read
through the store (tables, frames, arrays, floor plan, drives, weights, gap history) must be
unchanged or fail with an error. Exits with 1 if a flip changes data silently.
"""

from __future__ import annotations

import argparse
import hashlib
import random
import shutil
import sys
import tempfile
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np
from PIL import Image

import s2rstore
from s2rstore.errors import RequestError
from s2rstore.files import layout, safe_files
from s2rstore.gap_history import reader
from s2rstore.index import schema
from s2rstore.maintenance.verify import verify
from s2rstore.reader import Store

Outcome = Literal["found", "refused", "without effect", "silent"]
Figures = dict[str, str]

_EVERY_BYTE = 4096
"""Files up to this size are sampled as often as all others together."""


@dataclass(frozen=True, slots=True)
class Flip:
    """One bit of one file."""

    path: str
    byte: int
    bit: int


def main() -> int:
    parser = argparse.ArgumentParser(prog="python -m bench.bit_flips", description=__doc__)
    parser.add_argument("store", type=Path)
    parser.add_argument("--sample", type=int, help="this many flips (default: every bit)")
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        root = Path(shutil.copytree(options.store, Path(folder) / "copy.s2r", symlinks=True))
        flips = sampled(root, options.sample, options.seed) if options.sample else every_bit(root)
        counts: Counter[Outcome] = Counter()
        for flip, outcome in outcomes(root, flips):
            counts[outcome] += 1
            if outcome == "silent":
                print(f"silent: {flip.path}, byte {flip.byte}, bit {flip.bit}", flush=True)
    print(", ".join(f"{count} {outcome}" for outcome, count in counts.items()))
    return 1 if counts["silent"] else 0


def every_bit(root: Path, paths: Callable[[str], bool] = lambda path: True) -> Iterator[Flip]:
    """Every bit of the selected files."""
    for path, size in files(root):
        if paths(path):
            yield from (Flip(path, byte, bit) for byte in range(size) for bit in range(8))


def sampled(root: Path, count: int, seed: int) -> list[Flip]:
    """Random flips; half of them in small files, which describe the large ones."""
    rng = random.Random(seed)
    found = [(path, size) for path, size in files(root) if size]
    small = [each for each in found if each[1] <= _EVERY_BYTE] or found
    flips = []
    for number in range(count):
        path, size = rng.choice(small if number % 2 else found)
        flips.append(Flip(path, rng.randrange(size), rng.randrange(8)))
    return flips


def files(root: Path) -> list[tuple[str, int]]:
    """All files except locks, with their sizes."""
    return [
        (entry.path, entry.bytes)
        for entry in safe_files.walk(root)
        if entry.kind == "file" and not entry.path.endswith(".lock")
    ]


def outcomes(root: Path, flips: Iterator[Flip] | list[Flip]) -> Iterator[tuple[Flip, Outcome]]:
    """The outcome of each flip; the store is restored after each."""
    before = figures(root)
    for flip in flips:
        file = root / flip.path
        with file.open("r+b") as opened:
            _toggle(opened, flip)
        try:
            outcome = _outcome(root, before)
        finally:
            with file.open("r+b") as opened:
                _toggle(opened, flip)
        yield flip, outcome


def _toggle(opened: Any, flip: Flip) -> None:
    opened.seek(flip.byte)
    (value,) = opened.read(1)
    opened.seek(flip.byte)
    opened.write(bytes([value ^ 1 << flip.bit]))


def _outcome(root: Path, before: Figures) -> Outcome:
    try:
        if verify(root):
            return "found"
        after = figures(root)
    except RequestError:
        return "refused"
    changed = [name for name in before.keys() | after.keys() if before.get(name) != after.get(name)]
    if not changed:
        return "without effect"
    return "refused" if all(after.get(n, "").startswith("refused") for n in changed) else "silent"


def figures(root: Path) -> Figures:
    """Digests of everything that can be read through the store, by name."""
    found: Figures = {}

    def add(name: str, read: Callable[[], bytes]) -> None:
        try:
            found[name] = hashlib.sha256(read()).hexdigest()
        except RequestError as error:
            found[name] = f"refused: {error}"

    with s2rstore.open(root) as store:
        for table in schema.TABLES:
            add(f"table {table.name}", lambda name=table.name: _rows(store, name))
        for domain in store.domains:
            for iid in range(len(store.instances)):
                add(f"frame {domain} {iid}", lambda d=domain, i=iid: _frame(store, d, i))
        for run in store.runs:
            for record in store.array_parts(run):
                add(f"array {record.path}", lambda r=record: store.stored(r)[:].tobytes())
        add("floor plan", lambda: _floor_plan(store))
        for model in store.models.values():
            add(f"weights {model.model}", lambda sha=model.sha256: _weights(root, sha))
    add("drives", lambda: _folder(root, layout.DRIVES))
    add("history", lambda: repr(_history(root)).encode())
    return found


def _rows(store: Store, table: str) -> bytes:
    return repr(store.execute(f'SELECT * FROM "{table}" ORDER BY ALL')).encode()


def _frame(store: Store, domain: str, iid: int) -> bytes:
    frame = store.frame(domain, iid)
    return b"".join(np.ascontiguousarray(part).tobytes() for part in (frame.rgb, frame.depth))


def _floor_plan(store: Store) -> bytes:
    path = store.floor_plan_path()
    if path is None:
        return b""
    try:
        with Image.open(path) as image:
            return image.convert("RGB").tobytes()
    except (OSError, ValueError, SyntaxError) as error:
        raise RequestError(f"{path}: {error}") from error


def _weights(root: Path, sha256: str) -> bytes:
    lying = safe_files.names(root, layout.MODELS)
    found = [each.path for each in lying if each.name.startswith(f"{sha256}.")]
    return b"".join(safe_files.read(root, path) for path in found)


def _folder(root: Path, folder: str) -> bytes:
    parts = [
        entry.path.encode() + safe_files.read(root, entry.path)
        for entry in safe_files.walk(root, folder)
        if entry.kind == "file"
    ]
    return b"\0".join(parts)


def _history(root: Path) -> list[Any]:
    path = reader.history_path(root)
    if not path.exists():
        return []
    found = reader.read(path)
    measured = sorted({night.measured for night in found.nights})
    reports = [reader.report_text(path, number) for number in measured]
    return [found.nights, reports]


if __name__ == "__main__":
    sys.exit(main())

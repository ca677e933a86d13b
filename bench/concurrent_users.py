"""Many concurrent users over SSH on a copy of a store: `python -m bench.concurrent_users STORE`.

Every user repeatedly presses a seeded random key, waits for the screen and pauses. With `--publish`
a precompute publishes new generations at the same time. At the end every screen is drawn from the
received bytes and checked for errors.
"""

from __future__ import annotations

import argparse
import json
import os
import random
import shutil
import statistics
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import s2rstore
from bench.budget import BudgetRow
from bench.support import processes, sshd
from bench.support.replay import replay
from bench.support.screen import LEFT, RIGHT, Screen

KEYS = (
    "w", "b", "W", "B", "c", "u", RIGHT, LEFT, "n", "p", "r", "R", "h", "v", "o", "d", "m", "C",
    "+", "0", "1", "2", "3", "4", "5", "6", "7", "8", "\t", "g",
)  # fmt: skip
ALWAYS_SEEN = ("m",)
SIZE = (120, 40)
_ENVIRONMENT = {"COLORTERM": "truecolor"}
_QUIET = 0.05
_REST = 0.4
_PATIENCE = 10.0
_PAUSES = (0.2, 1.4)
_SAMPLE_SECONDS = 10.0
_KIND = "feature_distance"


@dataclass
class User:
    """One terminal and its measurements (seconds, bytes)."""

    screen: Screen
    rng: random.Random
    latencies: list[float] = field(default_factory=list)
    ends: list[int] = field(default_factory=list)
    pressed: int = 0
    errors: list[str] = field(default_factory=list)

    def work(self, until: float) -> None:
        """Press keys until a deadline."""
        while time.monotonic() < until:
            if self.screen.code is not None:
                self.errors.append(f"ended with {self.screen.code}")
                return
            self._press(self.rng.choice(KEYS))
            time.sleep(self.rng.uniform(*_PAUSES))

    def _press(self, key: str | bytes) -> None:
        before, number = self.screen.received, len(self.screen.arrivals)
        began = time.monotonic()
        self.screen.press(key)
        self.pressed += 1
        if self.screen.wait_for_bytes(before, _PATIENCE if key in ALWAYS_SEEN else 1.5):
            self._settle()
            self.latencies.append(self._drawn(number) - began)
        elif key in ALWAYS_SEEN:
            self.errors.append(f"{key!r}: no answer in {_PATIENCE:g} s")
        self.ends.append(self.screen.received)

    def _settle(self) -> None:
        """Wait until no bytes arrive any more; images follow when the cursor rests."""
        received = -1
        while received != self.screen.received:
            received = self.screen.received
            self.screen.wait_for_bytes(received, _REST)

    def _drawn(self, number: int) -> float:
        """Time at which the first burst of bytes is complete."""
        times = [at for at, _ in self.screen.arrivals[number:]]
        last = times[0]
        for at in times:
            if at - last > _QUIET:
                break
            last = at
        return last

    def leave(self) -> None:
        """Quit and check everything that was drawn."""
        for key in (b"\x1b", "q"):
            time.sleep(0.5)
            if self.screen.code is None:
                self.screen.press(key)
        try:
            code = self.screen.wait_for_end(30)
        except AssertionError:
            self.errors.append("does not end")
        else:
            self.errors += [f"ended with {code}"] if code else []
        self.screen.close()
        self.errors += replay(bytes(self.screen.raw), self.ends, SIZE)


@dataclass
class Samples:
    """Memory and processor time of the remote processes, sampled periodically."""

    memory: dict[int, int] = field(default_factory=dict)
    processor: dict[int, float] = field(default_factory=dict)

    def take(self, server: sshd.Sshd) -> None:
        for pid in processes.applications_below(server.pid):
            self.memory[pid] = max(self.memory.get(pid, 0), processes.proportional_bytes(pid))
            self.processor[pid] = processes.processor_seconds(pid)


class Publisher:
    """Repeatedly adds a run and computes it, until it is stopped."""

    def __init__(self, store: Path, pause: float) -> None:
        self._store, self._pause = store, pause
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._work)
        self.published = 0
        self.errors: list[str] = []

    def start(self) -> None:
        self._thread.start()

    def stop(self) -> None:
        self._stop.set()
        if self._thread.is_alive():
            self._thread.join()

    def _work(self) -> None:
        with s2rstore.open(self._store) as store:
            model = next(iter(store.runs.values())).model
        while not self._stop.wait(self._pause):
            name = f"bench{self.published}"
            value = f"real:brightness={1 + (self.published + 1) / 100:g}"
            store_option = ("--store", str(self._store))
            self._s2r("run", "add", name, "--model", model, "--adjust", value, *store_option)
            self._s2r("precompute", str(self._store), "--run", name, "--kinds", _KIND)
            self.published += 1

    def _s2r(self, *words: str) -> None:
        done = subprocess.run(
            [sys.executable, "-m", "s2rtui", *words], capture_output=True, text=True
        )
        if done.returncode:
            self.errors.append(done.stderr.strip())


def measure(
    store: Path, users: int, seconds: float, seed: int, pause: float
) -> Iterator[BudgetRow]:
    """The measurements; with `pause` 0 nothing is published."""
    folder = Path(tempfile.mkdtemp())
    try:
        copy = Path(shutil.copytree(store, folder / store.name))
        server = sshd.start(folder / "sshd", copy)
        try:
            yield from _measured(server, copy, users, seconds, seed, pause)
        finally:
            server.stop()
    finally:
        shutil.rmtree(folder)


def _measured(
    server: sshd.Sshd, store: Path, users: int, seconds: float, seed: int, pause: float
) -> Iterator[BudgetRow]:
    present = _entered(server, store, users, seed)
    first_paint = statistics.median(user.screen.received for user in present)
    until = time.monotonic() + seconds
    threads = [threading.Thread(target=user.work, args=(until,)) for user in present]
    samples, publisher = Samples(), Publisher(store, pause)
    if pause:
        publisher.start()
    for thread in threads:
        thread.start()
    while any(thread.is_alive() for thread in threads):
        samples.take(server)
        time.sleep(min(_SAMPLE_SECONDS, max(0.1, until - time.monotonic())))
    publisher.stop()
    received = sum(user.screen.received for user in present) - first_paint * users
    for user in present:
        user.leave()
    errors = [error for user in present for error in user.errors] + publisher.errors
    for error in errors[:20]:
        print(error, file=sys.stderr)
    yield BudgetRow("many: errors", len(errors), "", 0)
    yield BudgetRow("many: users", users, "")
    yield BudgetRow("many: minutes", seconds / 60, "min")
    yield BudgetRow("many: generations published", publisher.published, "")
    yield BudgetRow("many: bytes until the first screen rests", first_paint, "bytes")
    yield from _of_keys(present, received)
    yield from _of_processes(samples, seconds)


def _entered(server: sshd.Sshd, store: Path, users: int, seed: int) -> list[User]:
    """Start all users and wait for their first screens."""
    command = server.login(*sshd.application(store))
    present = [
        User(Screen(command, SIZE, _ENVIRONMENT, draws=False), random.Random(seed + number))
        for number in range(users)
    ]
    for user in present:
        if not user.screen.wait_for_bytes(1000, 60):
            raise SystemExit(
                f"the application did not start: {bytes(user.screen.raw).decode(errors='replace')}"
            )
    time.sleep(5)
    return present


def _of_keys(present: Sequence[User], received: float) -> Iterator[BudgetRow]:
    pressed = sum(user.pressed for user in present)
    latencies = sorted(1000 * value for user in present for value in user.latencies)
    yield BudgetRow("many: keys pressed", pressed, "")
    yield BudgetRow("many: keys that changed the screen", len(latencies), "")
    if len(latencies) > 1:
        quantiles = statistics.quantiles(latencies, n=100)
        yield BudgetRow("many: key to screen, median", statistics.median(latencies), "ms")
        yield BudgetRow("many: key to screen, 95 %", quantiles[94], "ms")
        yield BudgetRow("many: key to screen, 99 %", quantiles[98], "ms")
    yield BudgetRow("many: bytes per key, with pictures", received / max(1, pressed), "bytes")


def _of_processes(samples: Samples, seconds: float) -> Iterator[BudgetRow]:
    memory = [value / 1e6 for value in samples.memory.values()]
    processor = [100 * value / seconds for value in samples.processor.values()]
    if memory:
        yield BudgetRow("many: memory per user (PSS), mean", statistics.mean(memory), "MB")
        yield BudgetRow("many: memory per user (PSS), largest", max(memory), "MB")
        yield BudgetRow("many: processor per user, mean", statistics.mean(processor), "%")


def main() -> int:
    parser = argparse.ArgumentParser(prog="python -m bench.concurrent_users", description=__doc__)
    parser.add_argument("store", type=Path, help="a computed store; it is copied")
    parser.add_argument("--users", type=int, default=8)
    parser.add_argument("--minutes", type=float, default=10.0)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument(
        "--publish", type=float, default=0.0, metavar="SECONDS",
        help="publish a new run again and again, with this pause between",
    )  # fmt: skip
    parser.add_argument("--json", action="store_true", help="one JSON object per line")
    options = parser.parse_args()
    os.environ.setdefault("OMP_NUM_THREADS", "1")
    missing = sshd.missing_program()
    if missing:
        parser.error(f"{missing} is not installed (Debian: openssh-server, openssh-client)")
    failed = 0
    seconds = 60 * options.minutes
    for figure in measure(options.store, options.users, seconds, options.seed, options.publish):
        failed += not figure.ok
        text = json.dumps(figure.as_json()) if options.json else _line(figure)
        print(text, flush=True)
    return 1 if failed else 0


def _line(figure: BudgetRow) -> str:
    return f"{figure.name:<45} {figure.value:10.4g} {figure.unit}"


if __name__ == "__main__":
    sys.exit(main())

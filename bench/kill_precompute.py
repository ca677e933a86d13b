"""`python -m bench.kill_precompute STORE`: kill -9 a precompute at 30 random moments, then compare.

STORE is copied; its runs are computed twice, once without interruption. Prints one line per kill
and exits with 1 if any result differs.
"""

from __future__ import annotations

import argparse
import random
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

import s2rstore
from s2rstore.files import layout
from s2rstore.maintenance.verify import verify


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("store", type=Path, help="a store whose runs are not computed yet")
    parser.add_argument("--times", type=int, default=30)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--longest", type=float, default=12.0, help="seconds before a kill")
    options = parser.parse_args()
    folder = Path(tempfile.mkdtemp())
    try:
        calm, killed = folder / "calm.s2r", folder / "killed.s2r"
        for path in (calm, killed):
            shutil.copytree(options.store, path)
        subprocess.run(_command(calm), check=True, stderr=subprocess.DEVNULL)
        rng = random.Random(options.seed)
        for number in range(options.times):
            _kill_once(killed, number, rng.uniform(0.1, options.longest))
        subprocess.run(_command(killed), check=True, stderr=subprocess.DEVNULL)
        return _compare(calm, killed)
    finally:
        shutil.rmtree(folder)


def _command(path: Path) -> list[str]:
    return [sys.executable, "-m", "s2rtui", "precompute", str(path)]


def _kill_once(path: Path, number: int, after: float) -> None:
    process = subprocess.Popen(_command(path), stderr=subprocess.DEVNULL)
    time.sleep(after)
    process.send_signal(signal.SIGKILL)
    process.wait()
    generation = layout.read_current(path).generation
    damage = verify(path)
    with s2rstore.open(path) as store:
        count = store.execute("SELECT count(*) FROM prediction")[0][0]
    files = sum(1 for p in (path / "runs.zarr").rglob("*") if p.is_file())
    state = f"generation {generation}, {count} predictions, {files} array files"
    print(f"kill {number + 1:2d} after {after:5.2f} s: {state}, {len(damage)} damages", flush=True)
    if damage:
        raise SystemExit(f"damage: {damage[0]}")


def _compare(calm: Path, killed: Path) -> int:
    wrong = [f"verify: {found}" for found in verify(killed)]
    with s2rstore.open(calm) as a, s2rstore.open(killed) as b:
        for run in a.runs:
            for record in a.array_parts(run):
                names = record.kind, record.side, record.mode
                left, right = (np.asarray(s.array(run, *names)[1][:]) for s in (a, b))
                if not np.array_equal(left, right, equal_nan=True):
                    wrong.append(f"{run} {names} differs")
        query = "SELECT * FROM pair ORDER BY run, iid"
        if a.execute(query) != b.execute(query):
            wrong.append("table rows differ")
    print("\n".join(wrong) or "the killed store equals the undisturbed one; verify finds nothing")
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())

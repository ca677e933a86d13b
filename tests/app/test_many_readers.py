"""Two applications and a script read a store consistently while a precompute publishes to it."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

import s2rstore
from s2rstore.maintenance.verify import verify
from s2rtui.cli import main
from tests.support.copies import copy_store

_APPLICATION = """
import asyncio, faulthandler, sys
from pathlib import Path
from s2rtui.app.app import S2RApp
from s2rtui.jobs.background_thread import end_process
from s2rtui.canvas import RenderOptions
from s2rtui.app.pilot import settle
from s2rtui.session import Session
async def main(path, stop):
    app = S2RApp(Session(path), RenderOptions())
    app.load_scheduler.debounce_seconds = 0.001
    seen = set()
    async with app.run_test(size=(120, 40)) as pilot:
        while not stop.exists():
            for key in ("w", "right", "h", "o", "r", "g"):
                await pilot.press(key)
                await asyncio.sleep(0.2)
            await settle(app, pilot)
            state = app.session.state
            assert not state.is_error, state.message
            assert " of 40" in state.count, state.count
            if not seen:
                print("reading", flush=True)
            seen.add(state.generation)
    print(sorted(seen))
faulthandler.enable()
asyncio.run(main(Path(sys.argv[1]), Path(sys.argv[2])))
end_process(0)
"""


@pytest.mark.deep
def test_readers_while_a_precompute_publishes(trained_store: Path, tmp_path: Path) -> None:
    path, stop = copy_store(trained_store, tmp_path / "s.s2r"), tmp_path / "stop"
    precompute = ["precompute", str(path), "--kinds", "feature_distance"]
    add = ["run", "add", "--store", str(path), "--model", "vanilla"]
    environment = {**os.environ, "PYTHONPATH": os.getcwd()}
    assert main(precompute) == 0
    for number in range(2):
        chain = ["--adjust", f"real:brightness=1.{number + 1}", f"more{number}"]
        assert main([*add, *chain]) == 0
    readers = [
        subprocess.Popen(
            [sys.executable, "-c", _APPLICATION, str(path), str(stop)],
            stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, env=environment,
        )
        for _ in range(2)
    ]  # fmt: skip
    for reader in readers:
        assert reader.stdout is not None
        assert reader.stdout.readline() == "reading\n"
    writer = subprocess.Popen([sys.executable, "-m", "s2rtui", *precompute])
    counts = set()
    while writer.poll() is None:
        with s2rstore.open(path) as store:
            rows = store.execute("SELECT run, count(*) FROM pair GROUP BY run")
            assert all(count == 40 for _, count in rows)
            assert {run for run, _ in rows} == {n for n, r in store.runs.items() if r.key}
            counts.add(len(rows))
    assert writer.returncode == 0
    stop.touch()
    for reader in readers:
        out, err = _output(reader)
        assert reader.returncode == 0, err
        assert len(out.split(",")) >= 2, out
    assert len(counts) >= 2
    assert verify(path) == []


def _output(reader: subprocess.Popen[str]) -> tuple[str, str]:
    """The output of a process; a process that does not exit is aborted with a stack dump."""
    try:
        return reader.communicate(timeout=120)
    except subprocess.TimeoutExpired:
        reader.send_signal(signal.SIGABRT)
        return reader.communicate(timeout=10)

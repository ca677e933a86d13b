"""`verify` detects every kind of damage and reports none in an intact store."""

import json
import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

import s2rstore
from bench import bit_flips
from s2rstore.errors import RequestError
from s2rstore.files import ledger
from s2rstore.index import schema
from s2rstore.index.transaction import edit
from s2rstore.maintenance.verify import verify
from s2rtui.cli import main
from tests.conftest import BuildOnce
from tests.support.copies import copy_store
from tests.support.ingested import build_ingested_store


@pytest.fixture
def store(build_once: BuildOnce, tmp_path: Path) -> Path:
    """An ingested store with floor plan, drives and weights."""
    return copy_store(build_once("ingested.s2r", build_ingested_store), tmp_path / "own.s2r")


CHECKED_FILES = (
    "drives/one/real.csv", "drives/one/sim.csv", "drives/two/untuned.csv",
    "drives/two/commands.csv", "assets/floor_plan.png", "frames.zarr/sim/traj1/rgb/zarr.json",
    "frames.zarr/real/traj1/depth/zarr.json", f"models/{'a' * 64}.safetensors",
)  # fmt: skip


def test_flipped_bits_and_removed_files_are_detected(store):
    assert verify(store) == []
    for path in CHECKED_FILES:
        content = (store / path).read_bytes()
        flipped = bytearray(content)
        flipped[len(flipped) // 2] ^= 1 << 5
        (store / path).write_bytes(flipped)
        damages = verify(store)
        assert [each for each in damages if each.where in path or path in each.where], path
        (store / path).unlink()
        assert verify(store), path
        (store / path).write_bytes(content)


def test_no_flipped_bit_changes_results_undetected(store):
    flips = bit_flips.sampled(store, 20, seed=1)
    outcomes = list(bit_flips.outcomes(store, flips))
    assert [flip for flip, outcome in outcomes if outcome == "silent"] == []
    assert sum(outcome == "found" for _, outcome in outcomes) > 18


def test_flipped_bits_of_the_current_file_are_detected(store):
    flips = list(bit_flips.every_bit(store, lambda path: path == "CURRENT.json"))
    outcomes = list(bit_flips.outcomes(store, flips[::127]))
    assert [flip for flip, outcome in outcomes if outcome == "silent"] == []


def test_readers_check_metadata_when_they_open_an_array(store):
    path = store / "frames.zarr/sim/traj1/rgb/zarr.json"
    document = json.loads(path.read_text())
    path.write_text(json.dumps(document))
    with s2rstore.open(store) as opened, pytest.raises(RequestError, match="metadata"):
        opened.frame("sim", 0)
    assert verify(store)


def _change_entries(root: Path, change: Callable[[dict[str, object]], None]) -> None:
    for file in (root / "ledger").glob("*.jsonl"):
        lines = [json.loads(line) for line in file.read_text().splitlines()]
        for line in lines:
            change(line)
        file.write_text("".join(json.dumps(line) + "\n" for line in lines))


def test_a_wrong_row_count_in_the_ledger_is_detected(store_copy):
    _change_entries(store_copy, lambda entry: entry.update(count=7))
    assert verify(store_copy)


@pytest.mark.parametrize(
    "line", ["[]", "[" * 5000, '{"key": 1}', "\0", "null"],
    ids=["list", "nested", "object", "NUL", "null"],
)  # fmt: skip
def test_an_unreadable_ledger_line_is_ignored(store_copy, line):
    file = next((store_copy / "ledger").glob("*.jsonl"))
    lines = file.read_text().splitlines()
    lines[0] = line
    file.write_text("\n".join(lines) + "\n")
    assert any("no ledger entry" in damage.what for damage in verify(store_copy))


@pytest.mark.parametrize("factor", [1e3, 1e150])
def test_large_predictions_are_not_damage(store_copy, factor):
    """For example those of a model that predicts millimetres."""
    with edit(store_copy) as draft:
        run = draft._connection.execute
        run(f"UPDATE prediction SET x = x * {factor}, y = y * {factor}")
        run(
            "UPDATE prediction SET error = sqrt((x - tx) * (x - tx) + (y - ty) * (y - ty)) "
            "FROM (SELECT iid AS n, x AS tx, y AS ty FROM instance) AS i WHERE i.n = iid"
        )
        run("UPDATE prediction SET loss = 0.3 * heading_error + 0.7 * (error * error)")
        run("UPDATE prediction SET accuracy = greatest(0, 1 - error / 12)")
        run(
            "UPDATE prediction SET rank = p.place FROM (SELECT run AS r, side AS s, iid AS n, "
            "row_number() OVER (PARTITION BY run, side ORDER BY error, iid) AS place "
            "FROM prediction) AS p WHERE p.r = run AND p.s = side AND p.n = iid"
        )
    assert verify(store_copy) == []


@pytest.mark.parametrize("options", [(), ("--json",)])
def test_an_unwritable_verdict_is_an_error(tiny_store, options):
    command = [sys.executable, "-m", "s2rtui", "verify", str(tiny_store), *options]
    with Path("/dev/full").open("w") as full:
        process = subprocess.run(
            command, stdout=full, stderr=subprocess.PIPE, text=True, timeout=300, check=False
        )
    assert process.returncode == 2
    assert "standard output: No space left on device" in process.stderr


def test_files_without_a_checksum_are_damage(store):
    paths = [path for path in CHECKED_FILES if not path.startswith("drives/")]
    with edit(store) as draft:
        for path in paths:
            draft.delete("provenance", what=schema.CHECKSUMS, key=path)
    found = {damage.where for damage in verify(store)}
    assert found == {path.removesuffix("/zarr.json") for path in paths}


def test_deeply_nested_folders_are_rejected_in_one_line(store_copy, s2r):
    folder = store_copy / "runs.zarr"
    for _ in range(60):
        folder = folder / "d"
    folder.mkdir(parents=True)
    for command in ("verify", "prune"):
        s2r(command, store_copy).assert_refused("nested too deeply")


def test_a_huge_sparse_ledger_is_rejected(store_copy, capsys, monkeypatch):
    monkeypatch.setattr(ledger, "_MAX_FILE", 2 << 20)
    (store_copy / "ledger" / "zeros.jsonl").touch()
    os.truncate(store_copy / "ledger" / "zeros.jsonl", 3 << 20)
    assert main(["verify", str(store_copy)]) in (1, 2)
    assert "zeros.jsonl" in "".join(capsys.readouterr())

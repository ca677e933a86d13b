"""`verify` detects every kind of damage and reports none in an intact store."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

import s2rstore
from s2rstore.errors import RequestError
from s2rstore.index.transaction import edit
from s2rstore.maintenance.verify import verify
from s2rtui.cli import main
from tests.support.copies import copy_store
from tests.support.ingested import build_ingested_store


@pytest.fixture(scope="module")
def intact_store(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """An ingested store with floor plan, drives and weights, which no test modifies."""
    return build_ingested_store(tmp_path_factory.mktemp("ingested"))


@pytest.fixture
def store(intact_store: Path, tmp_path: Path) -> Path:
    return copy_store(intact_store, tmp_path / "own.s2r")


def test_a_new_store_has_no_damage(store: Path) -> None:
    assert verify(store) == []


CHECKED_FILES = (
    "drives/one/real.csv", "drives/one/sim.csv", "drives/two/untuned.csv",
    "drives/two/commands.csv", "assets/floor_plan.png", "frames.zarr/sim/traj1/rgb/zarr.json",
    "frames.zarr/real/traj1/depth/zarr.json", f"models/{'a' * 64}.safetensors",
)  # fmt: skip


@pytest.mark.parametrize("path", CHECKED_FILES)
@pytest.mark.parametrize("bit", [1, 5])
def test_a_flipped_bit_is_detected(store: Path, path: str, bit: int) -> None:
    content = bytearray((store / path).read_bytes())
    content[len(content) // 2] ^= 1 << bit
    (store / path).write_bytes(content)
    assert [damage for damage in verify(store) if damage.where in path or path in damage.where]


@pytest.mark.parametrize(("domain", "image"), [("sim", "rgb"), ("real", "depth")])
def test_flipped_bytes_of_metadata_are_detected(store: Path, domain: str, image: str) -> None:
    path = store / "frames.zarr" / domain / "traj1" / image / "zarr.json"
    content = path.read_bytes()
    for offset in range(0, len(content), 7):
        flipped = bytearray(content)
        flipped[offset] ^= 1
        path.write_bytes(flipped)
        assert verify(store), (offset, bytes(flipped[offset - 10 : offset + 10]))


@pytest.mark.parametrize("path", CHECKED_FILES)
def test_a_removed_file_is_detected(store: Path, path: str) -> None:
    (store / path).unlink()
    assert verify(store)


@pytest.mark.parametrize("folder", ["drives", "drives/one", "assets", "models"])
def test_a_removed_folder_is_detected(store: Path, folder: str) -> None:
    shutil.rmtree(store / folder)
    assert verify(store)


def test_readers_check_metadata_when_they_open_an_array(store: Path) -> None:
    path = store / "frames.zarr/sim/traj1/rgb/zarr.json"
    document = json.loads(path.read_text())
    path.write_text(json.dumps(document))
    with s2rstore.open(store) as opened, pytest.raises(RequestError, match="metadata"):
        opened.frame(0, "sim")
    assert verify(store)


def test_the_metadata_of_computed_arrays_is_checked(store_copy: Path) -> None:
    relative = "vanilla/key0/activation.real"
    path = store_copy / "runs.zarr" / relative
    with s2rstore.open(store_copy) as store:
        _, array = store.array("vanilla", "activation", "real")
    with edit(store_copy) as draft:
        values = {"metadata_sha256": array.metadata_sha256}
        draft.update("zarr_array", {"path": relative}, values)
    assert verify(store_copy) == []
    document = json.loads((path / "zarr.json").read_text())
    (path / "zarr.json").write_text(json.dumps(document, indent=1))
    with s2rstore.open(store_copy) as store, pytest.raises(RequestError, match="published"):
        store.heatmap("vanilla", "activation", "real", 0)
    assert verify(store_copy)


def _change_entries(root: Path, change: Callable[[dict[str, object]], None]) -> None:
    for file in (root / "ledger").glob("*.jsonl"):
        lines = [json.loads(line) for line in file.read_text().splitlines()]
        for line in lines:
            change(line)
        file.write_text("".join(json.dumps(line) + "\n" for line in lines))


def test_weights_are_checked_for_any_ledger_key(store: Path) -> None:
    _change_entries(store, lambda entry: entry.update(key="x"))
    weights = next((store / "models").iterdir())
    weights.write_bytes(weights.read_bytes()[:-1] + b"\0")
    assert any(damage.where.startswith("models/") for damage in verify(store))


def test_a_wrong_row_count_in_the_ledger_is_detected(store_copy: Path) -> None:
    _change_entries(store_copy, lambda entry: entry.update(count=7))
    assert verify(store_copy)


@pytest.mark.parametrize(
    "line", ["[]", "[" * 5000, '{"key": 1}', "\0", "null"],
    ids=["list", "nested", "object", "NUL", "null"],
)  # fmt: skip
def test_an_unreadable_ledger_line_is_ignored(store_copy: Path, line: str) -> None:
    file = next((store_copy / "ledger").glob("*.jsonl"))
    lines = file.read_text().splitlines()
    lines[0] = line
    file.write_text("\n".join(lines) + "\n")
    assert any("no ledger entry" in damage.what for damage in verify(store_copy))


@pytest.mark.parametrize("factor", [1e3, 1e6, 1e150])
def test_large_predictions_are_not_damage(store_copy: Path, factor: float) -> None:
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


def test_a_slightly_wrong_loss_is_damage(store_copy: Path) -> None:
    with edit(store_copy) as draft:
        draft._connection.execute("UPDATE prediction SET loss = loss * 1.000001 WHERE iid = 3")
    assert any("loss" in damage.what for damage in verify(store_copy))


def _command(
    store: Path, *options: str, out: Path | None = None
) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", "s2rtui", "verify", str(store), *options]
    if out is None:
        return subprocess.run(command, capture_output=True, text=True, timeout=60, check=False)
    with out.open("w") as file:
        return subprocess.run(
            command, stdout=file, stderr=subprocess.PIPE, text=True, timeout=60, check=False
        )


@pytest.mark.parametrize("options", [(), ("--json",)])
def test_an_unwritable_verdict_is_an_error(tiny_store: Path, options) -> None:
    process = _command(tiny_store, *options, out=Path("/dev/full"))
    assert process.returncode == 2
    assert "standard output: No space left on device" in process.stderr


def test_missing_checksums_are_noted_in_one_line(tiny_store: Path) -> None:
    process = _command(tiny_store)
    assert process.returncode == 0
    (line,) = [line for line in process.stderr.splitlines() if "no checksums" in line]
    assert "metadata of frames" in line


def test_deeply_nested_folders_are_rejected_in_one_line(store_copy: Path, capsys) -> None:
    folder = store_copy / "runs.zarr"
    for _ in range(60):
        folder = folder / "d"
    folder.mkdir(parents=True)
    for command in ("verify", "prune"):
        assert main([command, str(store_copy)]) == 2
        assert "nested too deeply" in capsys.readouterr().err


def test_a_huge_sparse_ledger_is_rejected(store_copy: Path, capsys) -> None:
    (store_copy / "ledger" / "zeros.jsonl").touch()
    os.truncate(store_copy / "ledger" / "zeros.jsonl", 3 << 30)
    assert main(["verify", str(store_copy)]) in (1, 2)
    assert "zeros.jsonl" in "".join(capsys.readouterr())

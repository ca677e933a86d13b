"""`s2r gap` on a small store: result files, comparisons and rejected requests."""

from __future__ import annotations

import errno
import json
import os
from pathlib import Path

import pytest

from s2rstore.errors import RequestError
from s2rstore.files import atomic_writes
from s2rstore.index.transaction import edit
from s2rtools.common.result_files import check_writable, write_all
from s2rtools.gap.gate import gate
from s2rtui.cli import main
from tests.support.copies import copy_store


@pytest.fixture
def store(store_of_400: Path) -> Path:
    return store_of_400


def gap(store: Path, *options: str) -> int:
    return main(["gap", str(store), "--axis", "task", *options])


def test_all_requested_files_are_written(store, tmp_path, capsys):
    ref, golden, out = (tmp_path / name for name in ("ref.json", "golden.json", "out.json"))
    options = ["--freeze", str(ref), "--freeze-golden", str(golden), "--out", str(out)]
    assert gap(store, *options) == 0
    output = capsys.readouterr()
    assert output.err == f"wrote {golden}\nwrote {ref}\n"
    assert "task: G 100 is" in output.out
    assert "INCONCLUSIVE" not in output.out
    assert gap(store, "--reference", str(ref), "--golden", str(golden)) in (1, 3)
    printed = capsys.readouterr().out
    frozen = json.loads(ref.read_text())["axes"]["task"]
    low, high = (f"{frozen[f'anchor_{end}']:.3f}" for end in ("low", "high"))
    assert f"task: G 100 is {frozen['anchor']:.3f} ({low} .. {high}) m: the constant" in printed
    assert "reference scale frozen from dataset tiny, run vanilla, expression all" in printed
    assert json.loads(out.read_text())["axes"][0]["floor"] == 0


def test_a_requested_axis_without_evidence_is_rejected(store, tmp_path, capsys):
    """A reference without the axis would let every later night pass without it."""
    ref = tmp_path / "ref.json"
    assert gap(store, "--axis", "dynamics", "--freeze", str(ref)) == 2
    assert "--axis dynamics: cannot be measured: no drives" in capsys.readouterr().err
    assert not ref.exists()


def test_the_last_line_matches_the_exit_code(store, tmp_path, capsys):
    golden = tmp_path / "golden.json"
    assert gap(store, "--freeze-golden", str(golden)) == 0
    capsys.readouterr()
    assert gap(store, "--golden", str(golden)) == 0
    assert capsys.readouterr().out.splitlines()[-1].startswith("PASS: by the golden run alone")
    assert gap(store) == 3
    assert capsys.readouterr().out.splitlines()[-1].startswith("INCONCLUSIVE: no reference")


@pytest.mark.parametrize("option", ["--freeze", "--freeze-golden", "--out"])
def test_an_unwritable_path_is_rejected_before_measuring(
    store, tmp_path, capsys, monkeypatch, option
):
    monkeypatch.setattr(gate, "judge_gap", None)
    assert gap(store, option, str(tmp_path / "nowhere" / "f.json")) == 2
    err = capsys.readouterr().err
    assert err.startswith(f"s2r: {option} ")
    assert err.count("\n") == 1
    assert list(tmp_path.iterdir()) == []


def test_no_file_is_written_if_one_cannot_be(store, tmp_path, capsys, monkeypatch):
    write, paths = atomic_writes.write_partial, []

    def failing_write(path: Path, content: bytes) -> Path:
        paths.append(path)
        if len(paths) == 3:
            raise OSError(errno.EDQUOT, "Disk quota exceeded")
        return write(path, content)

    monkeypatch.setattr(atomic_writes, "write_partial", failing_write)
    options = [("--freeze", "ref"), ("--freeze-golden", "golden"), ("--out", "out")]
    assert gap(store, *(w for o, n in options for w in (o, str(tmp_path / n)))) == 2
    output = capsys.readouterr()
    assert output.out == ""
    assert output.err == f"s2r: {tmp_path / 'out'}: Disk quota exceeded\n"
    assert len(paths) == 3
    assert list(tmp_path.iterdir()) == []


def test_different_data_sets_with_one_name_are_not_compared(store, tmp_path, capsys):
    ref = tmp_path / "ref.json"
    gap(store, "--freeze", str(ref))
    capsys.readouterr()
    other = copy_store(store, tmp_path / "other.s2r")
    with edit(other) as draft:
        draft.update("instance", {"iid": "7"}, {"x": 1.0})
    assert gap(other, "--reference", str(ref)) == 2
    err = capsys.readouterr().err
    assert "ref.json: does not fit: task's poses is " in err
    assert len(err) < 250


def test_a_task_reference_is_valid_for_another_split(store, tmp_path, capsys):
    """A newer model was trained on other instances of the same data set."""
    ref = tmp_path / "ref.json"
    gap(store, "--freeze", str(ref))
    other = copy_store(store, tmp_path / "other.s2r")
    with edit(other) as draft:
        for iid in range(0, 60, 5):
            key = {"run": "vanilla", "side": "sim", "iid": str(iid)}
            draft.update("prediction", key, {"split": "test"})
    capsys.readouterr()
    assert gap(other, "--reference", str(ref), "--json") in (0, 1, 3)
    (axis_entry,) = json.loads(capsys.readouterr().out)["axes"]
    assert axis_entry["n"] == 400 // 5 + 12
    anchor = json.loads(ref.read_text())["axes"]["task"]["anchor"]
    assert axis_entry["anchor"] == pytest.approx(anchor)
    assert axis_entry["gap"] == pytest.approx(100 * axis_entry["value"] / axis_entry["anchor"])


def names(folder: Path) -> list[str]:
    return sorted(path.name for path in folder.iterdir())


def test_all_files_are_replaced_or_none(tmp_path):
    (tmp_path / "a").write_text("old")
    write_all({tmp_path / "a": b"new", tmp_path / "b": b"bytes"})
    assert (tmp_path / "a").read_bytes() == b"new"
    assert (tmp_path / "b").read_bytes() == b"bytes"
    assert names(tmp_path) == ["a", "b"]
    missing = tmp_path / "nowhere" / "b"
    with pytest.raises(RequestError, match=r"nowhere/b: No such file or directory"):
        write_all({tmp_path / "a": b"newer", missing: b"newer"})
    assert (tmp_path / "a").read_text() == "new"
    assert names(tmp_path) == ["a", "b"]


def test_a_full_disk_keeps_the_previous_files(tmp_path, monkeypatch):
    def failing_fsync(descriptor: int) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    (tmp_path / "a").write_text("old")
    monkeypatch.setattr(atomic_writes.os, "fsync", failing_fsync)
    with pytest.raises(RequestError, match=r"a: No space left on device"):
        write_all({tmp_path / "a": b"new"})
    assert (tmp_path / "a").read_text() == "old"
    assert names(tmp_path) == ["a"]


@pytest.mark.parametrize(
    ("name", "expected"),
    [("nowhere/f", "--out .*nowhere/f: there is no folder"), ("", "a folder; name a file"),
     ("file/f", "there is no folder"), ("ref.json", "is the file of --reference, too")],
)  # fmt: skip
def test_output_paths_are_checked_in_advance(tmp_path, name, expected):
    (tmp_path / "file").touch()
    inputs = {"--reference": tmp_path / "ref.json", "--golden": None}
    check_writable({"--out": tmp_path / "out.json", "--freeze": None}, inputs)
    with pytest.raises(RequestError, match=expected):
        check_writable({"--out": tmp_path / name}, inputs)


def test_a_pipe_a_device_or_the_file_of_another_result_is_not_replaced(tmp_path):
    same_paths = {"--freeze": tmp_path / "f", "--out": tmp_path / "." / "f"}
    with pytest.raises(RequestError, match=r"--out .*is the file of --freeze, too"):
        check_writable(same_paths, {})
    os.mkfifo(tmp_path / "pipe")
    with pytest.raises(RequestError, match=r"--out .*pipe: a device or a pipe; name a file"):
        check_writable({"--out": tmp_path / "pipe"}, {})
    (tmp_path / "out").symlink_to(tmp_path / "pipe")
    with pytest.raises(RequestError, match="a device or a pipe"):
        check_writable({"--out": tmp_path / "out"}, {})

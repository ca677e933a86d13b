"""The progress of a computing process, as other processes read it."""

import subprocess
import sys
import time

import msgspec
import pytest

from s2rstore.files import compute_progress, process_identity
from s2rstore.files.compute_progress import ComputeProgress
from s2rstore.files.store_files import LocalFiles


@pytest.mark.parametrize(
    ("left", "text"),
    [(None, ""), (2.0, ", about 5 s left"), (41.0, ", about 40 s left"),
     (130.0, ", about 2 min left"), (9000.0, ", about 2.5 h left")],
)  # fmt: skip
def test_progress_is_read_as_it_was_written(tmp_path, left, text):
    compute_progress.write(tmp_path, "vanilla: harm", 40, 100, left)
    progress = compute_progress.read(LocalFiles(tmp_path))
    assert progress is not None
    assert progress.text == f"computing vanilla: harm 40/100{text}"
    compute_progress.remove(tmp_path)
    assert compute_progress.read(LocalFiles(tmp_path)) is None


def written(path, **changes):
    """Write the progress of this process with some changes."""
    progress = ComputeProgress(process_identity.this_process(), "x", 1, 2, None, time.time())
    file = path / compute_progress.FILE
    file.parent.mkdir(exist_ok=True)
    file.write_bytes(msgspec.json.encode(msgspec.structs.replace(progress, **changes)))


def test_what_a_killed_process_has_left_is_not_shown(tmp_path):
    written(tmp_path)
    assert compute_progress.read(LocalFiles(tmp_path)) is not None
    elsewhere = msgspec.structs.replace(process_identity.this_process(), host="elsewhere")
    written(tmp_path, process=elsewhere)
    assert compute_progress.read(LocalFiles(tmp_path)) is not None
    written(tmp_path, process=elsewhere, written=time.time() - 3600)
    assert compute_progress.read(LocalFiles(tmp_path)) is None
    code = "from s2rstore.files import process_identity as p; import msgspec as m; "
    code += "print(m.json.encode(p.this_process()).decode())"
    ended = subprocess.run([sys.executable, "-c", code], capture_output=True, check=True).stdout
    written(tmp_path, process=msgspec.json.decode(ended, type=process_identity.ProcessIdentity))
    assert compute_progress.read(LocalFiles(tmp_path)) is None


@pytest.mark.parametrize("content", [b"", b"{}", b"[1]", b"\xff" * 9000])
def test_a_damaged_file_is_no_progress(tmp_path, content):
    (tmp_path / "ledger").mkdir()
    (tmp_path / compute_progress.FILE).write_bytes(content)
    assert compute_progress.read(LocalFiles(tmp_path)) is None

"""The `seq` of a manifest is that of the store, with its gaps."""

import csv
from collections.abc import Callable
from pathlib import Path

import pytest

import s2rstore
from s2rstore.errors import RequestError
from s2rstore.index.transaction import edit
from s2rstore.maintenance.verify import verify
from tests.datasets.helpers import add, ingest, kinds, scan_of
from tests.support import pairs


def renumber(path: Path, number: Callable[[int], int], stop: int | None = None) -> None:
    """Change the seq of all rows, and keep those with a former seq below `stop`."""
    with path.open(newline="") as file:
        rows = list(csv.DictReader(file))
    with path.open("w", newline="") as file:
        writer = csv.DictWriter(file, rows[0])
        writer.writeheader()
        for row in rows:
            if stop is None or int(row["seq"]) < stop:
                writer.writerow(row | {"seq": str(number(int(row["seq"])))})


def stored(store: Path) -> dict[str, list[tuple[int, str]]]:
    """seq and file of the real images by trajectory, in order of iids."""
    with s2rstore.open(store) as opened:
        rows = opened.execute(
            "SELECT trajectory, seq, rgb_path FROM instance JOIN frame USING (iid) "
            "WHERE domain = 'real' ORDER BY iid"
        )
    found: dict[str, list[tuple[int, str]]] = {}
    for trajectory, seq, path in rows:
        found.setdefault(trajectory, []).append((seq, path))
    return found


def of_manifest(path: Path) -> dict[str, list[tuple[int, str]]]:
    found: dict[str, list[tuple[int, str]]] = {}
    with path.open(newline="") as file:
        for row in csv.DictReader(file):
            if row["domain"] == "real":
                found.setdefault(row["trajectory"], []).append((int(row["seq"]), row["rgb"]))
    return {name: sorted(rows) for name, rows in found.items()}


def test_instances_keep_their_seq_where_others_are_left_out(tmp_path):
    path, store = pairs.manifest(tmp_path / "data"), tmp_path / "s.s2r"
    rows = of_manifest(path)
    name = next(iter(rows))
    (path.parent / rows[name][2][1]).unlink()
    scan = ingest("csv", path, store)
    assert kinds(scan) == {"missing image": 1}
    expected = rows | {name: [row for row in rows[name] if row != rows[name][2]]}
    assert stored(store) == expected
    assert verify(store) == []


def test_rows_with_a_seq_that_the_index_cannot_hold_are_reported(tmp_path):
    path = pairs.manifest(tmp_path / "data")
    text = path.read_text()
    for seq in ("-1", "2147483648"):
        path.write_text(text.replace("a,0,real", f"a,{seq},real", 1))
        (issue,) = (issue for issue in scan_of("csv", path).issues if issue.kind == "bad seq")
        assert seq in issue.detail
        assert "0 to 2147483647" in issue.detail


@pytest.fixture
def grown(tmp_path: Path) -> tuple[Path, Path]:
    """A manifest with gaps in its seq, and the store of its first rows."""
    path, store = pairs.manifest(tmp_path / "data"), tmp_path / "s.s2r"
    renumber(path, lambda seq: 10 * seq + 3)
    whole = path.read_text()
    renumber(path, lambda seq: seq, stop=23)
    ingest("csv", path, store)
    path.write_text(whole)
    return path, store


def test_appended_instances_have_the_seq_of_the_manifest(grown):
    path, store = grown
    lines: list[str] = []
    assert sum(add(scan_of("csv", path), store, strict=True, lines=lines).values()) > 0
    assert stored(store) == of_manifest(path)
    assert not any("another seq" in line for line in lines)
    assert verify(store) == []


def test_a_store_that_counts_its_instances_goes_on_counting(grown):
    path, store = grown
    with edit(store) as draft:  # as of a manifest without numbers
        for trajectory, rows in stored(store).items():
            for position, (seq, _) in enumerate(rows):
                key = {"trajectory": trajectory, "seq": seq}
                draft.update("instance", key, {"seq": position})
    lines: list[str] = []
    added = add(scan_of("csv", path), store, strict=True, lines=lines)
    (line,) = (line for line in lines if "another seq" in line and "trajectory a" in line)
    assert "2 rows have another seq in the store: seq 3 of the source is 0; seq 13 of" in line
    assert line.endswith("added ones are numbered on from the last stored one")
    rows, expected = stored(store), of_manifest(path)
    assert rows["a"] == [(n, file) for n, (_, file) in enumerate(expected["a"])]
    assert rows["b"] == expected["b"]
    assert set(added) == {"a", "b"}
    assert verify(store) == []


def test_a_column_that_exists_twice_is_rejected(tmp_path):
    path = pairs.manifest(tmp_path / "data")
    head, *rows = path.read_text().splitlines()
    path.write_text("\n".join([f"{head},seq", *(f"{row},7" for row in rows)]))
    with pytest.raises(RequestError, match="column seq exists more than once"):
        ingest("csv", path, tmp_path / "s.s2r")


def test_rows_of_stored_images_under_another_seq_are_named(tmp_path):
    path, store = pairs.manifest(tmp_path / "data"), tmp_path / "s.s2r"
    ingest("csv", path, store)
    before, count = stored(store), len(stored(store)["a"])
    renumber(path, lambda seq: seq + 100)
    lines: list[str] = []
    assert add(scan_of("csv", path), store, lines=lines) == {}
    assert lines[:2] == [
        "trajectory a: already in the store",
        f"trajectory a: {count} rows have another seq in the store: seq 100..{99 + count} of the "
        f"source is 0..{count - 1}",
    ]
    assert stored(store) == before

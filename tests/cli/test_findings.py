"""`s2r findings`: JSON that agrees with `s2r query`, a table of 80 columns, and refusals."""

from pathlib import Path

import pytest

from s2rstore.index.transaction import edit
from tests.support import image_folders, tiny


@pytest.fixture(scope="module")
def store(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Vanilla was trained on four of five instances."""
    path = tmp_path_factory.mktemp("findings") / "s.s2r"
    return tiny.build(path, n=80, trained=("vanilla",))


def test_the_table_fits_into_80_columns(store, s2r, monkeypatch):
    monkeypatch.setenv("COLUMNS", "80")
    lines = s2r("findings", store).lines
    assert max(map(len, lines)) <= 80
    text = "\n".join(lines)
    assert "worst room" in text
    assert "select: " in text
    assert all(line == line.rstrip() for line in lines)


def test_unknown_runs_and_histories_are_rejected(store, tmp_path, s2r):
    s2r("findings", store, "--run", "nobody").assert_refused("nobody")
    s2r("findings", store, "--history", tmp_path / "no.jsonl").assert_refused("no.jsonl")
    path = tmp_path / "gap.jsonl"
    path.write_text("no history")
    s2r("findings", store, "--history", path).assert_refused("no history that this version reads")


def test_stores_without_poses_or_computed_runs_are_rejected(tmp_path, s2r):
    path = image_folders.image_store(tmp_path)
    s2r("findings", path).assert_refused("needs poses")
    path = tiny.build(tmp_path / "s.s2r", n=16, runs=("vanilla",))
    with edit(path) as draft:
        draft.rows("UPDATE run SET key = NULL")
    s2r("findings", path).assert_refused("s2r precompute")


@pytest.mark.parametrize("grouping", ["room", "heading", "curvature", "trajectory"])
def test_shown_groups_count_the_new_instances(store, grouping, s2r):
    arguments = ["show", str(store), "rooms", "--group-by", grouping, "--sort", "n", "--json"]
    rows = s2r(*arguments).json
    assert sum(row["n"] for row in rows) == 16
    assert sum(row["selected"] for row in rows) == 16
    assert [row["n"] for row in rows] == sorted((row["n"] for row in rows), reverse=True)
    for row in rows:
        assert row["low_m"] is None or row["low_m"] <= row["real_m"] <= row["high_m"]


@pytest.mark.parametrize(
    ("view", "column", "listed"), [("list", "real_m", "real.error"), ("rooms", "gap", "gap_m"),
                                   ("list", "", "gap"), ("rooms", "iid", "group")],
)  # fmt: skip
def test_a_column_that_the_view_does_not_have_is_rejected(store, view, column, listed, s2r):
    s2r("show", store, view, "--sort", column).assert_refused(listed)


def test_sentences_keep_the_names_of_runs(tmp_path, s2r):
    runs = ("NetA", "NetB")
    path = tiny.build(tmp_path / "s.s2r", 12, runs, trained=runs)
    for view in ("findings", "map"):
        printed = s2r("show", path, view, "--run", "NetA", "--words").printed
        assert printed[0].isupper() or printed[0].isdigit()
        assert "neta" not in printed
        assert view != "findings" or "NetA" in printed

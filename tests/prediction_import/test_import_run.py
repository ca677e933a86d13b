"""Files of predictions become a run: every format, and what is wrong with rows."""

from __future__ import annotations

import json
from collections import Counter
from itertools import product
from pathlib import Path

import duckdb
import numpy as np
import pytest

import s2rstore
from s2rstore.errors import NotComputedError, RequestError
from s2rstore.maintenance.verify import check, verify
from s2rstore.metrics import pose_metrics
from s2rstore.records import SIDES
from s2rtools.common.input_issue import issue_lines
from s2rtools.prediction_import.file_predictions import ReadingOptions
from s2rtools.prediction_import.import_run import ImportReport, ImportRequest, import_run
from s2rtools.prediction_import.pose_units import parse_units
from s2rtools.prediction_import.prediction_table import read_table
from s2rtools.prediction_import.sided_files import parse_file
from s2rtui.cli import main
from tests.support.predictions import COLUMNS, Made, make, rows_of, write_csv, write_rows
from tests.support.refusals import refused

N = 24


def run_import(
    store: Path, *files: Path | str, name: str = "theirs", units: str = "", heading: str = "0+h",
    embeddings: tuple[Path | str, ...] = (), tolerance: float = 0.02,
) -> ImportReport:  # fmt: skip
    request = ImportRequest(
        [parse_file(str(file)) for file in files],
        [parse_file(str(file)) for file in embeddings],
        reading=ReadingOptions(parse_units(units), heading, tolerance),
    )
    return import_run(store, name, request)


def predicted(store: Path, name: str = "theirs") -> Made:
    with s2rstore.open(store) as opened:
        columns = opened.run_columns(name)
        sides = (columns.sim, columns.real)
        return Made(*(np.column_stack([side.x, side.y, side.heading]) for side in sides))


def assert_equal(found: Made, expected: Made, tolerance: float = 1e-12) -> None:
    for side in SIDES:
        difference = found.of(side) - expected.of(side)
        difference[:, 2] = np.mod(difference[:, 2] + np.pi, 2 * np.pi) - np.pi
        np.testing.assert_allclose(difference, 0, atol=tolerance)


def paths_of(store: Path) -> dict[tuple[str, int], str]:
    with s2rstore.open(store) as opened:
        rows = opened.execute("SELECT domain, iid, rgb_path FROM frame")
    return {(domain, iid): path for domain, iid, path in rows}


def test_a_csv_by_iid_gives_the_metrics_of_its_poses(store, tmp_path):
    made = make(store)
    report = run_import(store, write_csv(tmp_path / "p.csv", made))
    assert report.counts == {"sim": N, "real": N, "both": N, "attempted": N, "not_localised": 0,
                             "absent": 0}  # fmt: skip
    assert (report.issues, report.warnings) == ([], ())
    assert "matched by iid; positions in m (recognised)" in report.lines[0]
    assert_equal(predicted(store), made)
    with s2rstore.open(store) as opened:
        truth, side = opened.instances, opened.run_columns("theirs").real
        error = np.hypot(made.real[:, 0] - truth.x, made.real[:, 1] - truth.y)
        np.testing.assert_allclose(side.error, error)
        np.testing.assert_array_equal(side.rank, pose_metrics.rank(side.error))
        run = opened.run("theirs")
        assert (run.model, run.precision, run.is_imported) == (None, None, True)
        assert opened.coverage("theirs").summary == "imported"
        assert opened.coverage("theirs").note == ""
    assert verify(store) == []


def test_rows_by_image_tell_their_side(store, tmp_path):
    made, paths = make(store), paths_of(store)
    rows = [(f"/data/{path}", *made.of(domain)[iid]) for (domain, iid), path in paths.items()]
    report = run_import(store, write_rows(tmp_path / "p.csv", ("path", "x", "y", "yaw"), rows))
    assert "matched by image" in report.lines[0]
    assert_equal(predicted(store), made)


def test_file_names_that_both_domains_have_need_a_side(store, tmp_path):
    made, paths = make(store), paths_of(store)
    rows = [
        (Path(path).name, domain, *made.of(domain)[iid]) for (domain, iid), path in paths.items()
    ]
    file = write_rows(tmp_path / "p.csv", ("image", "domain", "x", "y", "heading"), rows)
    assert run_import(store, file).counts["both"] == N
    assert_equal(predicted(store), made)
    without = [(name, *pose) for name, _, *pose in rows]
    file = write_rows(tmp_path / "q.csv", ("image", "x", "y", "heading"), without)
    with pytest.raises(RequestError, match="is in both domains; add a column side"):
        run_import(store, file)


@pytest.mark.parametrize(("unit", "seconds"), [("s", 1.0), ("ms", 1e3), ("ns", 1e9)])
def test_tum_files_of_both_sides_by_time(store, tmp_path, unit, seconds):
    made = make(store)
    with s2rstore.open(store) as opened:
        times = opened.instances.timestamp
    for side in SIDES:
        lines = ["# timestamp tx ty tz qx qy qz qw"]
        for time, (x, y, heading) in zip(times, made.of(side), strict=True):
            time = (time + 0.004) * seconds
            z, w = np.sin(heading / 2), np.cos(heading / 2)
            lines.append(f"{time:.17g} {x:.17g} {y:.17g} 0.5 0 0 {z:.17g} {w:.17g}")
        (tmp_path / f"{side}.tum").write_text("\n".join(lines))
    files = [f"{side}:{tmp_path / side}.tum" for side in SIDES]
    report = run_import(store, *files, units=unit)
    assert "matched by time within 0.02 s (largest difference 0.004 s)" in report.lines[1]
    assert_equal(predicted(store), made, 1e-9)


def test_files_of_one_recording_are_matched_within_it(store, tmp_path):
    made = make(store)
    with s2rstore.open(store) as opened:
        codes, names = opened.instances.trajectory, opened.instances.trajectory_names
    files = []
    for side, (code, name) in product(SIDES, enumerate(names)):
        iids = np.flatnonzero(codes == code)
        with s2rstore.open(store) as opened:
            times = opened.instances.timestamp[iids]
        rows = [(time, *made.of(side)[iid]) for time, iid in zip(times, iids, strict=True)]
        file = tmp_path / f"{side}-{name}.csv"
        files.append(f"{side}/{name}:{write_rows(file, ('time', 'x', 'y', 'heading'), rows)}")
    assert run_import(store, *files).counts["both"] == N
    assert_equal(predicted(store), made)
    with pytest.raises(RequestError, match=r"no trajectory 'c' \(has: a, b\)"):
        run_import(store, files[0].replace("sim/a", "sim/c"))


def test_a_trajectory_beside_iids_and_a_unit_beside_a_column_of_another_are_refused(
    store, tmp_path
):
    file = write_rows(tmp_path / "p.csv", ("iid", "x", "y", "heading"), [(0, 1, 2, 3)])
    with pytest.raises(RequestError, match="matched by iid; do not name a trajectory"):
        run_import(store, f"sim/a:{file}")
    file = write_rows(tmp_path / "p.csv", ("iid", "x", "y", "heading_deg"), [(0, 1, 2, 3)])
    with pytest.raises(RequestError, match=r"--units rad: headings are in deg \(heading_deg\)"):
        run_import(store, f"sim:{file}", units="rad")


def test_rows_by_trajectory_and_seq_with_both_sides(store, tmp_path):
    made = make(store)
    with s2rstore.open(store) as opened:
        keys = opened.execute("SELECT trajectory, seq FROM instance ORDER BY iid")
    names = ("trajectory", "seq", "x", *(f"{s}_{n}" for s in SIDES for n in ("x", "y", "heading")))
    rows = [(*key, 99, *made.sim[iid], *made.real[iid]) for iid, key in enumerate(keys)]
    report = run_import(store, write_rows(tmp_path / "p.csv", names, rows))
    assert "matched by trajectory and seq" in report.lines[0]
    assert_equal(predicted(store), made)


def test_parquet_equals_csv(store, tmp_path):
    made = make(store)
    file = write_csv(tmp_path / "p.csv", made)
    with duckdb.connect() as connection:
        connection.execute(
            f"COPY (SELECT * FROM read_csv('{file}')) TO '{tmp_path}/p.parquet' (FORMAT parquet)"
        )
    run_import(store, tmp_path / "p.parquet")
    assert_equal(predicted(store), made)


def test_units_are_recognised_and_conventions_applied(store, tmp_path):
    made = make(store)
    rows = [
        (iid, side, 1000 * x, 1000 * y, 90 - np.degrees(heading))
        for side in SIDES
        for iid, (x, y, heading) in enumerate(made.of(side))
    ]
    file = write_rows(tmp_path / "p.csv", COLUMNS, rows)
    report = run_import(store, file, heading="90-h")
    assert "positions in mm (recognised), headings in deg (recognised)" in report.lines[0]
    assert "map heading 90-h" in report.lines[0]
    assert_equal(predicted(store), made, 1e-9)
    report = run_import(store, file)
    assert "--heading 90-h" in report.warnings[0]
    report = run_import(store, file, heading="auto", units="mm,deg")
    assert "positions in mm, headings in deg, map heading 90-h" in report.lines[0]
    assert_equal(predicted(store), made, 1e-9)


def test_rows_that_cannot_be_used_are_reported_with_their_lines(store, tmp_path):
    made = make(store)
    rows = rows_of(made)
    rows[3] = (3, "sim", "nan", 1, 2)
    rows[4] = (4, "sim", 1, "", 2)
    rows[5] = (5, "sim", 1, 2, "north")
    rows[6] = (6, "sim", 3e6, 2, 1)
    rows[7] = (99, "sim", 1, 2, 1)
    rows[8] = (8, "left", 1, 2, 1)
    rows += [(0, "sim", 8, 8, 1), (1, "real", 8, 8, 1)]
    rows += [(1000 + k, "real", 1, 2, 1) for k in range(7)]
    report = run_import(store, write_rows(tmp_path / "p.csv", COLUMNS, rows))
    lines = issue_lines(report.issues)
    assert Counter(issue.kind for issue in report.issues) == {
        "row of another side": 1, "unmatched row": 8, "out of range": 1, "duplicate row": 2,
        "incomplete pose, not localised": 3,
    }  # fmt: skip
    assert "  p.csv:10 side 'left', not sim or real" in lines
    assert "  p.csv:9 iid 99: the store holds 0 .. 23" in lines
    assert "  ... and 3 more" in lines
    assert "  p.csv:5 (sim) no number in x" in lines
    assert "  p.csv:8 (sim) beyond 1e+06 m or 1e+06 rad" in lines
    assert "  p.csv:50 (sim) repeats instance 0 of p.csv:2 (sim), which is used" in lines
    assert report.counts == {"sim": N - 6, "real": N, "both": N - 6, "attempted": N,
                             "not_localised": 6, "absent": 3}  # fmt: skip
    found, missing = predicted(store), [3, 4, 5, 6, 7, 8]
    assert np.flatnonzero(np.isnan(found.sim[:, 0])).tolist() == missing
    np.testing.assert_allclose(found.sim[0], made.sim[0])
    with s2rstore.open(store) as opened:
        coverage = opened.coverage("theirs")
        assert coverage.note == "run theirs: imported, 6 not localised"
        assert np.flatnonzero(~opened.run_columns("theirs").valid).tolist() == missing
    checked = check(store)
    assert list(checked.damages) == []
    assert coverage.note in checked.notes


def test_rows_of_a_tum_file_that_cannot_be_used(store, tmp_path):
    run_import(store, write_csv(tmp_path / "p.csv", make(store)))
    (tmp_path / "s.tum").write_text(
        "0.0 1 2 0 0 0 0 1\n0.1 1 2 0 0 0 0\n0.2 1 2 0 0 0 0 2\n0.3 nan 2 0 0 0 0 1\n"
        "70 1 2 0 0 0 0 1\n0.1001 1 2 0 0 0 0 1\n0.1 1 2 0 0 0 1 0\n"
    )
    with pytest.raises(RequestError, match=r"both sides \(sim 2, real 0\).*real:FILE"):
        run_import(store, f"sim:{tmp_path}/s.tum")
    (tmp_path / "r.tum").write_text("0 1 2 0 0 0 0 1\n")
    report = run_import(store, f"sim:{tmp_path}/s.tum", f"real:{tmp_path}/r.tum")
    text = "\n".join(issue_lines(report.issues))
    assert "s.tum:2 7 values, expected 8" in text
    assert "s.tum:3 length 2" in text
    assert "s.tum:4 (sim) no number in " in text
    assert "s.tum:5 the nearest instance is 67.7 s away" in text
    assert "s.tum:6 another row is nearer to instance 1" in text
    assert [report.counts[name] for name in ("sim", "real", "both", "absent")] == [2, 1, 1, 11]


def test_importing_again_replaces_the_run(store, tmp_path):
    run_import(store, write_csv(tmp_path / "p.csv", make(store)))
    with s2rstore.open(store) as before:
        first, generation = before.run("theirs"), before.generation
        other = make(store, seed=1)
        report = run_import(store, write_csv(tmp_path / "q.csv", other))
        assert not report.is_new
        assert before.run_columns("theirs").valid.all()  # the opened generation stays readable
        before.array("theirs", "prediction", "sim")[1].rows(0, N)
    with s2rstore.open(store) as opened:
        run = opened.run("theirs")
        assert opened.generation == generation + 1
        assert run.created_at == first.created_at
        assert run.key != first.key
        (file,) = json.loads(opened.provenance("run:theirs")["imported predictions"])
        assert (file["file"], len(file["sha256"]), file["used"]) == ("q.csv", 64, 2 * N)
    assert_equal(predicted(store), other)
    assert verify(store) == []


def test_the_split_of_a_file_is_that_of_its_predictions(store, tmp_path):
    made = make(store)
    rows = [(*row, "train" if number < 10 else "") for number, row in enumerate(rows_of(made))]
    names = (*COLUMNS, "split")
    run_import(store, write_rows(tmp_path / "p.csv", names, rows))
    with s2rstore.open(store) as opened:
        found = opened.execute(
            "SELECT side, split, count(*) FROM prediction GROUP BY ALL ORDER BY ALL"
        )
    assert found == [("real", "unseen", N), ("sim", "train", 10), ("sim", "unseen", N - 10)]
    rows[2] = (*rows[2][:-1], "held out")
    with pytest.raises(RequestError, match=r"p\.csv:4: split 'held out': one of train"):
        run_import(store, write_rows(tmp_path / "p.csv", names, rows))


@pytest.mark.parametrize(("names", "message"), [
    (("iid", "side", "x", "y"), "needs columns x, y and heading .*; has iid, side, x, y"),
    (("iid", "x", "y", "heading"), "sim or real\\? add a column side or domain"),
    (("side", "x", "y", "heading"), "which instances\\? add a column iid, image or timestamp"),
    (("foo",), "sim or real\\?"),
    (("iid", "side", "x", "tx", "y", "heading"), "columns x and tx mean the same"),
])  # fmt: skip
def test_missing_columns_are_named(store, tmp_path, names, message):
    file = write_rows(tmp_path / "p.csv", names, [("sim",) * len(names)])
    with pytest.raises(RequestError, match=message):
        run_import(store, file)


def test_files_that_are_no_predictions(store, tmp_path):
    for name, content, message in (
        ("p.csv", b"", "no rows"),
        ("p.csv", b"iid;side;x;y\n0;sim;1;1\n", "p.csv:1: columns are separated by semicolons"),
        ("p.csv", b"iid,side\n\x00", "NUL bytes"),
        ("p.parquet", b"PAR1 cut", "cannot be read as a Parquet file"),
        ("p.tum", b"# nothing\n", "no row of 8 numbers"),
        ("p.xls", b"1", "unknown suffix"),
    ):
        (tmp_path / name).write_bytes(content)
        with refused(str(tmp_path / name), message):
            run_import(store, f"sim:{tmp_path / name}")
    with pytest.raises(RequestError, match=r"none\.csv"):
        run_import(store, tmp_path / "none.csv")
    with s2rstore.open(store) as opened:
        assert opened.runs == {}


def test_nothing_is_published_of_predictions_that_match_nothing(store, tmp_path):
    rows = [(iid + 100, "sim", 1, 2, 3) for iid in range(3)]
    file = write_rows(tmp_path / "p.csv", COLUMNS, rows)
    with pytest.raises(RequestError, match=r"no row can be used \(unmatched row: 3; p\.csv:2 iid"):
        run_import(store, file)
    rows = [(iid, "sim", 5e6, 2, 3) for iid in range(3)]
    file = write_rows(tmp_path / "p.csv", COLUMNS, rows)
    with pytest.raises(RequestError, match=r"no row can be used \(out of range: 3; p\.csv:2"):
        run_import(store, file, units="m")
    file = write_rows(tmp_path / "p.csv", COLUMNS, [(0, "sim", 1, 1, 0), (1, "real", 1, 1, 0)])
    with pytest.raises(RequestError, match="the instances of both sides differ"):
        run_import(store, file)


def test_a_run_of_a_model_is_not_replaced(store_copy, tmp_path):
    file = write_csv(tmp_path / "p.csv", make(store_copy))
    with pytest.raises(RequestError, match="run 'vanilla': a run of a model; choose another name"):
        run_import(store_copy, file, name="vanilla")


def embedding(rows: int, width: int = 5, seed: int = 0) -> np.ndarray:
    return np.random.default_rng(seed).normal(size=(rows, width)).astype(np.float32)


def stored_embedding(store: Path, side: str) -> np.ndarray:
    with s2rstore.open(store) as opened:
        _, array = opened.array("theirs", "embedding", side)
        return np.asarray(array.rows(0, N))


def test_embeddings_go_with_the_rows_of_their_file(store, tmp_path):
    file, both = write_csv(tmp_path / "p.csv", make(store)), embedding(2 * N)
    np.save(tmp_path / "e.npy", both)
    assert run_import(store, file, embeddings=(tmp_path / "e.npy",)).width == 5
    np.testing.assert_array_equal(stored_embedding(store, "sim"), both[:N])
    np.testing.assert_array_equal(stored_embedding(store, "real"), both[N:])
    for side, rows in (("sim", both[:N]), ("real", both[N:])):
        np.save(tmp_path / f"{side}.npy", rows.astype(np.float64))
    run_import(store, file, embeddings=tuple(f"{s}:{tmp_path / s}.npy" for s in SIDES))
    np.testing.assert_array_equal(stored_embedding(store, "real"), both[N:])
    assert stored_embedding(store, "sim").dtype == np.float32
    assert verify(store) == []


def test_embeddings_of_unmatched_rows_are_skipped(store, tmp_path):
    made = make(store)
    rows = rows_of(made)[::-1]
    rows.insert(5, (999, "real", 1.0, 2.0, 3.0))
    values = embedding(2 * N + 1)
    values[5] = np.nan
    np.save(tmp_path / "e.npy", values)
    file = write_rows(tmp_path / "p.csv", COLUMNS, rows)
    run_import(store, file, embeddings=(tmp_path / "e.npy",))
    used = np.delete(values, 5, axis=0)[::-1]
    np.testing.assert_array_equal(stored_embedding(store, "sim"), used[:N])
    np.testing.assert_array_equal(stored_embedding(store, "real"), used[N:])


@pytest.mark.parametrize(("values", "message"), [
    (embedding(2 * N - 1), "47 rows; p.csv has 48"),
    (embedding(2 * N)[:, 0], "expected float16, float32 or float64 of shape"),
    (np.ones((2 * N, 3), dtype=np.int64), "int64"),
    (np.array([{}] * 2 * N, dtype=object), "not a .npy file of numbers"),
    (np.full((2 * N, 3), 1e300), "row 0 .from 0. is not finite as float32"),
])  # fmt: skip
def test_other_embeddings_are_refused(store, tmp_path, values, message):
    np.save(tmp_path / "e.npy", values, allow_pickle=True)
    file = write_csv(tmp_path / "p.csv", make(store))
    with pytest.raises(RequestError, match=message):
        run_import(store, file, embeddings=(tmp_path / "e.npy",))
    content = (tmp_path / "e.npy").read_bytes()
    for size in (0, 5, 60, len(content) - 1):
        (tmp_path / "e.npy").write_bytes(content[:size])
        with pytest.raises(RequestError, match=r"e\.npy: not a \.npy file of numbers"):
            run_import(store, file, embeddings=(tmp_path / "e.npy",))
    with s2rstore.open(store) as opened:
        assert opened.runs == {}


def test_what_needs_a_network_says_so(store, tmp_path):
    run_import(store, write_csv(tmp_path / "p.csv", make(store)))
    with s2rstore.open(store) as opened:
        for kind in ("activation", "map:occlusion"):
            with pytest.raises(NotComputedError, match="'theirs': its predictions were imported; "
                               f"{kind.removeprefix('map:')} needs a network"):  # fmt: skip
                opened._records_of("theirs", kind, "sim", None)
        with pytest.raises(NotComputedError, match="imported without embeddings"):
            opened.array("theirs", "embedding", "sim")
        with pytest.raises(NotComputedError, match="run `s2r precompute`"):
            opened.array("theirs", "pixel_difference", None, "rgb")


def test_a_wrong_unit_of_lengths_is_told_with_the_one_that_fits(store, tmp_path):
    """The predictions lie off the map, or all fall on one point of it."""
    made, scale = make(store), [1000, 1000, 1]
    millimetres = write_csv(tmp_path / "p.csv", Made(made.sim * scale, made.real * scale))
    (warning,) = run_import(store, millimetres, units="m").warnings
    assert f"positions in m: {2 * N} of {2 * N} predictions lie more than 10 m" in warning
    assert "with --units mm it would be 0.2" in warning
    (warning,) = run_import(store, write_csv(tmp_path / "p.csv", made), units="mm").warnings
    assert "positions in mm: the median position error is" in warning
    assert "off the map" not in warning
    assert "with --units m it would be 0.2" in warning


def test_a_few_predictions_far_off_the_map_are_counted(store, tmp_path):
    made = make(store)
    made.real[3, :2] = 400, -90
    (warning,) = run_import(store, write_csv(tmp_path / "p.csv", made)).warnings
    assert f"1 of {2 * N} predictions lie more than 10 m" in warning
    assert "--units" not in warning


@pytest.mark.parametrize("is_wide", [False, True])
def test_a_side_without_numbers_is_told_with_columns_and_first_line(store, tmp_path, is_wide):
    made = make(store)
    made.real[:, 1] = np.nan
    path = tmp_path / "p.csv"
    if is_wide:
        names = ("iid", *(f"{side}_{name}" for side in SIDES for name in ("x", "y", "heading")))
        write_rows(path, names, [(i, *made.sim[i], *made.real[i]) for i in range(N)])
    else:
        write_csv(path, made)
    column, line = ("real_y", 2) if is_wide else ("y", N + 2)
    with pytest.raises(RequestError) as error:
        run_import(store, path)
    assert str(error.value).endswith(
        f"(sim {N}, real 0); real: {N} of its {N} rows in p.csv have no number "
        f"(columns {column}; the first is p.csv:{line})"
    )


def test_rows_of_view_pair_with_units_give_the_stored_poses(tiny_store, store_copy, tmp_path):
    file = tmp_path / "rows.csv"
    query = "SELECT * EXCLUDE (run) FROM pair WHERE run = 'vanilla' ORDER BY iid"
    assert main(["sql", str(tiny_store), query, "--format", "csv", "--out", str(file)]) == 0
    run_import(store_copy, file, name="again")
    assert_equal(predicted(store_copy, "again"), predicted(store_copy, "vanilla"), 1e-9)


def test_a_column_with_its_unit_is_preferred(tmp_path):
    file = tmp_path / "rows.csv"
    file.write_text("iid,side,x,y,heading,x_m,y_m,heading_rad\n0,sim,7,7,7,1,2,3\n")
    table = read_table(file)
    assert {name: table.numbers[name].tolist() for name in ("x", "y", "heading_rad")} == {
        "x": [1.0], "y": [2.0], "heading_rad": [3.0],
    }  # fmt: skip
    assert "heading" not in table.numbers

"""Log files: written logs can be read, and every error is one line that names the place."""

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from bench.support import robot
from s2rstore.errors import RequestError
from s2rstore.geometry import angles
from s2rtools.motion_logs import csv_reader, read
from tests.support.refusals import refused

GOOD = "time,x,y,heading\n0,0,0,0\n0.1,1,0,0.5\n"


def test_csv_logs_are_read_exactly(tmp_path):
    drive = robot.pair(1, seconds=5.0)
    csv_reader.write(drive.real, tmp_path / "real.csv")
    loaded = read(tmp_path / "real.csv")
    for name in ("time", "x", "y", "heading"):
        assert (getattr(loaded, name) == getattr(drive.real, name)).all()
    assert loaded.source == str(tmp_path / "real.csv")
    assert len(loaded.sha256) == 64


def test_csv_may_have_reordered_columns_degrees_comments_and_a_bom(tmp_path):
    path = tmp_path / "a.csv"
    text = "\ufeff# from the lab\r\nheading_deg, y ,battery,time,x\r\n"
    path.write_text(text + "90,2,full,0,1\r\n\r\n# a pause\r\n-270,3,low,0.5,4\r\n", "utf-8")
    log = read(path)
    assert log.x.tolist() == [1, 4]
    assert log.y.tolist() == [2, 3]
    assert log.heading == pytest.approx([np.pi / 2, np.pi / 2])


@given(st.lists(st.floats(-np.pi, 3.14), min_size=2, max_size=20))
def test_tum_headings_are_yaw_angles(tmp_path_factory, yaws):
    path = tmp_path_factory.mktemp("tum") / "a.tum"
    rows = ["# timestamp tx ty tz qx qy qz qw"]
    for i, yaw in enumerate(yaws):
        q = 2.0 * Rotation.from_euler("ZYX", [yaw, 0.3, -0.2]).as_quat()
        rows.append(" ".join(map(repr, [0.1 * i, i, -i, 9.0, *q.tolist()])))
    path.write_text("\n".join(rows) + "\n")
    log = read(path)
    assert angles.distance(log.heading, np.array(yaws)).max() < 1e-9
    assert log.y.tolist() == [-float(i) for i in range(len(yaws))]


@pytest.mark.parametrize(
    ("name", "content", "expected"),
    [
        ("a.csv", b"", r"a\.csv: no rows"),
        ("a.csv", b"# only a remark\n", r"a\.csv: no rows below a line of column names"),
        ("a.csv", b"time,x,y,heading\n", r"a\.csv: no rows"),
        ("a.csv", b"time,x,y,heading\n0,0,0,0\n", r"a\.csv: 1 poses"),
        ("a.csv", b"time,x,heading\n0,0,0\n1,0,0\n", r"a\.csv: no column y \(has: time, x"),
        ("a.csv", b"time,x,y\n0,0,0\n1,0,0\n", r"no column heading \(rad\) or heading_deg"),
        ("a.csv", b"time,x,x,y,heading\n0,0,0,0,0\n", r"a\.csv:1: column x exists more than once"),
        ("a.csv", b"# c\n" + GOOD.encode() + b"0.2,nan,0,0\n", r"a\.csv:5: x is nan; remove"),
        ("a.csv", GOOD.encode() + b"0.2,1,,0\n", r"a\.csv:4: y is empty, not a number"),
        ("a.csv", GOOD.encode() + b"0.2,1,0\n", r"a\.csv:4: 3 values for 4 columns"),
        ("a.csv", GOOD.encode() + b"0.05,1,0,0\n", r"a\.csv:4: the clock runs backward \(0\.1 s"),
        ("a.csv", GOOD.encode() + b"0.1,1,0,0\n", r"a\.csv:4: the clock stands still"),
        ("a.csv", b"time,x,y,heading\n\xff\xfe,1,2,3\n", r"a\.csv:2: not UTF-8"),
        ("a.tum", b"# nothing\n", r"a\.tum: no row of 8 numbers"),
        (
            "a.tum",
            b"0 0 0 0 0 0 0 1\n1 0 0 0 0 0 1\n",
            r"a\.tum:2: 7 values, expected 8; a line has time tx",
        ),
        ("a.tum", b"0 0 0 0 0 0 0 1\n1 0 0 0 0 0 0 0\n", r"a\.tum:2: the quaternion is 0"),
        ("a.tum", b"0 0 0 0 0 0 0 1\n1 nan 0 0 0 0 0 1\n", r"a\.tum:2: tx is nan"),
        ("a.tum", b"1 0 0 0 0 0 0 1\n#\n0 0 0 0 0 0 0 1\n", r"a\.tum:3: the clock runs backward"),
        ("a.xlsx", b"PK", r"a\.xlsx: unknown log format"),
    ],
)
def test_errors_are_one_line_with_the_position(tmp_path, name, content, expected):
    (tmp_path / name).write_bytes(content)
    with refused(match=expected):
        read(tmp_path / name)


def test_a_missing_file_and_a_topic_for_csv_are_rejected(tmp_path):
    with pytest.raises(RequestError, match=r"gone\.csv: cannot be read \(No such file"):
        read(tmp_path / "gone.csv")
    (tmp_path / "a.csv").write_text(GOOD)
    with pytest.raises(RequestError, match="has no topics"):
        read(tmp_path / "a.csv", "/odom")


def test_the_default_period_is_the_median_step(tmp_path):
    path = tmp_path / "commands.csv"
    path.write_text("time,v\n0,1\n0.1,1\n0.2,0\n0.9,0\n")
    assert csv_reader.read_commands(path).period == pytest.approx(0.1)


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("t,v\n0,1\n", r"commands\.csv: no column time"),
        ("time\n0\n1\n", r"commands\.csv: no channel"),
        ("time,v\n0,1\n", r"one row and no period"),
        ("# period = 0\ntime,v\n0,1\n", r"commands\.csv:1: period is 0 s"),
        ("# period = soon\ntime,v\n0,1\n", r"commands\.csv:1: period is soon, not a number"),
        ("time,v\n0,1\n0,2\n", r"commands\.csv:3: the clock stands still"),
        ("time,v\n0,nan\n", r"commands\.csv:2: v is nan"),
    ],
)
def test_invalid_commands_are_rejected(tmp_path, text, expected):
    (tmp_path / "commands.csv").write_text(text)
    with pytest.raises(RequestError, match=expected):
        csv_reader.read_commands(tmp_path / "commands.csv")


@pytest.mark.parametrize(
    ("change", "expected"),
    [(lambda t: t * 1e9, r"csv:3: 2e\+08 s after the pose before it; are the times in seconds"),
     (lambda t: np.where(t > 1, t + 1.7e9, t), r"csv:8: 1\.7e\+09 s after .* split the log there"),
     (lambda t: t * 1e300, "are the times in seconds")],
)  # fmt: skip
def test_clocks_in_other_units_or_with_jumps_are_rejected(tmp_path, change, expected):
    times = change(0.2 * np.arange(20))
    rows = "\n".join(f"{float(time)!r},1,2,0" for time in times)
    (tmp_path / "a.csv").write_text(f"time,x,y,heading\n{rows}\n")
    with pytest.raises(RequestError, match=expected):
        read(tmp_path / "a.csv")


@pytest.mark.parametrize("pose", ["0,-1e308,0", "0,0,1e300"])
def test_implausibly_large_poses_are_rejected(tmp_path, pose):
    (tmp_path / "a.csv").write_text(f"time,x,y,heading\n0,0,0,0\n0.1,{pose}\n")
    with pytest.raises(RequestError, match=r"a\.csv:3: a pose beyond 1e\+09 m or rad"):
        read(tmp_path / "a.csv")


def tum(path: Path, x: list[float], y: list[float], z: list[float]) -> Path:
    """A TUM log of positions at 10 Hz without rotation."""
    rows = [
        f"{0.1 * i} {a} {b} {c} 0 0 0 1" for i, (a, b, c) in enumerate(zip(x, y, z, strict=True))
    ]
    path.write_text("\n".join(rows) + "\n")
    return path


def test_a_tum_log_whose_z_does_not_point_up_is_refused(tmp_path):
    """Such as poses in the axes of a camera, in which a robot on a floor moves along z."""
    path = tum(tmp_path / "a.tum", [0, 1, 2, 2], [0.4] * 4, [0, 0, 1, 3])
    with pytest.raises(RequestError, match=r"a\.tum: z spans 3 m where x and y span 2 m; z must"):
        read(path)


def test_a_slope_is_reported_and_noise_of_z_is_not(tmp_path):
    sloped = read(tum(tmp_path / "a.tum", [0, 5, 10], [0, 0, 1], [0, 0.4, 0.8]))
    assert sloped.x.tolist() == [0, 5, 10]
    (warning,) = sloped.warnings
    assert "z spans 0.8 m" in warning
    assert read(tum(tmp_path / "b.tum", [0, 0.1], [0, 0], [1.0, 1.1])).warnings == ()

"""Nightly configurations: defaults, all keys and one-line errors."""

from __future__ import annotations

from pathlib import Path

import pytest

from s2rstore.gap_history.change_check import YEAR_LEVEL
from s2rtools.gap.axis import GapSettings
from s2rtools.gap.gate.gate import GapRequest
from s2rtools.nightly import config
from s2rtui.cli import main
from tests.support.refusals import refused

SYSID = 'store = "s.s2r"\n[sysid]\ndrives = "drives"\n'


def write_config(tmp_path: Path, text: str) -> Path:
    (tmp_path / "s.s2r").mkdir(exist_ok=True)
    (tmp_path / "drives").mkdir(exist_ok=True)
    (tmp_path / "there.json").write_text("{}")
    path = tmp_path / "gate.toml"
    path.write_text(text)
    return path


def test_missing_keys_have_defaults_and_paths_are_relative_to_the_file(tmp_path):
    parsed = config.read(write_config(tmp_path, 'store = "s.s2r"'))
    assert parsed.name == "gate"
    assert parsed.history == (tmp_path / "s.s2r/history/gap.jsonl").resolve()
    assert parsed.reports == (tmp_path / "reports/gate").resolve()
    request = parsed.request
    unset = (request.run, request.drives, parsed.sysid, parsed.metrics, request.axes)
    assert unset == (None, None, None, None, ())
    assert (request.threshold, request.margin) == (15.0, 0.05)
    assert request.settings.seed == 1


def test_drives_of_the_store_are_the_default(tmp_path):
    path = write_config(tmp_path, 'store = "s.s2r"\n[sysid]\nseed = 2')
    store_drives = tmp_path / "s.s2r" / "drives"
    store_drives.mkdir()
    parsed = config.read(path)
    assert parsed.request.drives == str(store_drives.resolve())
    assert parsed.sysid == config.SysidTable(str(store_drives.resolve()), seed=2)


def test_all_keys_are_read(tmp_path):
    text = """
        name = "lab"
        store = "s.s2r"
        run = "r"
        select = "worst15"
        axes = ["task", "delay"]
        reference = "there.json"
        golden = "there.json"
        features = "there.json"
        threshold = 20
        margin = 0.1
        seed = 4
        [drives]
        folder = "drives"
        topic = "/odom"
        dynamics = ["horizons=1,2", "align=rigid"]
        [sysid]
        simulator = "mujoco"
        parameters = ["mass", "damping"]
        fix = { track = 0.4 }
        range = { latency = "0..0.5", mass = "5..30:log" }
        seeds = 2
        [output]
        history = "h.jsonl"
        reports = "r"
        metrics = "m.prom"
        [stale]
        after_days = 1.5
    """
    parsed = config.read(write_config(tmp_path, text))
    folder = tmp_path.resolve()
    there = folder / "there.json"
    assert parsed.request == GapRequest(
        run="r", expression="worst15", axes=("task", "delay"), reference=there, golden=there,
        features=there, threshold=20.0, margin=0.1, drives=str(folder / "drives"), topic="/odom",
        options={"horizons": "1,2", "align": "rigid"},
        settings=GapSettings(fail_level=YEAR_LEVEL, seed=4),
    )  # fmt: skip
    assert parsed.stale_after == 1.5
    assert parsed.sysid == config.SysidTable(
        str(folder / "drives"), "mujoco", ("mass", "damping"), {"track": 0.4}, 1, 2, None,
        {"latency": "0..0.5", "mass": "5..30:log"},
    )  # fmt: skip
    assert (parsed.history, parsed.reports, parsed.metrics) == (
        folder / "h.jsonl", folder / "r", folder / "m.prom",
    )  # fmt: skip


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("", "store: missing"),
        ("store =", "not valid TOML"),
        ('store = "nowhere.s2r"', "store:.*no such folder"),
        ('stroe = "s.s2r"', "stroe: unknown key; did you mean store. known: store, name"),
        ('store = "s.s2r"\n[output]\nmetric = "m"', "output.metric: unknown key; did you mean"),
        ('store = "s.s2r"\noutput = 3', "output: expected a table, got 3"),
        ("store = 3", "store: expected text, got 3"),
        ('store = "s.s2r"\nthreshold = "15"', 'threshold: expected a number, got "15"'),
        ('store = "s.s2r"\nthreshold = nan', "threshold: expected a finite number"),
        ('store = "s.s2r"\nthreshold = 0', "threshold: expected a number > 0"),
        ('store = "s.s2r"\nseed = 1.5', "seed: expected a whole number, got 1.5"),
        ('store = "s.s2r"\naxes = ["tsak"]', "axes: 'tsak': expected one of visual, task"),
        ('store = "s.s2r"\naxes = ["task", "task"]', "axes: an axis is listed twice"),
        ('store = "s.s2r"\naxes = [1]', r"axes\[0\]: expected text, got 1"),
        ('store = "s.s2r"\nname = "a b"', "name: 'a b'"),
        ('store = "s.s2r"\nrun = " "', "run: must not be empty"),
        ('store = "s.s2r"\nreference = "no.json"', "reference:.*no such file"),
        ('store = "s.s2r"\ngolden = "drives"', "golden:.*no such file"),
        ('store = "s.s2r"\n[drives]\nfolder = "there.json"', "drives.folder:.*no such folder"),
        ('store = "s.s2r"\n[sysid]\nsimulator = "a"', "sysid.drives: missing"),
        ('store = "s.s2r"\n[drives]\nfolder = "odometry"\n[sysid]\nseed = 1', "sysid.drives"),
        ('store = "s.s2r"\n[sysid]\nfix = { track = "a" }', "sysid.fix.track: expected a number"),
        ('store = "s.s2r"\n[sysid]\nparameters = "mass"', "sysid.parameters: expected a list"),
        (f'{SYSID}simulator = "bullet"', "sysid: simulator bullet: unknown .known: planar"),
        (f'{SYSID}parameters = ["mas"]', "sysid: mas: no parameter of the simulator planar"),
        (f'{SYSID}fix = {{ track = 9 }}', "sysid: track=9: out of its range"),
        (f'{SYSID}fix = {{ latency = 0.1 }}', "sysid: latency: always searched"),
        (f'{SYSID}range = {{ latency = 3 }}', "sysid.range.latency: expected text, got 3"),
        (f'{SYSID}range = {{ latency = "3" }}', "sysid: range.latency=3: expected LOW..HIGH"),
        (f'{SYSID}range = {{ track = "1..2" }}', "sysid: track: not searched"),
        ('store = "s.s2r"\n[drives]\ndynamics = ["reach=x"]', "drives.dynamics: reach=x: expected"),
        ('store = "s.s2r"\n[stale]\nafter_days = -1', "stale.after_days: expected a number >= 0"),
        pytest.param(
            f"{SYSID}fix = {{ mass = {10**400} }}", "sysid.fix.mass: .* at most 64", id="huge mass"
        ),
        pytest.param("store = " + "[" * 50_000, "not valid TOML", id="deep"),
        ('store = "~no-such-user/s.s2r"', "~no-such-user/s.s2r: the user has no home folder"),
        ('store = "s.s2r"\n[output]\nmetrics = "drives"', "output.metrics: .*s: a folder or"),
        ('store = "s.s2r"\n[output]\nhistory = "s.s2r"', "output.history: .*: a folder or a"),
        ('store = "s.s2r"\n[output]\nmetrics = "gate.toml"', "output.metrics: .*is another file"),
        ('store = "s.s2r"\n[output]\nhistory = "a"\nmetrics = "./a"', "output.metrics: .*is anoth"),
        ('store = "s.s2r"\ngolden = "there.json"\n[output]\nmetrics = "there.json"',
         "output.metrics: .*there.json: is another file"),
    ],
)  # fmt: skip
def test_invalid_configurations_name_the_key(tmp_path, text, expected):
    path = write_config(tmp_path, text)
    with refused(match=rf"gate\.toml: {expected}"):
        config.read(path)


def test_invalid_requests_write_nothing(tmp_path, capsys):
    path = write_config(tmp_path, 'store = "s.s2r"\nthreshold = 0')
    before = sorted(tmp_path.rglob("*"))
    assert main(["nightly", str(path)]) == 2
    assert main(["nightly", str(tmp_path / "none.toml")]) == 2
    valid = write_config(tmp_path, 'store = "s.s2r"')
    assert main(["nightly", str(valid), "--night", "21.11.2026"]) == 2
    assert main(["nightly", str(valid), "--night", "9999-12-31"]) == 2
    assert main(["nightly", str(valid)]) == 2  # the folder is not a store
    error = capsys.readouterr().err
    assert "threshold: expected a number > 0, got 0" in error
    assert "none.toml: cannot be read (No such file" in error
    assert "--night 21.11.2026: is not a date; write it as 2026-11-21" in error
    assert "--night 9999-12-31: is more than a week after today" in error
    assert "not a store" in error
    assert sorted(tmp_path.rglob("*")) == before

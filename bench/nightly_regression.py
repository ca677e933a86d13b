"""A week of nightly runs with a regression on day 5: it must be reported on days 5 and 6 only.

`python -m bench.nightly_regression` renders images on the same course through the default building
every day, predicts them with a pretrained model, records twelve drives, and starts `s2r nightly`
twice. On days 5 and 6 the world is changed (`--factors`, by default lamps are off); day 7 has the
original world. One line per day shows the exit code, JUnit, metrics and the dashboard's
expressions, and whether the second start left all files unchanged. The exit code is 1 if any of
them is wrong.
"""

from __future__ import annotations

import argparse
import contextlib
import datetime
import io
import json
import os
import re
import shutil
import sys
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from xml.etree import ElementTree as ET

os.environ.setdefault("OMP_WAIT_POLICY", "PASSIVE")
os.environ.setdefault("GOMP_SPINCOUNT", "0")

from prometheus_client.openmetrics import parser as openmetrics

from bench.tour_stores import Severities, tours_store
from s2rstore.gap_history import reader
from s2rtools.synthetic_world.factors import parse_factors
from s2rtools.sysid.synthetic_drives import SEVERITIES, make_drives
from s2rtui.cli import main as s2r

FIRST = datetime.date(2026, 11, 16)
BROKEN, MENDED, DAYS = 5, 7, 7
HEALTHY: Severities = {"sensor": 0.5}
"""Camera noise of every day."""
COURSE, COUNT = 7, 64
DASHBOARD = Path(__file__).parents[1] / "examples" / "grafana-dashboard.json"
_SELECTOR = re.compile(r"(s2r_\w+)(?:\{([^}]*)\})?")
_LABEL = re.compile(r'(\w+)="([^"]*)"')
_CONFIG = """
name = "week"
store = "lab.s2r"
run = "today"
reference = "reference.json"
golden = "golden.json"
[drives]
folder = "drives"
[sysid]
parameters = ["damping"]
seeds = 1
[output]
reports = "reports"
metrics = "gap.prom"
[stale]
after_days = 2
"""

Samples = list[tuple[str, dict[str, str], float]]


@dataclass(frozen=True, slots=True)
class NightFiles:
    """Contents of one night's files; `problems` lists deviations from the expected contents."""

    day: int
    code: int
    night: dict[str, Any]
    failures: list[str]
    outcome: str
    problems: list[str]


def main() -> int:
    parser = argparse.ArgumentParser(prog="python -m bench.nightly_regression", description=__doc__)
    parser.add_argument("--factors", default="lights", help="factors that are on from day 5 to 6")
    parser.add_argument("--keep", type=Path, metavar="DIR", help="a new folder; default: none")
    options = parser.parse_args()
    wrong = {name: value for name, value in parse_factors(options.factors).items() if value}
    with _folder(options.keep) as folder:
        os.environ["XDG_DATA_HOME"] = str(folder / "home")
        accept(folder)
        print(_HEAD)
        bad = 0
        for day in range(1, DAYS + 1):
            broken = BROKEN <= day < MENDED
            record(folder, day, wrong if broken else {})
            night_files = night(folder, day, red=broken)
            bad += bool(night_files.problems)
            print(_line(night_files), flush=True)
        bad += not _kept(folder)
        look(folder)
    return 1 if bad else 0


def accept(folder: Path) -> None:
    """Freeze the reference on a day with all factors and the golden run on a day without any."""
    record(folder, -1, parse_factors("all"))
    _command("gap", folder / "lab.s2r", "--run", "today", "--drives", folder / "drives",
             "--anchor-run", "today", "--freeze", folder / "reference.json")  # fmt: skip
    record(folder, 0, {})
    _command("gap", folder / "lab.s2r", "--run", "today", "--axis", "task", "--freeze-golden",
             folder / "golden.json")  # fmt: skip
    (folder / "nightly.toml").write_text(_CONFIG)


def record(folder: Path, day: int, wrong: Severities) -> None:
    """Replace yesterday's store and drives by today's; the history stays."""
    store, fresh, history = (folder / name for name in ("lab.s2r", "fresh.s2r", "history"))
    tours_store(fresh, [COURSE], COUNT, {"today": ({}, {**HEALTHY, **wrong})}, noise=day + 1)
    for place, goal in ((store / "history", history), (fresh, store), (history, store / "history")):
        if place.exists():
            shutil.rmtree(goal, ignore_errors=True)
            place.rename(goal)
    shutil.rmtree(folder / "drives", ignore_errors=True)
    robot = {name: value for name, value in wrong.items() if name in SEVERITIES}
    make_drives(folder / "drives", 100 + day, robot)


def night(folder: Path, day: int, red: bool) -> NightFiles:
    """Run the night twice and read its files."""
    date = str(FIRST + datetime.timedelta(days=day - 1))
    words = ("nightly", folder / "nightly.toml", "--night", date, "--json")
    code, text = _command(*words)
    before, rows = files(folder), reader.read(folder / "lab.s2r/history/gap.jsonl").nights
    again, _ = _command(*words)
    found = json.loads(text)
    wanted = ("FAIL", 1) if red else ("PASS", 0)
    failures = junit_failures(folder / "reports" / date / "junit.xml")
    samples = scraped(folder / "gap.prom")
    outcomes = [
        labels for name, labels, value in samples if name == "s2r_gap_outcome" and value == 1
    ]
    outcome = next(labels["outcome"] for labels in outcomes if labels["axis"] == "all")
    shown = [labels["outcome"] for labels, _ in panel("Gate", samples)]
    checks = {
        f"exit code {code}": (found["outcome"], code) == wanted,
        "junit": ("headline" in failures) == bool(failures) == red,
        f"metrics {outcome}": outcome == wanted[0],
        f"dashboard {shown}": shown == [wanted[0]],
        "the second start says otherwise": again == code,
        "the second start changed files": files(folder) == before,
        "history": len(rows) == day and rows[-1].outcome == wanted[0],
        **{f"no sample for {each}": False for each in unanswered(samples)},
    }
    problems = [name for name, good in checks.items() if not good]
    return NightFiles(day, code, found, failures, outcome, problems)


def files(folder: Path) -> dict[Path, tuple[bytes, int]]:
    """Content and modification time of all files that a night may write, without locks."""
    roots = (folder / "lab.s2r" / "history", folder / "reports")
    found = [path for root in roots for path in root.rglob("*") if path.is_file()]
    found = [path for path in (*found, folder / "gap.prom") if path.suffix != ".lock"]
    return {path: (path.read_bytes(), path.stat().st_mtime_ns) for path in found}


def junit_failures(path: Path) -> list[str]:
    """Names of the test cases that fail."""
    cases = ET.parse(path).getroot().iter("testcase")
    return [case.attrib["name"] for case in cases if case.find("failure") is not None]


def scraped(path: Path) -> Samples:
    """The samples of an OpenMetrics file."""
    families = openmetrics.text_string_to_metric_families(path.read_text())
    return [(s.name, dict(s.labels), s.value) for family in families for s in family.samples]


def panel(title: str, samples: Samples) -> list[tuple[dict[str, str], float]]:
    """The values of a panel whose first expression is a selector compared with 1."""
    (found,) = (each for each in _panels() if each["title"] == title)
    expression = found["targets"][0]["expr"]
    return [(labels, value) for labels, value in selected(expression, samples)
            if "== 1" not in expression or value == 1]  # fmt: skip


def selected(expression: str, samples: Samples) -> Iterator[tuple[dict[str, str], float]]:
    """The samples that a dashboard's expression names, for any value of its other variables."""
    for name, wanted in _SELECTOR.findall(expression):
        given = {**dict(_LABEL.findall(wanted)), "nightly": "week", "run": "today"}
        for sample, labels, value in samples:
            if sample == name and all(labels.get(key) == text for key, text in given.items()
                                      if not text.startswith("$")):  # fmt: skip
                yield labels, value


def unanswered(samples: Samples) -> list[str]:
    """Expressions of the dashboard that match no sample."""
    expressions = [target["expr"] for each in _panels() for target in each.get("targets", ())]
    return [each for each in expressions if not any(True for _ in selected(each, samples))]


def look(folder: Path) -> None:
    """Write images of the history view and of the report into the folder."""
    for suffix in ("png", "txt"):
        _command("snapshot", folder / "lab.s2r", "--size", "120x40", "--keys", "G", "--out",
                 folder / f"history.{suffix}")  # fmt: skip


def _kept(folder: Path) -> bool:
    """Whether the history has one row per day in order, failing on the regression days only."""
    found = reader.read(folder / "lab.s2r/history/gap.jsonl").of_configuration("week")
    wanted = [1 if BROKEN <= day < MENDED else 0 for day in range(1, DAYS + 1)]
    nights = [FIRST + datetime.timedelta(days=day) for day in range(DAYS)]
    good = [each.exit_code for each in found] == wanted and [each.night for each in found] == nights
    print(f"history: {len(found)} nights, exit codes {[each.exit_code for each in found]}"
          f"{'' if good else '  OUTSIDE THE LIMIT'}")  # fmt: skip
    return good


def _panels() -> list[dict[str, Any]]:
    return list(json.loads(DASHBOARD.read_text())["panels"])


def _command(*words: object) -> tuple[int, str]:
    """Exit code and standard output of `s2r`."""
    out = io.StringIO()
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(io.StringIO()) as said:
        code = s2r([str(word) for word in words])
    if code not in (0, 1, 3):
        raise SystemExit(f"s2r {words[0]}: exit code {code}: {said.getvalue()}")
    return code, out.getvalue()


@contextlib.contextmanager
def _folder(keep: Path | None) -> Iterator[Path]:
    if keep is None:
        with tempfile.TemporaryDirectory() as name:
            yield Path(name)
    else:
        keep.mkdir(parents=True)
        yield keep.resolve()


_HEAD = "day  exit  verdict       G                    worst     golden  JUnit failures / not so"


def _line(night_files: NightFiles) -> str:
    found = night_files.night
    gap = f"{found['gap']:.1f} ({found['gap_low']:.1f} .. {found['gap_high']:.1f})"
    failures = ", ".join(night_files.failures) or "-"
    problems = f"  PROBLEMS: {'; '.join(night_files.problems)}" if night_files.problems else ""
    return (f"{night_files.day:3d}  {night_files.code:4d}  {found['outcome']:<12}  {gap:<19}  "
            f"{found['worst']:<8}  {found['golden']:<6}  {failures}{problems}")  # fmt: skip


if __name__ == "__main__":
    sys.exit(main())

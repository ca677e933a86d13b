"""What the files of a night say: JUnit, metrics, HTML, Markdown, JSON."""

from __future__ import annotations

import base64
import datetime
import io
import json
import re
from html.parser import HTMLParser
from xml.etree import ElementTree as ET

import numpy as np
from PIL import Image
from prometheus_client.openmetrics import parser as openmetrics
from prometheus_client.parser import text_string_to_metric_families

from s2rstore.gap_history import reader
from s2rtools.nightly.config import NightlyConfig
from s2rtools.nightly.metrics import metrics
from s2rtools.nightly.run import nightly
from tests.support import nights
from tests.support.nights import Week, day

_CASE = {"failure": {"message", "type"}, "skipped": {"message"}, "system-out": set()}
Samples = dict[tuple[str, frozenset[tuple[str, str]]], float]


def cases(week: Week, number: int) -> dict[str, ET.Element]:
    root = ET.parse(week.config.reports / str(day(number)) / "junit.xml").getroot()
    return {case.attrib["name"]: case for case in root.iter("testcase")}


def told(week: Week, number: int, name: str) -> str:
    return (week.config.reports / str(day(number)) / name).read_text()


def samples(text: str) -> Samples:
    return {
        (sample.name, frozenset(sample.labels.items())): sample.value
        for family in openmetrics.text_string_to_metric_families(text)
        for sample in family.samples
    }


def one(found: Samples, name: str, **labels: str) -> float:
    wanted = {("nightly", "lab"), ("dataset", "tiny"), ("run", "vanilla"), *labels.items()}
    return found[name, frozenset(wanted)]


def test_junit_has_the_common_structure(told_week: Week) -> None:
    for number in range(1, 8):
        root = ET.parse(told_week.config.reports / str(day(number)) / "junit.xml").getroot()
        assert root.tag == "testsuites"
        (suite,) = root
        assert suite.tag == "testsuite"
        listed = suite.findall("testcase")
        counted = {
            "tests": len(listed),
            "failures": len(suite.findall("testcase/failure")),
            "skipped": len(suite.findall("testcase/skipped")),
            "errors": len(suite.findall("testcase/error")),
        }
        for element in (root, suite):
            assert {name: int(element.attrib[name]) for name in counted} == counted
        datetime.datetime.fromisoformat(suite.attrib["timestamp"])
        assert suite[0].tag == "properties"
        for case in listed:
            assert set(case.attrib) == {"classname", "name", "time"}
            assert float(case.attrib["time"]) >= 0
            (result,) = case
            assert set(result.attrib) == _CASE[result.tag]


def test_junit_fails_from_day_five_on(told_week: Week) -> None:
    names = {"headline", "visual", "task", "dynamics", "delay", "golden", "staleness"}
    for number in range(1, 8):
        found = cases(told_week, number)
        assert set(found) == names
        red = {name for name, case in found.items() if case.find("failure") is not None}
        assert red == ({"headline", "task"} if number >= 5 else set())
        assert found["delay"].find("skipped") is not None
    failure = cases(told_week, 5)["headline"].find("failure")
    assert failure is not None
    assert "worst axis task" in failure.attrib["message"]


def test_junit_skips_what_decides_nothing_and_what_is_stale(config: NightlyConfig) -> None:
    def unsure(store, config) -> dict:
        lacking = {"inconclusive": {"visual": "3 images & <few>\x00"}, "absent": {"delay": "none"}}
        return nights.report(store, {"task": 14.5}, **lacking)

    nightly(config, day(1), unsure, lambda *asked: ())
    done = nightly(config, day(9), unsure, lambda *asked: ())
    assert done.night.exit_code == 3
    root = ET.parse(config.reports / str(day(9)) / "junit.xml").getroot()
    found = {case.attrib["name"]: case[0] for case in root.iter("testcase")}
    assert {name: each.tag for name, each in found.items()} == {
        "headline": "skipped", "task": "skipped", "visual": "skipped", "delay": "skipped",
        "golden": "skipped", "staleness": "skipped",
    }  # fmt: skip
    assert found["visual"].attrib["message"].startswith("inconclusive: ")
    assert "3 images & <few>" in found["visual"].attrib["message"]
    assert "8 days old" in found["staleness"].attrib["message"]
    assert config.metrics is not None
    found_samples = samples(config.metrics.read_text())
    assert one(found_samples, "s2r_gap_stale") == 1
    assert one(found_samples, "s2r_gap_evidence_age_days") == 8
    assert one(found_samples, "s2r_gap_outcome", axis="visual", outcome="INCONCLUSIVE") == 1


def test_metrics_are_what_the_history_holds(told_week: Week) -> None:
    found = reader.read(told_week.config.history).of_configuration("lab")
    for night in found:
        read = samples(metrics(night).decode())
        for axis, gap in {"headline": night.gap, **{a.axis: a.gap for a in night.axes[:3]}}.items():
            assert one(read, "s2r_gap", axis=axis) == gap.value
            assert one(read, "s2r_gap_low", axis=axis) == gap.low
            assert one(read, "s2r_gap_high", axis=axis) == gap.high
        for word in ("PASS", "FAIL", "INCONCLUSIVE"):
            held = one(read, "s2r_gap_outcome", axis="all", outcome=word)
            assert held == (word == night.outcome)
        assert one(read, "s2r_gap_exit_code", axis="all") == night.exit_code
        assert one(read, "s2r_gap_estimate", parameter="damping", unit="1/s") == 0.8
        assert one(read, "s2r_gap_estimate_high", parameter="damping", unit="1/s") == 0.86
        assert one(read, "s2r_gap_golden_change_metres") == night.golden_change.value
        written = datetime.datetime.fromisoformat(night.written_at).timestamp()
        assert one(read, "s2r_gap_computed_timestamp_seconds") == written
        axes = {dict(labels).get("axis") for name, labels in read if name == "s2r_gap"}
        assert axes == {"headline", "visual", "task", "dynamics"}  # delay has no figure
        assert not any(np.isnan(value) for value in read.values())
        unknown = [n for n, labels in read if ("parameter", "mass") in labels and n.endswith("low")]
        assert unknown == []


def test_metrics_are_read_by_collectors_of_the_older_format(told_week: Week) -> None:
    assert told_week.config.metrics is not None
    text = told_week.config.metrics.read_text()
    assert text.endswith("# EOF\n")
    assert {family.type for family in text_string_to_metric_families(text)} == {"gauge"}
    newest = reader.read(told_week.config.history).of_configuration("lab")[-1]
    assert text == metrics(newest).decode()


def test_names_with_quotes_survive_the_metrics(told_week: Week) -> None:
    from dataclasses import replace

    night = reader.read(told_week.config.history).nights[0]
    read = samples(metrics(replace(night, dataset='a "b"\\ \n c')).decode())
    assert any(("dataset", 'a "b"\\ \n c') in labels for _, labels in read)


class _Page(HTMLParser):
    def __init__(self) -> None:
        super().__init__()
        self.images: list[str] = []
        self.elsewhere: list[str] = []
        self.open: list[str] = []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        found = dict(attrs)
        if tag == "img":
            assert found["alt"]
            self.images.append(str(found["src"]))
        self.elsewhere += [str(found[name]) for name in ("href", "srcset") if name in found]
        assert tag != "script"
        if tag not in ("meta", "img", "link", "br"):
            self.open.append(tag)

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag


def test_the_page_needs_nothing_else(told_week: Week) -> None:
    page = _Page()
    text = told(told_week, 5, "report.html")
    page.feed(text)
    assert page.open == []
    assert page.elsewhere == []
    (image,) = page.images
    picture = base64.b64decode(image.removeprefix("data:image/png;base64,"))
    folder = told_week.config.reports / str(day(5))
    assert picture == (folder / "history.png").read_bytes()
    assert "▲ FAIL" in text
    assert "worst axis task" in text


def test_a_name_is_no_markup(config: NightlyConfig) -> None:
    def odd(store, config) -> dict:
        return nights.report(store, {"task": 5.0}, expression="<b>|x|</b>", model="*m*")

    nightly(config, day(1), odd, lambda *asked: ())
    folder = config.reports / str(day(1))
    assert "&lt;b&gt;|x|" in (folder / "report.html").read_text()
    assert r"\<b\>\|x\|" in (folder / "report.md").read_text()


def test_the_picture_shows_each_night_in_the_colour_of_its_result(told_week: Week) -> None:
    path = told_week.config.reports / str(day(7)) / "history.png"
    pixels = np.asarray(Image.open(io.BytesIO(path.read_bytes())).convert("RGB")).astype(int)
    half = pixels.shape[0] // 4  # the headline's panel
    red = np.abs(pixels[:half] - (0xD0, 0x2C, 0x30)).sum(axis=2) < 24
    blue = np.abs(pixels[:half] - (0x1D, 0x5F, 0xCE)).sum(axis=2) < 24
    assert _groups(red) == 3
    assert _groups(blue) == 4


def _groups(mask: np.ndarray) -> int:
    """Runs of columns that hold something."""
    held = np.concatenate([[False], mask.any(axis=0)])
    return int(np.count_nonzero(held[1:] & ~held[:-1]))


def test_markdown_lists_checks_and_nights(told_week: Week) -> None:
    text = told(told_week, 5, "report.md")
    assert text.startswith("# lab: FAIL, 2026-11-20\n")
    rows = re.findall(r"^\| (\S+) \| (PASS|FAIL|SKIPPED) \|", text, re.M)
    assert ("task", "FAIL") in rows
    assert ("visual", "PASS") in rows
    assert [word for name, word in rows if name.startswith("2026")] == ["FAIL"] + ["PASS"] * 4
    assert "| damping | 0.8000 (0.7500 .. 0.8600) | 1/s |" in text


def test_a_reports_json_is_that_of_the_gate(told_week: Week) -> None:
    report = json.loads(told(told_week, 5, "report.json"))
    assert report["verdict"]["outcome"] == "FAIL"
    assert [each["axis"] for each in report["axes"]] == ["visual", "task", "dynamics"]


def test_later_nights_leave_earlier_reports_alone(config: NightlyConfig) -> None:
    week = Week(config, {}, 9)
    week.night(1)
    folder = config.reports / str(day(1))
    before = {path.name: path.read_bytes() for path in folder.iterdir()}
    assert len(before) == 5
    week.night(2)
    assert {path.name: path.read_bytes() for path in folder.iterdir()} == before

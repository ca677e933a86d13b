"""The files of a night: JUnit, metrics, HTML, Markdown and JSON."""

from __future__ import annotations

import base64
import datetime
import re
from dataclasses import replace
from functools import partial
from html.parser import HTMLParser
from xml.etree import ElementTree as ET

import numpy as np
from prometheus_client.openmetrics import parser as openmetrics

from s2rstore.gap_history import reader
from s2rtools.nightly.report_files import metrics
from s2rtools.nightly.run import nightly
from tests.support import nights
from tests.support.nights import Week, day

_CASE = {"failure": {"message", "type"}, "skipped": {"message"}, "system-out": set()}
Samples = dict[tuple[str, frozenset[tuple[str, str]]], float]


def cases(week: Week, number: int) -> dict[str, ET.Element]:
    root = ET.parse(week.config.reports / str(day(number)) / "junit.xml").getroot()
    return {case.attrib["name"]: case for case in root.iter("testcase")}


def report_text(week: Week, number: int, name: str) -> str:
    return (week.config.reports / str(day(number)) / name).read_text()


def samples(text: str) -> Samples:
    return {
        (sample.name, frozenset(sample.labels.items())): sample.value
        for family in openmetrics.text_string_to_metric_families(text)
        for sample in family.samples
    }


def sample_value(all_samples: Samples, name: str, **labels: str) -> float:
    labels_expected = {("nightly", "lab"), ("dataset", "tiny"), ("run", "vanilla"), *labels.items()}
    return all_samples[name, frozenset(labels_expected)]


def test_junit_has_the_standard_structure(recorded_week):
    for number in range(1, 8):
        root = ET.parse(recorded_week.config.reports / str(day(number)) / "junit.xml").getroot()
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


def test_junit_fails_from_day_five_on(recorded_week):
    names = {"headline", "visual", "task", "dynamics", "delay", "growth", "golden",
             "staleness"}  # fmt: skip
    for number in range(1, 8):
        parsed = cases(recorded_week, number)
        assert set(parsed) == names
        red = {name for name, case in parsed.items() if case.find("failure") is not None}
        assert red == ({"headline", "task"} if number >= 5 else set())
        assert parsed["delay"].find("skipped") is not None
    failure = cases(recorded_week, 5)["headline"].find("failure")
    assert failure is not None
    assert "worst axis task" in failure.attrib["message"]


def test_junit_marks_inconclusive_and_stale_results_as_skipped(config):
    def inconclusive_report(store, config) -> dict:
        missing = {"inconclusive": {"visual": "3 images & <few>\x00"}, "absent": {"delay": "none"}}
        return nights.report(store, {"task": 14.5}, **missing)

    nightly(config, day(1), inconclusive_report, lambda *arguments: ())
    night_run = nightly(config, day(9), inconclusive_report, lambda *arguments: ())
    assert night_run.night.exit_code == 3
    root = ET.parse(config.reports / str(day(9)) / "junit.xml").getroot()
    parsed = {case.attrib["name"]: case[0] for case in root.iter("testcase")}
    assert set(parsed) == {"headline", "task", "visual", "delay", "growth", "golden",
                           "staleness"}  # fmt: skip
    assert {result.tag for result in parsed.values()} == {"skipped"}
    assert parsed["visual"].attrib["message"].startswith("inconclusive: ")
    assert "3 images & <few>" in parsed["visual"].attrib["message"]
    assert "8 days old" in parsed["staleness"].attrib["message"]
    assert config.metrics is not None
    found_samples = samples(config.metrics.read_text())
    assert sample_value(found_samples, "s2r_gap_stale") == 1
    assert sample_value(found_samples, "s2r_gap_evidence_age_days") == 8
    outcome = {"axis": "visual", "outcome": "INCONCLUSIVE"}
    assert sample_value(found_samples, "s2r_gap_outcome", **outcome) == 1


def test_metrics_equal_the_history(recorded_week):
    nights_read = reader.read(recorded_week.config.history).of_configuration("lab")
    damping = {"parameter": "damping", "unit": "1/s"}
    for night in nights_read:
        night_samples = samples(metrics(night).decode())
        value = partial(sample_value, night_samples)
        for axis, gap in {"headline": night.gap, **{a.axis: a.gap for a in night.axes[:3]}}.items():
            found = [value(f"s2r_gap{end}", axis=axis) for end in ("", "_low", "_high")]
            assert found == [gap.value, gap.low, gap.high]
        for outcome in ("PASS", "FAIL", "INCONCLUSIVE"):
            told = value("s2r_gap_outcome", axis="all", outcome=outcome)
            assert told == (outcome == night.outcome)
        assert value("s2r_gap_exit_code", axis="all") == night.exit_code
        assert value("s2r_gap_estimate", **damping) == 0.8
        assert value("s2r_gap_estimate_high", **damping) == 0.86
        assert value("s2r_gap_golden_change_metres") == night.golden_change.value
        timestamp = datetime.datetime.fromisoformat(night.written_at).timestamp()
        assert value("s2r_gap_computed_timestamp_seconds") == timestamp
        axes = {dict(labels).get("axis") for name, labels in night_samples if name == "s2r_gap"}
        assert axes == {"headline", "visual", "task", "dynamics"}  # the delay axis has no value
        assert not any(np.isnan(value) for value in night_samples.values())
        mass = [name for name, labels in night_samples if ("parameter", "mass") in labels]
        assert not [name for name in mass if name.endswith("low")]


def test_label_values_are_escaped(recorded_week):
    night = reader.read(recorded_week.config.history).nights[0]
    night_samples = samples(metrics(replace(night, dataset='a "b"\\ \n c')).decode())
    assert any(("dataset", 'a "b"\\ \n c') in labels for _, labels in night_samples)


class _Page(HTMLParser):
    def __init__(self) -> None:
        super().__init__()
        self.images: list[str] = []
        self.elsewhere: list[str] = []
        self.open: list[str] = []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        parsed = dict(attrs)
        if tag == "img":
            assert parsed["alt"]
            self.images.append(str(parsed["src"]))
        self.elsewhere += [str(parsed[name]) for name in ("href", "srcset") if name in parsed]
        assert tag != "script"
        if tag not in ("meta", "img", "link", "br"):
            self.open.append(tag)

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag


def test_the_html_report_is_self_contained(recorded_week):
    page = _Page()
    text = report_text(recorded_week, 5, "report.html")
    page.feed(text)
    assert page.open == []
    assert page.elsewhere == []
    (image,) = page.images
    png = base64.b64decode(image.removeprefix("data:image/png;base64,"))
    folder = recorded_week.config.reports / str(day(5))
    assert png == (folder / "history.png").read_bytes()
    assert "▲ FAIL" in text
    assert "worst axis task" in text


def test_names_are_escaped_in_reports(config):
    def report_with_markup(store, config) -> dict:
        return nights.report(store, {"task": 5.0}, expression="<b>|x|</b>", model="*m*")

    nightly(config, day(1), report_with_markup, lambda *arguments: ())
    folder = config.reports / str(day(1))
    assert "&lt;b&gt;|x|" in (folder / "report.html").read_text()
    assert r"\<b\>\|x\|" in (folder / "report.md").read_text()


def test_the_markdown_report_lists_checks_and_nights(recorded_week):
    text = report_text(recorded_week, 5, "report.md")
    assert text.startswith("# lab: FAIL, 2026-11-20\n")
    rows = re.findall(r"^\| (\S+) \| (PASS|FAIL|SKIPPED) \|", text, re.M)
    assert ("task", "FAIL") in rows
    assert ("visual", "PASS") in rows
    assert [outcome for name, outcome in rows if name.startswith("2026")] == ["FAIL"] + ["PASS"] * 4
    assert "| damping | 0.8000 (0.7500 .. 0.8600) | 1/s |" in text


def test_later_nights_do_not_modify_earlier_reports(config):
    week = Week(config, {}, 9)
    week.night(1)
    folder = config.reports / str(day(1))
    before = {path.name: path.read_bytes() for path in folder.iterdir()}
    assert len(before) == 5
    week.night(2)
    assert {path.name: path.read_bytes() for path in folder.iterdir()} == before

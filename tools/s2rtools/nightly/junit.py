"""JUnit report of a night: failures and errors fail a build, inconclusive checks are skipped."""

from __future__ import annotations

from xml.etree import ElementTree as ET

from s2rstore.security.printable_text import printable
from s2rtools.nightly.report_model import NightReport


def junit(report: NightReport) -> bytes:
    """The XML file, one test case per check."""
    night = report.night
    counts = {
        "tests": str(len(report.checks)),
        "failures": str(sum(check.outcome == "FAIL" for check in report.checks)),
        "errors": str(sum(check.outcome == "ERROR" for check in report.checks)),
        "skipped": str(
            sum(check.outcome in ("INCONCLUSIVE", "SKIPPED") for check in report.checks)
        ),
        "time": "0",
    }
    root = ET.Element("testsuites", {"name": "s2r nightly", **counts})
    stamp = night.written_at.removesuffix("Z")
    suite = ET.SubElement(
        root, "testsuite", {"name": printable(night.name), "timestamp": stamp, **counts}
    )
    properties = ET.SubElement(suite, "properties")
    for name, value in (("night", str(night.night)), *report.facts()):
        ET.SubElement(properties, "property", {"name": name, "value": printable(value)})
    for check in report.checks:
        case = ET.SubElement(
            suite, "testcase",
            {"classname": f"s2r.gap.{printable(night.run)}", "name": check.name, "time": "0"},
        )  # fmt: skip
        text = printable(check.message)
        if check.outcome == "FAIL":
            ET.SubElement(case, "failure", {"message": text, "type": "gap"}).text = text
        elif check.outcome == "ERROR":
            ET.SubElement(case, "error", {"message": text, "type": "request"}).text = text
        elif check.outcome == "PASS":
            ET.SubElement(case, "system-out").text = text
        else:
            lead = "inconclusive: " if check.outcome == "INCONCLUSIVE" else ""
            ET.SubElement(case, "skipped", {"message": f"{lead}{text}"})
    ET.indent(root)
    return ET.tostring(root, encoding="utf-8", xml_declaration=True) + b"\n"

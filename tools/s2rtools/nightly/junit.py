"""A night as JUnit XML: a failure or an error fails the build, what decides nothing is
skipped."""

from __future__ import annotations

from xml.etree import ElementTree as ET

from s2rstore.security.printable_text import printable
from s2rtools.nightly.night_status import Content, facts


def junit(told: Content) -> bytes:
    """One test case per check; its message is what was found."""
    night = told.night
    counts = {
        "tests": str(len(told.checks)),
        "failures": str(sum(check.word == "FAIL" for check in told.checks)),
        "errors": str(sum(check.word == "ERROR" for check in told.checks)),
        "skipped": str(sum(check.word in ("INCONCLUSIVE", "SKIPPED") for check in told.checks)),
        "time": "0",
    }
    root = ET.Element("testsuites", {"name": "s2r nightly", **counts})
    stamp = night.written_at.removesuffix("Z")
    suite = ET.SubElement(
        root, "testsuite", {"name": printable(night.name), "timestamp": stamp, **counts}
    )
    listed = ET.SubElement(suite, "properties")
    for name, value in (("night", str(night.night)), *facts(night)):
        ET.SubElement(listed, "property", {"name": name, "value": printable(value)})
    for check in told.checks:
        case = ET.SubElement(
            suite, "testcase",
            {"classname": f"s2r.gap.{printable(night.run)}", "name": check.name, "time": "0"},
        )  # fmt: skip
        text = printable(check.told)
        if check.word == "FAIL":
            ET.SubElement(case, "failure", {"message": text, "type": "gap"}).text = text
        elif check.word == "ERROR":
            ET.SubElement(case, "error", {"message": text, "type": "request"}).text = text
        elif check.word == "PASS":
            ET.SubElement(case, "system-out").text = text
        else:
            lead = "inconclusive: " if check.word == "INCONCLUSIVE" else ""
            ET.SubElement(case, "skipped", {"message": f"{lead}{text}"})
    ET.indent(root)
    return ET.tostring(root, encoding="utf-8", xml_declaration=True) + b"\n"

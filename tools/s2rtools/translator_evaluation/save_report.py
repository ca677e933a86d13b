"""Save reports of translators in the store's index."""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from pathlib import Path

from s2rstore.index.transaction import edit
from s2rtools.translator_evaluation.report import TranslatorReport


def save_reports(root: Path, reports: Sequence[TranslatorReport]) -> None:
    """Replace the metrics of each translator, and set whether it is accepted."""
    with edit(root) as draft:
        for report in reports:
            draft.delete("translator_metric", translator=report.name)
            for row in report.rows:
                figures = (row.value, row.low, row.high)
                value, low, high = (x if math.isfinite(x) else None for x in figures)
                if value is None:
                    continue
                draft.insert_row(
                    "translator_metric",
                    {
                        "translator": report.name, "metric": row.metric,
                        "reference": row.reference, "run": row.run, "value": value, "low": low,
                        "high": high, "unit": row.unit,
                    },
                )  # fmt: skip
            verdict = report.verdict
            draft.update(
                "translator",
                {"translator": report.name},
                {"accepted": verdict.passed, "reasons": json.dumps(list(verdict.reasons))},
            )
            facts = {"judged_images": report.images, "judged_held_out": report.held_out}
            draft.set_provenance(f"translator:{report.name}", facts)

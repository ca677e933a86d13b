"""Rules that the tables of a published generation must meet, and what does not meet them."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from s2rstore.files import layout
from s2rstore.index import schema
from s2rstore.metrics.pose_metrics import LOSS_GAMMA
from s2rstore.reader import Store
from s2rstore.records import SIDES


@dataclass(frozen=True, slots=True)
class Damage:
    """A file or table that is not as published, with a description of the difference."""

    where: str
    what: str


_POSE_RULE = (
    "instance",
    "pose is NULL or not finite",
    "x IS NULL OR y IS NULL OR heading IS NULL OR "
    "NOT isfinite(x) OR NOT isfinite(y) OR NOT isfinite(heading)",
)
_IMAGE_RULES = (
    (
        "instance",
        "a pose in a data set without poses",
        "x IS NOT NULL OR y IS NOT NULL OR heading IS NOT NULL OR room IS NOT NULL",
    ),
    ("run", "a run in a data set without poses", "true"),
)
"""Rules of a data set without poses, in place of `_POSE_RULE`."""
_PARTLY_IMAGED = """
    WITH placed AS (
        SELECT iid, trajectory, part
        FROM instance ASOF JOIN (SELECT unnest(?::INTEGER[]) AS part) ON iid >= part)
    SELECT count(*) FROM (
        SELECT trajectory, part, domain, count(DISTINCT iid) AS imaged, count(*) AS n
        FROM frame JOIN placed USING (iid) GROUP BY ALL) f
    JOIN (SELECT trajectory, part, count(*) AS instances FROM placed GROUP BY ALL) t
    USING (trajectory, part) WHERE imaged <> instances OR n <> instances
"""
_RULES = (
    ("instance", "no image in any domain", "iid NOT IN (SELECT iid FROM frame)"),
    ("frame", "no such instance", "iid NOT IN (SELECT iid FROM instance)"),
    ("frame", "domain without a row in domain", "domain NOT IN (SELECT domain FROM domain)"),
    (
        "prediction",
        "a NaN where NULL belongs",
        "isnan(x) OR isnan(y) OR isnan(heading) OR "
        "isnan(error) OR isnan(heading_error) OR isnan(loss) OR isnan(accuracy)",
    ),
    (
        "prediction",
        "some figures of a pose without the others",
        " OR ".join(
            f"(x IS NULL) <> ({name} IS NULL)"
            for name in ("y", "heading", "error", "heading_error", "loss", "accuracy")
        ),
    ),
    ("prediction", "a pose without a split", "x IS NOT NULL AND split IS NULL"),
    (
        "instance",
        "room without a row in room",
        "room IS NOT NULL AND room NOT IN (SELECT room FROM room)",
    ),
    (
        "run",
        "domain without a row in domain",
        "sim_domain NOT IN (SELECT domain FROM domain) "
        "OR real_domain NOT IN (SELECT domain FROM domain)",
    ),
    ("prediction", "no such instance", "iid NOT IN (SELECT iid FROM instance)"),
    (
        "prediction",
        "unknown side or split",
        "side NOT IN ('sim', 'real') OR split NOT IN ('train', 'validation', 'test', 'unseen')",
    ),
    ("prediction", "run without a row in run", "run NOT IN (SELECT run FROM run)"),
    (
        "run",
        "model without a row in model",
        "model IS NOT NULL AND model NOT IN (SELECT model FROM model)",
    ),
    *(
        (
            name,
            "duplicate name",
            f"{name} IN (SELECT {name} FROM {name} GROUP BY 1 HAVING count(*) > 1)",
        )
        for name in ("run", "model")
    ),
    ("prediction", "outlier is no distance", "isnan(outlier) OR outlier < 0"),
    (
        "prediction",
        "sigma is no standard deviation of a pose",
        "NOT isfinite(sigma) OR sigma <= 0 OR (sigma IS NOT NULL AND x IS NULL)",
    ),
    ("frame_pose", "no such instance", "iid NOT IN (SELECT iid FROM instance)"),
    ("frame_pose", "domain without a row in domain", "domain NOT IN (SELECT domain FROM domain)"),
    ("frame_pose", *_POSE_RULE[1:]),
    *(
        (table, "no such frame", "(iid, domain) NOT IN (SELECT (iid, domain) FROM frame)")
        for table in ("frame_label", "frame_fault")
    ),
    ("label_gain", "run without a row in run", "run NOT IN (SELECT run FROM run)"),
    *(
        (table, "no such label", "label NOT IN (SELECT label FROM label)")
        for table in ("frame_label", "label_gain")
    ),
    (
        "instance",
        "a pair offset is no distance or no angle",
        "isnan(pair_offset_m) OR pair_offset_m < 0 OR isnan(pair_offset_deg) "
        "OR pair_offset_deg < 0 OR pair_offset_deg > 180.001",
    ),
)

# Readers find an instance's row in the frames of its trajectory and part by this order.
_ORDER = """
    WITH placed AS (
        SELECT trajectory, iid, seq, part, lag(iid) OVER earlier AS last_iid,
               lag(seq) OVER earlier AS last_seq, lag(part) OVER earlier AS last_part
        FROM instance ASOF JOIN (SELECT unnest(?::INTEGER[]) AS part) ON iid >= part
        WINDOW earlier AS (PARTITION BY trajectory ORDER BY iid))
    SELECT count(*) FROM (
        SELECT trajectory, count(*) AS n, min(seq) AS first, count(seq) AS seqs,
               bool_or(seq <= last_seq OR (part = last_part AND iid <> last_iid + 1)) AS mixed
        FROM placed GROUP BY trajectory) i
    LEFT JOIN trajectory t USING (trajectory)
    WHERE t.instances IS DISTINCT FROM n OR first < 0 OR seqs <> n OR mixed
"""

_FORMULAS = (
    ("error is not the distance to the truth", "error", "sqrt(dx * dx + dy * dy)"),
    (
        "loss is not that of its errors",
        "loss",
        f"{1 - LOSS_GAMMA} * error * error + {LOSS_GAMMA} * turn",
    ),
    ("accuracy is not that of its error", "accuracy", "greatest(0, 1 - error / scale)"),
)
_TOLERANCE = 1e-9
"""Relative; absolute for figures below 1."""
_FIGURES = """WITH imaged AS (
    SELECT iid FROM frame JOIN run ON domain IN (sim_domain, real_domain)
    WHERE run = $1 GROUP BY iid HAVING count(DISTINCT domain) = 2
    EXCEPT SELECT iid FROM prediction WHERE run = $1 AND error IS NULL AND split IS NULL),
ranked AS (
    FROM imaged UNION SELECT iid FROM prediction
    WHERE run = $1 AND error IS NOT NULL GROUP BY iid HAVING count(*) = 2),
figures AS (
    SELECT p.error, p.loss, p.accuracy, p.rank, p.heading_error AS turn,
           p.x - coalesce(f.x, i.x) AS dx, p.y - coalesce(f.y, i.y) AS dy,
           (SELECT accuracy_scale FROM dataset) AS scale,
           CASE WHEN p.error IS NOT NULL AND ranked.iid IS NOT NULL THEN row_number() OVER (
               PARTITION BY p.side, ranked.iid IS NULL ORDER BY p.error NULLS LAST, p.iid)
           END AS place
    FROM prediction p JOIN instance i USING (iid) LEFT JOIN ranked USING (iid)
    JOIN run r ON r.run = p.run LEFT JOIN frame_pose f ON f.iid = p.iid
    AND f.domain = CASE WHEN p.side = 'sim' THEN r.sim_domain ELSE r.real_domain END
    WHERE p.run = $1)
    SELECT """
"""The figures of the predictions of a run, from the true pose of each frame.

Ranked are the pairs that it was applied to; images that were added since then are not.
"""


def table_damages(store: Store, current: layout.Current) -> Iterator[Damage]:
    rules = (*((_POSE_RULE,) if store.has_poses else _IMAGE_RULES), *_RULES)
    for name, what, condition in rules:
        count = store.execute(f'SELECT count(*) FROM "{name}" WHERE {condition}')[0][0]
        if count:
            yield Damage(f"table {name}", f"{count} rows: {what}")
    total, least, most, distinct = store.execute(
        "SELECT count(*), min(iid), max(iid), count(DISTINCT iid) FROM instance"
    )[0]
    if total and (least, most, distinct) != (0, total - 1, total):
        yield Damage("table instance", f"iid is not 0 .. {total - 1}, each once")
    first_iids = [part.first_iid for part in store.parts]
    (unordered,) = store.execute(_ORDER, [first_iids])[0]
    if unordered:
        yield Damage("table instance", f"{unordered} trajectories: not the stated rows in order")
    if count := store.execute(_PARTLY_IMAGED, [first_iids])[0][0]:
        yield Damage("table frame", f"{count} trajectories: a domain images a part of them")
    stated = sum(trajectory.instances for trajectory in store.trajectories)
    if stated != total:
        yield Damage("table trajectory", f"states {stated} instances, there are {total}")
    comparisons = [
        *((what, _differs(name, formula)) for what, name, formula in _FORMULAS),
        ("rank is not that of its error", "rank IS DISTINCT FROM place"),
    ]
    counts = ", ".join(f"count(*) FILTER ({condition})" for _, condition in comparisons)
    for run in store.runs:  # one at a time: ranks of all runs would not fit into DuckDB's memory
        row = store.execute(f"{_FIGURES} {counts} FROM figures", [run])[0]
        for count, (what, _) in zip(row, comparisons, strict=True):
            if count:
                yield Damage("table prediction", f"run {run}: {count} rows: {what}")
    if store.dataset.hash != current.dataset_hash:
        yield Damage(layout.CURRENT, "names another data set than the index")
    for table in schema.TABLES:
        names = ", ".join(table.column_names)
        store.execute(f'SELECT {names} FROM "{table.name}" LIMIT 0')


def _differs(name: str, formula: str) -> str:
    """The condition that a figure and its formula differ; NULL where one of them is NULL."""
    near = f"abs({name} - ({formula})) <= {_TOLERANCE} * greatest(1, abs({formula}))"
    return f"NOT ({name} = ({formula}) OR {near})"


def incomplete_runs(store: Store) -> Iterator[Damage]:
    """Every computed run has one prediction per side and instance of each part it covers.

    It covers the first part, and some or all of those that were appended later.
    """
    query = """
        SELECT run, side, first, count(DISTINCT iid) FROM prediction
        ASOF JOIN (SELECT unnest(?::INTEGER[]) AS first) ON iid >= first GROUP BY ALL
    """
    rows = store.execute(query, [[part.first_iid for part in store.parts]])
    counts = {tuple(key): count for *key, count in rows}
    for part in store.parts:
        for name, run in store.runs.items():
            sides = [(name, side, part.first_iid) for side in SIDES] if run.key else []
            found = [counts.get(key, 0) for key in sides]
            if part.part > 0 and not any(found):
                continue
            for (_, side, _), count in zip(sides, found, strict=True):
                if count != part.instances:
                    what = f"run {name}: {count} of {part.instances} {side} rows"
                    yield Damage("table prediction", what)


def uncomputed_parts(store: Store) -> Iterator[str]:
    """Notes on runs that are not computed for instances that were appended, or not imported."""
    for name, run in store.runs.items():
        if run.is_imported and (note := store.coverage(name).note):
            yield note
    query = "SELECT run, count(DISTINCT iid) FROM prediction GROUP BY run"
    counts = dict(store.execute(query))
    for name, run in store.runs.items():
        computed = run.key is not None and not run.is_imported
        imaged = int(np.count_nonzero(store.imaged(run.sim_domain, run.real_domain)))
        if computed and store.coverage(name).is_outdated:
            yield store.coverage(name).note
        rows: dict[str, int] = {}
        for record in store.array_parts(name):
            if record.axes[:1] == ("iid",) and record.kind != "prediction":
                label = " ".join(filter(None, (record.kind, record.mode, record.side)))
                rows[label] = rows.get(label, 0) + record.shape[0]
        expected = min(counts.get(name, 0), imaged)
        partial = [label for label, count in rows.items() if count < expected]
        if partial:
            yield f"run {name}: computed for some instances only: {', '.join(sorted(partial))}"

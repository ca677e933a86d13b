"""View `pair`: its columns, their names with units, and the SQL that makes it."""

from __future__ import annotations

from s2rstore.index.schema import BY_NAME, GAP_SHARES, PAIR_OFFSETS
from s2rstore.index.table_definition import quoted

_SIDE_COLUMNS = (
    {"x": "m", "y": "m", "heading": "rad"}
    | {"sigma": "stated standard deviation of the position per axis, m"}
    | {"error": "m", "heading_error": "rad"}
    | dict.fromkeys(("loss", "accuracy", "rank", "split", "outlier"), "see prediction")
)
"""Columns of each side in view `pair`, with their comments."""
_UNIT_NAMES = {
    "x": "x_m", "y": "y_m", "heading": "heading_rad", "curvature": "curvature_deg",
    "odom_x": "odom_x_m", "odom_y": "odom_y_m", "odom_heading": "odom_heading_rad",
    "timestamp": "timestamp_s", "error": "error_m", "heading_error": "heading_error_rad",
    "gap": "gap_m", "shift": "shift_m", "sigma": "sigma_m",
}  # fmt: skip
"""Columns of view `pair` (those of a side without its name) with their units."""


def column_name(name: str) -> str:
    """The name in view `pair` of a column of its tables: `sim_error_m` for `sim_error`."""
    side, _, rest = name.partition("_")
    if side in ("sim", "real"):
        return f"{side}_{_UNIT_NAMES.get(rest, rest)}"
    return _UNIT_NAMES.get(name, name)


_Terms = list[tuple[str, str]]
"""Expressions in SQL, and the names of their columns."""


def _truth(alias: str) -> _Terms:
    """The columns of table `instance` in view `pair`."""
    return [
        (f"coalesce({alias}{name}, 0)" if name in PAIR_OFFSETS else f"{alias}{name}", name)
        for name in BY_NAME["instance"].column_names
        if name != "iid"
    ]


def _with_units(terms: _Terms) -> _Terms:
    """The columns under the names of view `pair`."""
    return [(sql, column_name(name)) for sql, name in terms]


def _select_list(terms: _Terms) -> str:
    return ", ".join(
        sql if sql.split(".")[-1] == name else f"{sql} AS {name}" for sql, name in terms
    )


def _view_statement() -> str:
    terms = [("s.run", "run"), ("s.iid", "iid"), *_truth("i.")]
    for side, alias in (("sim", "s"), ("real", "r")):
        terms += [(f"{alias}.{name}", f"{side}_{name}") for name in _SIDE_COLUMNS]
        terms += [(f"{alias}p.{axis}", f"{side}_{axis}") for axis in "uv"]
    terms.append(("r.error - s.error", "gap"))
    terms.append(("sqrt((r.x - s.x) * (r.x - s.x) + (r.y - s.y) * (r.y - s.y))", "shift"))
    terms = [*_with_units(terms), *((f"r.{name}", f"{name}_m") for name in GAP_SHARES)]
    return f"""
        CREATE VIEW pair AS SELECT {_select_list(terms)}
        FROM instance i
        JOIN prediction s ON s.iid = i.iid AND s.side = 'sim'
        JOIN prediction r ON r.run = s.run AND r.iid = s.iid AND r.side = 'real'
        LEFT JOIN projection sp ON sp.run = s.run AND sp.iid = s.iid AND sp.side = 'sim'
        LEFT JOIN projection rp ON rp.run = s.run AND rp.iid = s.iid AND rp.side = 'real'
    """


def unpredicted() -> str:
    """A relation with the columns of view `pair` and a row per instance, without predictions.

    It takes the place of that view where no run is computed; `run` is `records.NO_RUN`.
    """
    types = {
        c.name: c.type for table in ("prediction", "projection") for c in BY_NAME[table].columns
    }
    terms = [("''", "run"), ("iid", "iid"), *_truth("")]
    for side in ("sim", "real"):
        names = (*_SIDE_COLUMNS, "u", "v")
        terms += [(f"NULL::{types[name]}", f"{side}_{name}") for name in names]
    terms += [("NULL::DOUBLE", "gap"), ("NULL::DOUBLE", "shift")]
    terms = _with_units(terms) + [("NULL::FLOAT", f"{name}_m") for name in GAP_SHARES]
    return f"(SELECT {_select_list(terms)} FROM instance)"


def with_all_instances(run: str) -> str:
    """View `pair` with a row for the instances that have none for a run; figures are NULL."""
    name = f"'{quoted(run)}'"
    return (
        f"(FROM pair UNION ALL BY NAME SELECT * REPLACE ({name} AS run) FROM {unpredicted()} "
        f"WHERE iid NOT IN (SELECT iid FROM pair WHERE run = {name}))"
    )


VIEWS: tuple[str, ...] = (_view_statement(),)
"""The statements that make the views of an index."""


def temporary_view_statement() -> str:
    """The statement that makes view `pair` for one connection alone."""
    return VIEWS[0].replace("VIEW", "TEMP VIEW", 1)


def column_comments() -> dict[str, str]:
    """The comment of each column of view `pair`."""
    comments = {"run": "run"} | {c.name: c.comment for c in BY_NAME["instance"].columns}
    comments["iid"] = "instance"
    for side in ("sim", "real"):
        for name, comment in _SIDE_COLUMNS.items():
            what = f"{name.replace('_', ' ')}, " if comment in ("m", "rad") else ""
            comments[f"{side}_{name}"] = f"{side} prediction: {what}{comment}"
        comments |= {f"{side}_{axis}": f"{side} side of the UMAP" for axis in "uv"}
    comments["gap"] = "real error - sim error, m"
    comments["shift"] = "distance between the sim and the real prediction, m"
    for name in GAP_SHARES:
        comments[f"{name}_m"] = f"share of the gap due to {name.removeprefix('share_')}, m"
    return {column_name(name): comment for name, comment in comments.items()}


def statements() -> list[str]:
    """The SQL that makes view `pair`, comments included."""
    comments = column_comments()
    return [
        VIEWS[0],
        "COMMENT ON VIEW pair IS 'one row per run and instance: truth and both sides'",
        *(f"COMMENT ON COLUMN pair.{name} IS '{quoted(comments[name])}'" for name in comments),
    ]

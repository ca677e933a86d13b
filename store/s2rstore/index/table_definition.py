"""The definition of a table as data, and the SQL that makes it with its comments."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal


@dataclass(frozen=True, slots=True)
class Column:
    name: str
    type: str
    comment: str


@dataclass(frozen=True, slots=True)
class Table:
    """A table; the columns of `order` sort its rows."""

    name: str
    comment: str
    columns: tuple[Column, ...]
    order: tuple[str, ...]

    @property
    def column_names(self) -> tuple[str, ...]:
        return tuple(column.name for column in self.columns)


def table_of(name: str, comment: str, order: str, *columns: tuple[str, str, str]) -> Table:
    """A table of columns (name, type, comment); `order` names the columns that sort its rows."""
    declared = tuple(Column(*column) for column in columns)
    return Table(name, comment, declared, tuple(order.split()))


def statements_of(table: Table) -> list[str]:
    """The SQL that makes one empty table, comments included."""
    columns = ", ".join(f'"{column.name}" {column.type}' for column in table.columns)
    return [f'CREATE TABLE "{table.name}" ({columns})', *comments_on(table, "TABLE")]


def comments_on(table: Table, kind: Literal["TABLE", "VIEW"]) -> list[str]:
    """The SQL that describes a table, or the view in its place, and its columns."""
    return [
        f"COMMENT ON {kind} \"{table.name}\" IS '{quoted(table.comment)}'",
        *(
            f'COMMENT ON COLUMN "{table.name}"."{column.name}" IS \'{quoted(column.comment)}\''
            for column in table.columns
        ),
    ]


def quoted(text: str) -> str:
    """A text inside single quotes of SQL."""
    return text.replace("'", "''")

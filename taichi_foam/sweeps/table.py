"""Rows of a sweep's table, and Parquet and CSV files of them.

A row has `member`, `scene` (hash of its content), a column for each axis, `repeat` and `varied`,
the ending of the drop, the reason if it failed, and every measure of its summary.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pyarrow as pa
import pyarrow.csv as pc
import pyarrow.parquet as pq
from numpy.typing import NDArray

from taichi_foam.records.record import Record
from taichi_foam.results.files import plain, whole_file
from taichi_foam.results.result import Result
from taichi_foam.sweeps.sampling import Design, Member

MACHINE = ("wall_s", "node_stages_per_s")
"""Columns on computing speed: all others are the same on any machine."""

DROP = "drop"
"""Column of histories: the number of the impact on the block, if there are several."""

PARQUET, CSV = "results.parquet", "results.csv"
"""The whole table, in the folder of the sweep."""

# Rows of a row group: many shards are merged, so that readers have few groups.
_GROUP_ROWS = 65_536

# Key in the metadata of a shard's schema.
_SECONDS = b"seconds"

MEMBER = "member"
_LEFT_OUT = ("scene", "interrupted")  # the hash and the ending say more


class Shard(NamedTuple):
    """A Parquet file of rows, and how many of its first rows an earlier file has already."""

    path: Path
    skipped: int = 0


def row(member: Member) -> dict[str, Any]:
    """The row of a drop, to which its impacts are added."""
    return _row(member.number, member.hash, member.axes, member.repeat, member.varied)


def row_without_scene(design: Design, number: int, reason: str) -> dict[str, Any]:
    """The row of a drop whose values make an invalid scene, or that was lost."""
    return _row(number, None, *design.axes(number), None, reason)


def add_impact(
    row: dict[str, Any], drop: int, result: Result, wanted: Sequence[str] | None
) -> None:
    """Add an impact on a member's block to its row, with the `wanted` measures; None: all.

    Measures of later impacts, `drop` from 1, are `drop_2_...` and so on.
    """
    begin, left_out, failure = "", _LEFT_OUT, result.failure
    if drop == 1:
        row["ending"] = result.ending and result.ending.value
    else:
        begin, left_out = f"drop {drop}: ", (*_LEFT_OUT, *MACHINE, "drop", "assumed")
    try:
        found = result.summary if wanted is None else result.measured(wanted)
        cells = {drop_column(key, drop): _cell(found[key]) for key in found if key not in left_out}
    except Exception as error:  # one drop that cannot be measured must not spoil the others
        failure = failure or f"no measures: {type(error).__name__}: {error}"
    else:
        row.update(cells)
    if failure:
        row["failure"] = row["failure"] or f"{begin}{failure}"


def drop_column(measure: str, drop: int) -> str:
    """The column of a measure in the impact of that number, from 1, on a block."""
    return measure if drop == 1 else f"drop_{drop}_{measure}"


def write_rows(path: Path, rows: Sequence[Mapping[str, Any]], seconds: float) -> None:
    """Write rows as a Parquet file, complete or not at all, with the time they took [s].

    Raises OSError.
    """
    _write(path, _table(rows).replace_schema_metadata({_SECONDS: repr(seconds)}))


def seconds_of(path: Path) -> float:
    """The time that the rows of a file took [s]. Raises OSError: it cannot be read."""
    return float(pq.read_schema(path).metadata[_SECONDS])


def write_histories(path: Path, records: Mapping[int, Sequence[Record]], kind: str) -> None:
    """Write histories as one Parquet file: `member`, `drop` if there are several, then as in
    history.csv.

    `records` are those of each member, one for each impact on its block. `kind` is the type of all
    other numbers: float32 or float64.
    """
    parts = []
    several = any(len(each) > 1 for each in records.values())
    for number, impacts in sorted(records.items()):
        for drop, record in enumerate(impacts, 1):
            history = record.history
            columns = {name: np.asarray(history[name], dtype=kind) for name in history}
            length = len(next(iter(columns.values())))
            head = {MEMBER: np.full(length, number)}
            if several:
                head[DROP] = np.full(length, drop)
            parts.append(pa.table({**head, **columns}))
    _write(path, pa.concat_tables(parts) if parts else pa.table({MEMBER: pa.array([], "int64")}))


def read_histories(
    path: Path, names: Sequence[str]
) -> Iterator[tuple[int, int, list[NDArray[np.float64]]]]:
    """Some columns of the histories in a file of `write_histories`, one history after the other.

    Yields the member, the number of the impact on its block from 1, and the columns (n,).
    """
    heads = [MEMBER, DROP] if DROP in pq.read_schema(path).names else [MEMBER]
    found = pq.read_table(path, columns=[*heads, *names])
    member = found[MEMBER].to_numpy()
    drop = found[DROP].to_numpy() if DROP in heads else np.ones(len(member), int)
    columns = [found[name].to_numpy().astype(float) for name in names]
    begins = (np.diff(member, prepend=-1) != 0) | (np.diff(drop, prepend=-1) != 0)
    for start, stop in pairwise([*np.flatnonzero(begins).tolist(), len(member)]):
        yield int(member[start]), int(drop[start]), [each[start:stop] for each in columns]


def read(shards: Sequence[Shard], columns: Sequence[str]) -> pa.Table:
    """Some columns of shards as one table; columns that a shard lacks are empty there."""
    parts = []
    for path, skipped in shards:
        there = set(pq.read_schema(path).names)
        part = pq.read_table(path, columns=[name for name in columns if name in there])
        parts.append(part.slice(skipped))
    schema = _common([part.schema for part in parts])
    if not parts:
        return pa.table({name: pa.array([], pa.null()) for name in columns})
    return _joined(parts, schema)


def measures(shards: Sequence[Shard], axes: Sequence[str]) -> list[str]:
    """Columns of shards that hold measures, and not what `_row` does."""
    names = dict.fromkeys(name for path, _ in shards for name in pq.read_schema(path).names)
    others = _row(0, None, dict.fromkeys(axes), 0, None)
    return [name for name in names if name not in others]


def same_in_groups(rows: pa.Table, count: int) -> list[bool]:
    """For each group of `count` consecutive members, whether all present have the same figures.

    Groups with fewer than two members present, or without figures, are left out.
    """
    groups = np.asarray(rows[MEMBER]) // count
    starts = np.flatnonzero(np.diff(groups, prepend=-1))
    several = np.diff(starts, append=len(groups)) > 1
    same, known = several.copy(), np.zeros(len(starts), bool)
    for name in rows.column_names:
        if name == MEMBER or not len(starts):
            continue
        values = rows[name].cast(pa.float64()).to_numpy()
        low, high = (each.reduceat(values, starts) for each in (np.fmin, np.fmax))
        known |= np.isfinite(low)
        same &= (low == high) | ~np.isfinite(low)
    return same[known & several].tolist()


def collect(shards: Sequence[Shard], more: Sequence[Mapping[str, Any]], folder: Path) -> int:
    """Write results.parquet and results.csv from shards and `more` rows; return the row count.

    Holds at most one row group in memory at a time. Raises OSError.
    """
    last = _table(more) if more else None
    schemas = [pq.read_schema(path) for path, _ in shards] + ([last.schema] if last else [])
    if not schemas:
        return 0
    schema = _common(schemas)
    count = 0

    def groups():
        held, length = [], 0
        for path, skipped in shards:
            held.append(pq.read_table(path).slice(skipped))
            length += len(held[-1])
            if length >= _GROUP_ROWS:
                yield _joined(held, schema)
                held, length = [], 0
        if last is not None:
            held.append(last)
        if held:
            yield _joined(held, schema)

    with (
        whole_file(folder / PARQUET) as parquet,
        whole_file(folder / CSV) as text,
        parquet.open("wb") as binary,
        text.open("wb") as plain_text,
        pq.ParquetWriter(binary, schema) as writer,
        pc.CSVWriter(plain_text, schema, write_options=pc.WriteOptions(quoting_style="needed"))
        as lines,
    ):  # fmt: skip
        for group in groups():
            writer.write_table(group)
            lines.write_table(group)
            count += len(group)
    return count


def _row(
    number: int,
    scene: str | None,
    axes: Mapping[str, Any],
    repeat: int,
    varied: float | None,
    failure: str | None = None,
) -> dict[str, Any]:
    """The columns that identify a drop, its axes, and its end."""
    shown = {key: _cell(value) for key, value in axes.items()}
    head = {MEMBER: number, "scene": scene, **shown, "repeat": repeat, "varied": varied}
    return {**head, "ending": None, "failure": failure}


def _cell(value: Any) -> Any:
    """A value that a column can hold: warnings in one text, tables as JSON."""
    value = plain(value)
    if isinstance(value, list) and all(isinstance(item, str) for item in value):
        return "; ".join(value)
    if isinstance(value, (list, dict)):
        return json.dumps(value)
    return value


def _table(rows: Sequence[Mapping[str, Any]]) -> pa.Table:
    """Rows as columns, in order of first appearance of their keys."""
    keys = dict.fromkeys(key for each in rows for key in each)
    return pa.table({key: _column([each.get(key) for each in rows]) for key in keys})


def _column(values: list[Any]) -> pa.Array:
    """A column of values; values of mixed types become strings."""
    try:
        return pa.array(values)
    except (pa.ArrowInvalid, pa.ArrowTypeError):
        return pa.array([None if value is None else str(value) for value in values])


def _common(schemas: Sequence[pa.Schema]) -> pa.Schema:
    """A schema for all shards: differing number types become floats, other mixtures strings."""
    kinds: dict[str, set[pa.DataType]] = {}
    for field in (field for schema in schemas for field in schema):
        kinds.setdefault(field.name, set()).add(field.type)
    fields = []
    for name, found in kinds.items():
        found = found - {pa.null()}
        numeric = all(pa.types.is_integer(t) or pa.types.is_floating(t) for t in found)
        if len(found) == 1:
            (kind,) = found
        else:
            kind = pa.float64() if numeric else pa.string()  # nulls only: floats
        fields.append(pa.field(name, kind))
    return pa.schema(fields)


def _joined(parts: Sequence[pa.Table], schema: pa.Schema) -> pa.Table:
    """Shards as one table that has all columns of `schema`, in its order."""

    def column(part: pa.Table, field: pa.Field) -> Any:
        there = field.name in part.column_names
        return part[field.name].cast(field.type) if there else pa.nulls(len(part), field.type)

    return pa.concat_tables(
        pa.table([column(part, field) for field in schema], schema=schema) for part in parts
    )


def _write(path: Path, table: pa.Table) -> None:

    path.parent.mkdir(exist_ok=True)
    # Python's own file: its errors carry the system's error number, as for a full disk
    with whole_file(path) as partial, partial.open("wb") as file:
        pq.write_table(table, file)

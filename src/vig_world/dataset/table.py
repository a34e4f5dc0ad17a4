"""Reads latents.parquet, the table of a split."""

from pathlib import Path

from vig.io.checks import read_bytes, reading
from vig.scene import layout_of_width
from vig_world.dataset.format import COLUMNS, REMEDY, TABLE, inside, read_info
from vig_world.extras import optional_import

with optional_import("world"):
    import pyarrow as pa
    import pyarrow.compute as pc
    import pyarrow.parquet as pq

MAX_TABLE = 1 << 30  # bytes of the table's file
MAX_IN_LIST, MAX_TEXT = 256, 16_384  # limits of each sample: entries of a list, bytes of each text column

_TYPES = {
    name: pa.list_(pa.string()) if kind == "list" else pa.type_for_alias(kind)
    for name, kind in COLUMNS.items()
}
"""Types of the table's columns; the others are float64."""


def read_table(root: Path, split: str, texts: bool = True) -> pa.Table:
    """Return a split's latents.parquet; without `texts`, less the columns that only checks and exports read.

    The stated numbers of rows and values are checked before they are decoded: a small file can hold
    gigabytes of repetitions. Raises UserError when it is missing or damaged.
    """
    count = read_info(root)["splits"][split]["count"]
    path = inside(root, f"{split}/{TABLE}")
    with reading(path, "the table of a dataset", REMEDY):
        data = pa.py_buffer(read_bytes(path, MAX_TABLE))
        file = pq.ParquetFile(pa.BufferReader(data))
        metadata, held = file.metadata, file.schema_arrow.names
        latents = [name for name in held if name not in COLUMNS]
        if (
            sorted(held) != sorted([*COLUMNS, *latents])
            or tuple(latents) != layout_of_width(len(latents)).labels
        ):
            raise ValueError("its columns are not those of a dataset")
        groups = [metadata.row_group(i) for i in range(metadata.num_row_groups)]
        if metadata.num_rows != count or sum(group.num_rows for group in groups) != count:
            raise ValueError(f"it has {metadata.num_rows} rows for {count} samples")
        for group in groups:
            chunks = [group.column(i) for i in range(group.num_columns)]
            if any(chunk.num_values > MAX_IN_LIST * group.num_rows for chunk in chunks):
                raise ValueError(f"a list in it has more than {MAX_IN_LIST} entries")
        leaves = [metadata.schema.column(i) for i in range(metadata.num_columns)]
        strings = [leaf.path for leaf in leaves if leaf.physical_type == "BYTE_ARRAY"]
        file = pq.ParquetFile(pa.BufferReader(data), read_dictionary=strings)
        # On this thread: one of Arrow's may let go of `data` while Python ends, which aborts the process.
        left_out = () if texts else ("hidden_by", "zone", "assets", "photo")
        table = file.read([name for name in held if name not in left_out], use_threads=False)
        if len(table) != count:
            raise ValueError(f"{len(table)} of its {count} rows could be read")
        for place, name in enumerate(table.column_names):
            table = table.set_column(place, name, _column(name, table[name]))
    return table


def _column(name: str, column: pa.ChunkedArray) -> pa.ChunkedArray:
    """Return a column of the table in its type. ValueError when it has another, gaps, or very long texts."""
    wanted = _TYPES.get(name, pa.float64())
    texts = column
    if pa.types.is_list(texts.type):
        texts = pc.list_flatten(texts)
    if pa.types.is_dictionary(texts.type):
        lengths = sum(
            int(pc.sum(pc.take(pc.binary_length(chunk.dictionary), chunk.indices)).as_py() or 0)
            for chunk in texts.chunks
        )
        if lengths > MAX_TEXT * max(len(column), 1):
            raise ValueError(f"{name} has more than {MAX_TEXT} bytes of text a row")
    stored = texts.type.value_type if pa.types.is_dictionary(texts.type) else texts.type
    expected = wanted.value_type if pa.types.is_list(column.type) and pa.types.is_list(wanted) else wanted
    if stored != expected and not pa.types.is_null(stored):  # null: empty everywhere
        raise ValueError(f"{name} must be {wanted}; it is {str(column.type)[:60]}")
    plain = column.cast(wanted)
    if plain.null_count and name != "photo":
        raise ValueError(f"{name} is missing in {plain.null_count} rows")
    return plain

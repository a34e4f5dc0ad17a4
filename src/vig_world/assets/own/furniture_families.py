"""Families of furniture, recognised by words in a piece's name."""

from pathlib import Path

FAMILIES = {  # by keywords in a name; earlier ones take precedence
    "bedside_table": "nightstand", "bedside": "nightstand", "nightstand": "nightstand",
    "coffee_table": "coffee_table", "desk": "desk", "counter": "counter", "kitchen": "counter",
    "bookshelf": "shelf", "bookcase": "shelf", "shelf": "shelf", "shelves": "shelf", "rack": "shelf",
    "cabinet": "cabinet", "commode": "cabinet", "cupboard": "cabinet", "drawer": "cabinet",
    "dresser": "cabinet", "sideboard": "cabinet", "sofa": "sofa", "couch": "sofa", "armchair": "armchair",
    "stool": "stool", "bench": "bench", "chair": "chair", "bed": "bed", "table": "table",
}  # fmt: skip


def family_of_file(name: str) -> str:
    """Return the family that a file's name suggests by a keyword anywhere; `furniture` without one."""
    words = Path(name).as_posix().lower().replace("-", "_").replace(" ", "_")
    return next((family for word, family in FAMILIES.items() if word in words), "furniture")


def family_of_thing(name: str) -> str | None:
    """Return the family of a thing by the keyword that ends its name: `coffee_table`, but not `desk_lamp`.

    Args:
        name: Lower-case words with `_` between.
    """
    return next((family for word, family in FAMILIES.items() if f"_{name}".endswith(f"_{word}")), None)

"""Levels of detail and collision hulls, which repeat a shape, recognised by names of files or nodes."""

import re
from collections.abc import Callable, Sequence

COPY = "by its name a level of detail or a collision hull of {}, which counts once"
_LEVEL = re.compile(r"(?:(?<![A-Za-z])(?i:lod)|(?<=[a-z])L(?i:od))[\s._-]?\d+(?!\d)")
_HULL = re.compile(
    r"(u[cbs]x|ucp|usp|mcdcx|collisions?|colliders?|colonly|convcol|convcolonly|vhacd|coacd)\d*"
)
_HULL_OF_FILES = re.compile(rf"({_HULL.pattern}|col|coll|hulls?|convex|convexhull|physics|phys)\d*")
"""Words of a hull in a file's name; in a node's name they may be a part of a ship."""
_DETAIL = re.compile(
    r"(high|hi|mid|medium|middle|low|lo)(-?(res|poly|detail))?|(decimated|simplified|reduced|proxy)|\d+k"
)
_NEUTRAL = re.compile(
    r"|poly|res|resolution|detail|details|visuals?|render|textured|nontextured|models?|mesh(es)?"
)


def cut_at_level(path: str) -> str:
    """Return a node's path up to the last node of it that is called a level of detail; all where none is."""
    parts = path.split("/")
    levels = [number for number, part in enumerate(parts, 1) if _LEVEL.search(part)]
    return "/".join(parts[: levels[-1]]) if levels else path


def shape_copies(
    names: Sequence[str], faces: Sequence[int], alike: Callable[[int, int], bool] | None = None
) -> dict[int, int]:
    """Return which shapes repeat another as a coarser level of detail or as a collision hull, by number.

    Args:
        names: Names of the shapes, without suffix; `/` separates a folder or parent node from its content.
        faces: Number of faces of each: the finest of several levels is no copy.
        alike: Whether two shapes are alike, where the names, such as chair_low and chair_high, leave it open;
            None: only unmistakable names count.
    """
    read = [_read_name(name, _HULL_OF_FILES if alike else _HULL) for name in names]
    finest: dict[tuple[str, ...], int] = {}
    for number, (key, kind) in enumerate(read):
        if kind != "hull" and (key not in finest or faces[number] > faces[finest[key]]):
            finest[key] = number
    copies = {}
    for number, (key, kind) in enumerate(read):
        original = finest.get(key)
        if kind == "hull" and original is None and key and key[-1].isdigit():
            original = finest.get(key[:-1])  # one of several hulls of a thing, by its number
        if original is None or original == number:
            continue
        kinds = {kind, read[original][1]}
        if "hull" in kinds or "level" in kinds or (alike and "detail" in kinds and alike(number, original)):
            copies[number] = original
    return copies


def _read_name(name: str, hull: re.Pattern[str]) -> tuple[tuple[str, ...], str]:
    """Return the words of a name that stay the same from copy to copy, and the copy that it names."""
    plain, levels = _LEVEL.subn(" ", name)
    key: list[str] = []
    kind = "level" if levels else ""
    for word in re.split(r"[\s._-]+", plain.replace("/", " ").lower()):
        if hull.fullmatch(word):
            kind = "hull"
        elif _DETAIL.fullmatch(word):
            kind = kind or "detail"
        elif not _NEUTRAL.fullmatch(word) and key[-1:] != [word]:
            key.append(word)
    return tuple(key), kind

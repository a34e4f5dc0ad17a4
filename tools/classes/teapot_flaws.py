"""Flaws of a design: parts detached, folded or in each other's way, and sizes out of proportion."""

import numpy as np

from tools.classes.soundness import size_flaws
from vig_world.assets.designs.design import TeapotDesign
from vig_world.assets.designs.swept import HANDLE_LOFT, SPOUT_LOFT
from vig_world.assets.designs.teapot import PART_NAMES, TEAPOT_FACES, TEAPOT_PARTS, teapot_vertices
from vig_world.assets.designs.topology import Loft

LENGTHS = (0.18, 0.42)
"""Metres from the mouth to the handle's back."""
HEIGHTS = (0.07, 0.36)
WIDTHS = (0.12, 0.24)

_CLEAR = 0.004  # metres between a handle and a lid or knob below it
_MOUTH_RING = -4  # the last whole ring of the spout's loft, its lip


def flaws(design: TeapotDesign) -> list[str]:
    """Return the flaws that make a design no teapot, a sentence each; empty for a sound one."""
    vertices = teapot_vertices(design).astype(np.float64)
    spout, handle = _own(vertices, "spout"), _own(vertices, "handle")
    body = _faces("body", "foot")
    spout_rings, handle_rings = _tube(spout, SPOUT_LOFT)[:-1], _tube(handle, HANDLE_LOFT)  # not the dimple
    ends = {
        "spout": spout[: SPOUT_LOFT.starts[2]],
        "handle": np.concatenate([handle[: HANDLE_LOFT.starts[2]], handle[HANDLE_LOFT.starts[-3] :]]),
    }
    flaws_found = [
        f"the {part} is detached from the body"
        for part, points in ends.items()
        if not inside(points, vertices, body).all()
    ]
    flaws_found += [
        f"the {part} folds"
        for part, rings in (("spout", spout_rings), ("handle", handle_rings))
        if folds(rings)
    ]
    mouth = spout[SPOUT_LOFT.starts[_MOUTH_RING - 1] : SPOUT_LOFT.starts[_MOUTH_RING]]
    if inside(mouth[::4], vertices, body).any():
        flaws_found.append("the spout's mouth is inside the body")
    count = len(handle_rings)
    middle = handle_rings[count // 3 : -(count // 3), ::3].reshape(-1, 3)
    if inside(middle, vertices, _faces("body", "foot", "lid", "knob")).any():
        flaws_found.append("the handle runs through the pot")
    if design.handle == "above":
        crown = vertices[np.isin(TEAPOT_PARTS, [PART_NAMES.index("lid"), PART_NAMES.index("knob")])]
        if crown[:, 2].max() > handle_rings[count // 2, :, 2].min() - _CLEAR:
            flaws_found.append("the lid and its knob reach the handle above")
    apart = np.linalg.norm(
        handle_rings.mean(axis=1)[:, None] - spout_rings.mean(axis=1)[None, len(spout_rings) // 2 :], axis=2
    )
    if apart.min() < 0.5 * (design.handle_thickness + design.spout_tip_radius):
        flaws_found.append("the handle meets the spout")
    if vertices[:, 2].min() < -1e-9:
        flaws_found.append("it reaches below the ground")
    sizes = zip(("long", "wide", "high"), np.ptp(vertices, axis=0), (LENGTHS, WIDTHS, HEIGHTS), strict=True)
    return flaws_found + size_flaws(sizes)


def inside(points: np.ndarray, vertices: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """Return whether points (N, 3) are in closed surfaces (N,): their winding number by solid angles is 1."""
    a, b, c = (vertices[faces[:, k]][None] - points[:, None] for k in range(3))
    la, lb, lc = (np.linalg.norm(x, axis=-1) for x in (a, b, c))
    triple = np.sum(a * np.cross(b, c), axis=-1)
    below = la * lb * lc + np.sum(a * b, -1) * lc + np.sum(b * c, -1) * la + np.sum(c * a, -1) * lb
    winding: np.ndarray = np.sum(np.arctan2(triple, below), axis=1) / (2.0 * np.pi)
    return winding > 0.5


def folds(rings: np.ndarray) -> bool:
    """Return whether any vertex of a tube (rings, around, 3) lies behind its own of the ring before."""
    along = np.diff(rings.mean(axis=1), axis=0)
    return bool((np.sum(np.diff(rings, axis=0) * along[:, None], axis=-1) <= 0.0).any())


def _own(vertices: np.ndarray, part: str) -> np.ndarray:
    return vertices[TEAPOT_PARTS == PART_NAMES.index(part)]


def _faces(*parts: str) -> np.ndarray:
    numbers = [PART_NAMES.index(part) for part in parts]
    faces: np.ndarray = TEAPOT_FACES[np.isin(TEAPOT_PARTS[TEAPOT_FACES[:, 0]], numbers)]
    return faces


def _tube(own: np.ndarray, loft: Loft) -> np.ndarray:
    """Return the whole rings (rings, around, 3) of a tube's vertices, without its caps."""
    around = max(loft.counts)
    whole = [start for start, count in zip(loft.starts, loft.counts, strict=False) if count == around]
    return np.stack([own[start : start + around] for start in whole])

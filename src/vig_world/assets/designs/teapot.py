"""Teapot meshes in dense correspondence: vertex i means the same place on every design."""

import numpy as np

from vig_world.assets.designs.design import TeapotDesign
from vig_world.assets.designs.revolved import (
    BODY_LOFT,
    FOOT_RINGS,
    KNOB_LOFT,
    LID_LOFT,
    body_vertices,
    knob_vertices,
    lid_vertices,
    wall,
)
from vig_world.assets.designs.swept import HANDLE_LOFT, SPOUT_LOFT, handle_vertices, spout_vertices
from vig_world.assets.designs.topology import symmetric

PART_NAMES = ("body", "lid", "knob", "foot", "spout", "handle")

_LOFTS = (BODY_LOFT, LID_LOFT, KNOB_LOFT, SPOUT_LOFT, HANDLE_LOFT)
_COUNTS = [int(loft.starts[-1]) for loft in _LOFTS]
_OFFSETS = np.concatenate([[0], np.cumsum(_COUNTS)])


def _parts() -> np.ndarray:
    parts = np.repeat((0, 1, 2, 4, 5), _COUNTS)
    parts[: BODY_LOFT.starts[FOOT_RINGS]] = PART_NAMES.index("foot")
    return parts.astype(np.int32)


TEAPOT_FACES: np.ndarray = np.concatenate(
    [loft.faces() + offset for loft, offset in zip(_LOFTS, _OFFSETS[:-1], strict=True)]
).astype(np.int32)
"""Triangles (F, 3) of every teapot, counter-clockwise from outside; five closed surfaces (body with foot)."""

TEAPOT_PARTS: np.ndarray = _parts()  # part of each vertex (V,), an index into PART_NAMES

MIRROR: np.ndarray = np.concatenate(
    [loft.mirror() + offset for loft, offset in zip(_LOFTS, _OFFSETS[:-1], strict=True)]
).astype(np.int32)
"""Mirror image in y of each vertex (V,): `v[MIRROR] * (1, -1, 1) == v` exactly, for every design."""


def teapot_vertices(design: TeapotDesign) -> np.ndarray:
    """Return vertices of a design, (V, 3) float32 in metres, standing on z = 0, the body's axis at x = y = 0.

    Exactly mirror symmetric in y (see MIRROR); the topology is TEAPOT_FACES for every design.
    """
    body_wall = wall(design)
    parts = [make(design) for make in (body_vertices, lid_vertices, knob_vertices)]
    parts += [make(design, body_wall) for make in (spout_vertices, handle_vertices)]
    return symmetric(np.concatenate(parts), MIRROR)

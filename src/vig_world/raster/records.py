"""The records and constants that Python and the native code share, each declared once.

Addresses are of numpy arrays that the caller keeps alive during the call.
"""

from __future__ import annotations

import numpy as np

SAMPLES = 2
"""Along a pixel's side, of a picture."""
LANES = 16
"""Faces, or fragments, that are worked on side by side."""
SLACK = 4.8e-7
"""A sample that lies beyond an edge by rounding only is covered, so that no gap opens between neighbours."""
MOST_LEVELS = 10
"""Levels of a texture pyramid: up to 512 texels a side."""
LEAST_LIGHT = 0.1
"""Share of the irradiance that no shadow takes away."""
MOST_LIGHT = 1.25
"""Largest ratio of a place's light to the object's, which may be in a dim corner."""
EVEN = 0.6
"""Far from the object, this share of the irradiance is the mean of all directions; half of it at 1 m."""
BINS = 4096
"""Bins of linear light in the table of sRGB levels, each narrower than a level of 8-bit sRGB."""
SWEEP_MARGIN = 8
"""Cells round a plane that are never in shadow; no shadow moves further from plane to plane."""
SWEEP_LANES = 16
"""Cells that are swept side by side: the grid's width is a multiple of it."""
MOST_DIRECTIONS = 32
GROUND_DEPTH = 0.02
"""Metres below the ground to which its shadows still reach."""
STEPS = 12
"""Offsets that a search tries between two ends."""
FOUND, NOT_OUT_OF_THE_WAY, TOO_SMALL, NO_OFFSET = range(4)
"""Outcomes of a search, see `settle.REASONS`."""
PLACE_GOOD, PLACE_TOO_SMALL, PLACE_EYE, PLACE_OPEN = range(4)
"""States of a place: the object has no room there, the camera has none, nothing is before the object."""
STANDING, IN_HAND, ARM, TWIG, BOARD = range(5)
"""Kinds of things before the object, see `composition.occluders`."""
# The constants above are declared in C++, too.
_CONSTANTS = {
    name: value for name, value in globals().items() if name.isupper() and isinstance(value, int | float)
}

PART = np.dtype(
    [
        ("vertices", "i4", 2),  # first and end
        ("faces", "i4", 2),
        ("sphere", "f4", 4),  # centre and radius, metres, of the asset's frame
        ("texels", "i8"),  # bytes from the asset's start to the texture's finest level
        ("log_size", "i4", 2),  # log2 of the texture's width and height
        ("slot", "i4"),  # into the item's finishes, -1 none
        ("roughness", "f4"),
        ("mirror", "f4"),  # specular reflectance at normal incidence
        ("metal", "f4"),  # share of the albedo that reflects specularly
        ("emission", "f4"),
        ("clusters", "i4", 2),  # first and end
    ],
    align=True,
)
CLUSTER = np.dtype(
    [
        # Some of a part's faces, one after the other: drawn only where their sphere is in the frame.
        ("sphere", "f4", 4),
        ("vertices", "i4", 2),  # first and end of those that they have
        ("faces", "i4", 2),
    ],
    align=True,
)
HEADER = np.dtype(
    [
        ("sphere", "f4", 4),
        ("part_count", "i4"),
        ("vertex_count", "i4"),
        ("face_count", "i4"),
        ("point_count", "i4"),
        # Bytes from the asset's start:
        ("parts", "i8"),
        ("clusters", "i8"),
        ("positions", "i8"),  # (3, vertex_count) float32
        ("attributes", "i8"),  # (vertex_count, 5) float32: unit normal and uv
        ("corners", "i8"),  # (face_count, 3) int32
        ("points", "i8"),  # (point_count, 4) float32: places on the surface and their areas
        ("occlusion", "i8"),  # ambient: see GRID; 0 none
    ],
    align=True,
)
GRID = np.dtype(
    [
        # Cells are `cell` wide. Plane s is rise[0] * s + rise[1] * s * s above the origin, metres.
        ("origin", "f4", 3),
        ("cell", "f4"),
        ("rise", "f4", 2),
        ("size", "i4", 3),  # along x, y, z
        ("scale", "f4"),  # a stored 1 in irradiance
        ("values", "i8"),  # address of (z, y, x, 4) int16: lost irradiance = v0 + v123 . normal
    ],
    align=True,
)
FINISH = np.dtype(
    [("texels", "i8"), ("log_size", "i4", 2), ("repeats", "f4"), ("unused", "i4")],  # repeats per metre
    align=True,
)
ITEM = np.dtype(
    [
        ("rotation", "f8", (3, 3)),  # world from asset
        ("translation", "f8", 3),
        ("asset", "i8"),
        ("finishes", "i8"),
        ("owner", "i4"),
        ("is_target", "i4"),
        ("is_support", "i4"),
        ("unused", "i4"),
    ],
    align=True,
)
VISIBLE_PART = np.dtype(
    [
        ("part", "i8"),
        ("attributes", "i8"),
        ("item", "i4"),
        ("count", "i4"),  # of fragments
        ("is_target", "i4"),
        ("is_support", "i4"),
    ],
    align=True,
)
FRAGMENT = np.dtype(
    [
        ("face", "i4"),
        ("pixel", "i4"),
        ("x", "f4"),  # where it is shaded, samples
        ("y", "f4"),
        ("share", "f4"),  # of the pixel
        ("part", "i4"),
    ],
    align=True,
)
TASK = np.dtype(
    [
        ("rotation", "f8", (3, 3)),  # camera_from_world
        ("translation", "f8", 3),
        ("items", "i8"),
        ("item_count", "i4"),
        ("unused", "i4"),
        ("width", "i4"),  # of the image, samples
        ("height", "i4"),
        ("focal", "f4"),
        ("cx", "f4"),
        ("cy", "f4"),
        ("near", "f4"),
        ("keep", "i4"),  # whether ids are faces to be shaded, else owners
        # Filled by drawing:
        ("part_count", "i4"),
        ("face_count", "i4"),
        ("clipped_count", "i4"),
        ("surface_count", "i4"),  # filled by `surface`
        ("unused_too", "i4"),
        ("q", "i8"),  # (height, width) float32, one over depth
        ("ids", "i8"),  # (height, width) int32
        ("screen", "i8"),  # (vertices of the largest asset, 3) float32
        ("parts", "i8"),  # visible parts: two for each part, its faces and its clipped ones
        ("faces", "i8"),  # (faces, 16) float32: what a drawn face interpolates
        ("clipped", "i8"),  # (clipped corners, 5) float32: their attributes
        # For shading:
        ("fragments", "i8"),  # (samples,) FRAGMENT
        ("sorted", "i8"),  # (samples,) int32: fragments by visible part
        ("linear", "i8"),  # (pixels, 3) float32
        ("image", "i8"),  # (pixels, 3) uint8
        ("depth", "i8"),  # (pixels,) float32
        ("seen", "i8"),  # (pixels,) uint8: samples of the target
        ("support", "i8"),  # (pixels,) uint8: samples of items that are supports
        ("encode", "i8"),  # see `draw.srgb_tables`
        ("thresholds", "i8"),
        ("shadow", "i8"),  # GRID, 0 none
        ("irradiance", "f4", 9),  # of a normal: constant, y, z, x, xy, yz, 3zz - 1, xz, xx - yy
        ("radiance", "f4", 9),  # the same of a direction
        ("sun", "f4", 4),  # the light's main direction, and the radiance of its highlight
        ("albedo", "f4", 3),  # of the target
        # Samples that show the target:
        ("surface", "i8"),  # (7, samples) float32: place and normal in the world, irradiance
        ("places", "i8"),  # (2, samples) int32: pixel, and a vertex of the face
        ("colours", "i8"),  # (3, surface_count) float32: linear RGB
        ("normals", "i8"),  # (pixels, 3) float32: in the camera's frame, see `normals.cc`
    ],
    align=True,
)
DRAWN = (
    "rotation", "translation", "items", "item_count", "width", "height", "focal", "cx", "cy", "near", "keep",
    "q", "ids", "screen", "parts", "faces", "clipped",
)  # fmt: skip
"""The fields of a TASK that drawing reads."""
SWEEP = np.dtype(
    [
        ("occupancy", "i8"),  # (z, y, x) float32, areas in units of a cell's base
        ("planes", "i8"),  # (2, directions, padded y, padded x) float32: scratch
        ("gathered", "i8"),  # (4, y, x) float32: scratch
        ("directions", "i8"),  # (directions, 2) float32: metres along x, y per metre of z
        ("weights", "i8"),  # (directions, 4) float32: lost irradiance when blocked
        ("direction_count", "i4"),
        ("reach", "f4"),  # metres of height over which a shadow fades to 1 / e; 0 never
        ("items", "i8"),
        ("item_count", "i4"),
        ("opacity", "f4"),
        ("grid", GRID),
    ],
    align=True,
)
TARGET = np.dtype(
    [
        ("asset", "i8"),  # to be filled; irradiance is the fourth attribute, the vertex's number the fifth
        ("vertices", "i8"),  # (V, 3) float32
        ("added", "i8"),  # (V,) float32, irradiance by self-shadow and bounce; 0 none
        ("irradiance", "f4", 9),
        ("unused", "i4"),
    ],
    align=True,
)
SEARCH = np.dtype(
    [
        ("scene", "i8"),  # TASK, prepared for drawing the depth of the items
        ("starts", "i8"),  # (items, 3) float64: where the items are at offset 0
        ("pixels", "i8"),  # (pixel_count,) int64: those that show the object
        ("own", "i8"),  # (pixel_count,) float32: the object's depths there
        ("hidden", "i8"),  # (pixel_count,) uint8: what is hidden already
        ("pixel_count", "i4"),
        ("outcome", "i4"),  # filled by the search
        ("motion", "f8", 3),  # metres per unit of offset
        ("least", "f8"),
        ("most", "f8"),
        ("level", "f8"),
        ("tolerance", "f8"),
        ("offset", "f8"),  # filled by the search: the last that was tried
    ],
    align=True,
)
SUPPORT = np.dtype(
    [
        ("weight", "f8"),
        ("turn", "f8"),
        ("clearance", "f8"),
        ("behind", "f8"),  # metres to a wall or back, inf none
        ("half", "f8", 2),
        ("centre", "f8", 3),
    ],
    align=True,
)
SOLID = np.dtype(
    [("sides", "f8", (4, 3)), ("low", "f8"), ("high", "f8")],  # outward normals and offsets of sides
    align=True,
)
PLACE = np.dtype(
    [
        ("turn", "f8"),  # radians, layout to world
        ("spot", "f8", 3),  # of the object in the layout
        ("slide", "f8", 3),  # from there to the support's edge on the side of the people
        ("state", "i4"),
        ("unused", "i4"),
    ],
    align=True,
)
PLACES = np.dtype(
    [
        ("supports", "i8"),  # SUPPORT
        ("chosen", "i8"),  # (places,) int64: number of each one's support
        ("draws", "i8"),  # (places, 5) float64 in [0, 1)
        ("body", "i8"),  # (body_count, 2) float64: outline of the object
        ("outline", "i8"),  # (corner_count, 2) float64: of the room
        ("solids", "i8"),  # (solid_count,) SOLID
        ("places", "i8"),  # PLACE, to be filled from `first` to `end`
        ("first", "i4"),
        ("end", "i4"),
        ("body_count", "i4"),
        ("corner_count", "i4"),
        ("solid_count", "i4"),
        ("hiding", "i4"),  # whether something is to be before the object
        ("body_height", "f8"),
        ("eye", "f8", 3),  # in the world
        ("ahead", "f8"),  # radians, of the direction away from the camera
        ("slid", "f8"),  # share of the slide
        ("clearance", "f8"),  # metres, see `place.py`
        ("lowest", "f8"),
        ("highest", "f8"),
        ("edge", "f8"),
        ("near_ray", "f8"),
        ("wall_share", "f8"),
    ],
    align=True,
)
STAGE = np.dtype(
    [
        ("rotation", "f8", (3, 3)),  # camera_from_world
        ("translation", "f8", 3),
        ("eye", "f8", 3),
        ("focal", "f8"),
        ("cx", "f8"),
        ("cy", "f8"),
        ("width", "i4"),
        ("height", "i4"),
        # The object:
        ("sums", "i8"),  # (height + 1, width + 1) int64, see `Actor.sums`
        ("pixel_count", "i4"),
        ("closer", "i4"),  # whether nearness to the eye is drawn on a log scale
        ("middle", "f8", 2),  # row and column
        ("ahead", "f8", 3),
        ("aside", "f8", 3),
        ("body_front", "f8"),  # metres from the object's axis towards the camera
        ("body_depth", "f8"),  # its least coordinate along the direction of view
        ("scale", "f8"),
        ("margin", "f8"),
        ("nearest", "f8"),
        ("gap", "f8"),  # metres between the object and what stands before it, besides the margin
        ("widest_gap", "f8"),
        ("support", "f8", (3, 3)),  # its axes, as rows
        ("support_origin", "f8", 3),  # along these
        ("half", "f8", 2),
        ("clearance", "f8"),
        ("hand_inside", "f8"),  # pixels
    ],
    align=True,
)
OCCLUDER = np.dtype(
    [
        ("stage", "i8"),  # STAGE
        ("kind", "i4"),
        ("draws", "i4"),
        ("uniform", "i8"),  # (draws, 3) float64 in [0, 1) for what stands, else (draws, 7)
        ("normal", "i8"),  # (draws, 3) float64
        ("points", "i8"),  # (props, point_count, 3) float64: farthest points of props
        ("hands", "i8"),  # (draws, hand_count, 3) float64: of the arms that hold; 0 none
        ("point_count", "i4"),
        ("hand_count", "i4"),
        ("props", "i4"),
        ("thin", "i4"),  # the prop's axis of least extent
        ("level", "f8"),
        ("hidden", "f8"),  # share that is hidden already
        ("first", "f8"),  # ends of the offset, which may be nearer to each other
        ("last", "f8"),
        # Filled:
        ("drawn", "i4"),  # number of the draw, -1 none
        ("unused", "i4"),
        ("turn", "f8", (3, 3)),
        ("position", "f8", 3),
        ("hand_turn", "f8", (3, 3)),
        ("hand_position", "f8", 3),
        ("motion", "f8", 3),
        ("least", "f8"),
        ("most", "f8"),
        ("front", "f8"),  # least coordinate along the direction of view
        ("bound", "f8"),  # share hidden at most at the least offset
    ],
    align=True,
)
OCCLUDER_INPUTS = tuple(list(OCCLUDER.names or ())[: list(OCCLUDER.names or ()).index("drawn")])
"""The fields of an OCCLUDER that are not filled."""

_NAMES = {"i4": "int", "f4": "float", "f8": "double", "i8": "wp::int64"}


def _declared(dtype: np.dtype, name: str) -> str:
    lines = []
    assert dtype.fields is not None
    for field, (kind, *_) in dtype.fields.items():
        base, shape = kind.subdtype or (kind, ())
        kind_name = "Grid" if base == GRID else _NAMES[base.str[1:]]
        lines.append(f"{kind_name} {field}{''.join(f'[{n}]' for n in shape)};")
    checked = f'static_assert(sizeof({name}) == {dtype.itemsize}, "{name}");'
    return "struct " + name + " { " + " ".join(lines) + " };\n" + checked + "\n"


_STRUCTS = {
    "Part": PART,
    "Cluster": CLUSTER,
    "Header": HEADER,
    "Grid": GRID,
    "Finish": FINISH,
    "Item": ITEM,
    "VisiblePart": VISIBLE_PART,
    "Fragment": FRAGMENT,
    "Task": TASK,
    "Sweep": SWEEP,
    "Target": TARGET,
    "Search": SEARCH,
    "Support": SUPPORT,
    "Solid": SOLID,
    "Place": PLACE,
    "Places": PLACES,
    "Stage": STAGE,
    "Occluder": OCCLUDER,
}


def declarations() -> str:
    """The records and constants of this module in C++, for the beginning of a native function."""
    constants = (
        f"constexpr {'int' if isinstance(value, int) else 'float'} {name} = {value!r};\n"
        for name, value in _CONSTANTS.items()
    )
    return "".join([*(_declared(dtype, name) for name, dtype in _STRUCTS.items()), *constants])


def address(array: np.ndarray) -> int:
    """Where an array's first element lies in memory."""
    return array.ctypes.data  # `__array_interface__` lists a record's fields, which takes far longer

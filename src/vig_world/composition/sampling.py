"""Draws a scene from (seed, index): latents, light, a furnished room, and props that hide a chosen share."""

import math
from collections import Counter
from dataclasses import replace

import numpy as np

from vig.scene import IMAGE_SIZE, ObjectClass
from vig_world import World
from vig_world.assets.target import draw_shape, standing_vertices
from vig_world.composition.clutter import scatter
from vig_world.composition.occlusion import hide
from vig_world.composition.photographs import draw_manner
from vig_world.composition.place import find_place, fits_seamless_ground
from vig_world.composition.stage import LAYOUT_SIZE, Actor
from vig_world.dataset.spec import Lens, Placed, Room, SampleError, SceneSpec, Split
from vig_world.library import SLOTS, Library
from vig_world.raster.draw import depth
from vig_world.raster.view import View
from vig_world.renderers.rasterized import items_of
from vig_world.rooms.unfurnished import SPACE
from vig_world.streams import stream

MAX_OCCLUSION = 0.9
GOLDEN = (math.sqrt(5) - 1) / 2
TOLERANCE = 0.015
ATTEMPTS, HALL_ATTEMPTS, SIZE_ATTEMPTS = 300, 72, 12
"""Rooms, and as many seamless grounds, tried; empty halls after these; how many with props of a size."""
TARGET_STREAM, MANNER_STREAM = 2**20 + 1, 2**20 + 4
"""Numbers of the random streams of a seed's first target, and of the manner of a photograph."""
BOARDS_FROM = 8  # first attempt from which shelf boards may reach into the picture


class CompositionError(SampleError):
    """A scene that cannot be composed: no room hides as much of the object as it should."""


def sample(
    library: Library,
    object_class: ObjectClass,
    seed: int,
    index: int,
    world: World = "photo",
    smaller: float = 1.0,
    target: float | None = None,
    draw: int = 0,
) -> SceneSpec:
    """Draw scene number `index` of a seed.

    Latents and the target occlusion are drawn first and never redrawn, so their distributions are exactly the
    documented ones: shape as in `target.draw_shape`, azimuth uniform, elevation uniform in [0.05, pi/2],
    albedo uniform in [0.2, 0.8], occlusion uniform in [0, 0.9]. Only rooms, spots and placements are redrawn,
    until the hidden share of the object is within 0.015 of the target. In the world of photographs elevation,
    albedo, coat and lens are those of `photographs.draw_manner` instead, some objects stand on a seamless
    ground, and the rare one that no room hides as it should stands on such a ground, half as much hidden.
    One without a place there either, as its camera finds no space, stands in an empty hall.

    Args:
        library: Assets of the split.
        object_class: Class of the object.
        seed: Seed of the scenes.
        index: Number of the scene.
        world: Kind of scenes.
        smaller: Factor of a photograph's object's size in the frame.
        target: Share to be hidden, in place of one that is drawn.
        draw: Number of the scene among those that the sample may have: the next one takes the place of one
            that cannot be made. The target of further draws is uniform; `rejected["scene"]` holds the number.

    Raises:
        CompositionError: No placement reached the target in `ATTEMPTS` rooms and `HALL_ATTEMPTS` halls.
    """
    split = library.split
    rng = stream(seed, index, split, 0, draw)
    shape, design = draw_shape(rng, object_class, split)
    azimuth, elevation = rng.uniform(0, 2 * np.pi), rng.uniform(0.05, np.pi / 2)  # radians
    albedo = rng.uniform(0.2, 0.8, 3)
    panorama, turn = int(rng.integers(library.panoramas)), rng.uniform(0, 2 * np.pi)
    if target is None:
        target = rng.uniform(0, MAX_OCCLUSION) if draw else target_occlusion(seed, index, split)
    finishes = tuple((slot, library.draw_finish(slot, rng)) for slot in SLOTS)

    vertices = standing_vertices(shape, design, object_class)
    coat, lens, layouts = None, Lens(), range(library.layouts)
    if world == "photo":
        manner = draw_manner(stream(seed, index, split, MANNER_STREAM, draw), object_class, vertices, azimuth)
        elevation, albedo, coat, lens = manner.elevation, manner.albedo, manner.coat, manner.lens
        shift = (smaller * lens.shift[0], smaller * lens.shift[1])
        lens = replace(lens, scale=smaller * lens.scale, shift=shift) if smaller != 1 else lens
        layouts = library.sweeps if manner.seamless else layouts
    actor = Actor.of(
        View.through(lens, object_class, azimuth, elevation, LAYOUT_SIZE),
        object_class,
        vertices,
        elevation,
        azimuth,
    )
    rejected: Counter[str] = Counter({"scene": draw} if draw else {})
    # Share of scenes seen from below an elevation (radians) in which room and furniture hide most of the
    # hidden part, if one of so many rooms allows it.
    support_share, support_below, support_attempts = 0.4, 1.1, 4
    by_support = rng.uniform() < support_share and elevation < support_below
    wanted, furnished = target, ATTEMPTS if world == "paper" else 2 * ATTEMPTS
    for attempt in range(furnished + HALL_ATTEMPTS):
        if attempt == ATTEMPTS:
            target, layouts = target / 2, library.sweeps
        if attempt == furnished:
            target, layouts = wanted, library.halls(hall_size(actor))
        if attempt in (0, ATTEMPTS):
            hopeless = layouts == library.sweeps and not fits_seamless_ground(actor)
        if hopeless and attempt < furnished:
            rejected["room"] += 1
            continue
        rng = stream(seed, index, split, 1 + attempt, draw)
        least = 0.6 * target if by_support and attempt < support_attempts else 0.0
        stage = find_place(library, layouts, actor, finishes, (least, target), rng, rejected)
        if stage is not None:
            stage.halvings, stage.closer = _halvings(actor, attempt, furnished), attempt >= furnished
        if stage is None or not hide(stage, target, rng, rejected, attempt >= BOARDS_FROM):
            rejected["room"] += 1
            continue
        scatter(stage, rng, rejected)
        occlusion = measure(library, actor, stage.room, stage.props)
        if abs(occlusion - target) > TOLERANCE:
            rejected["tolerance"] += 1
            continue
        light = library.light(panorama, turn, library.ground_albedo(stage.room))
        return SceneSpec(
            seed=seed,
            index=index,
            split=split,
            shape=tuple(shape.tolist()),
            design=design,
            azimuth=azimuth,
            elevation=elevation,
            albedo=tuple(albedo.tolist()),
            light=tuple(light.tolist()),
            panorama=panorama,
            panorama_angle=turn,
            target=target,
            occlusion=occlusion,
            room=stage.room,
            props=tuple(stage.props),
            rejected=dict(sorted(rejected.items())),
            coat=coat,
            lens=lens,
        )
    raise CompositionError(
        f"sample {index} of seed {seed}: expected a scene that hides {target:.0%} of the object;"
        f" {ATTEMPTS} rooms gave none. Provide larger props or other furniture, or use another seed."
        f" ({dict(rejected)})"
    )


def _halvings(actor: Actor, attempt: int, furnished: int) -> int:
    """Return how often props are halved in an attempt: more and more in halls; early for small objects."""
    least = math.floor(-math.log2(actor.small))
    if attempt < furnished:
        return least if attempt >= BOARDS_FROM else 0
    return least + (attempt - furnished) // SIZE_ATTEMPTS


def hall_size(actor: Actor) -> int:
    """Return the size of the smallest empty hall with space for object and camera, see `Library.halls`."""
    reach = max(np.linalg.norm(actor.view.eye), np.abs(actor.body.outline).max(), actor.body.heights[1])
    return max(0, math.ceil(math.log2(float(reach) / SPACE)))


def target_occlusion(seed: int, index: int, split: Split) -> float:
    """Return the share to hide, in [0, 0.9): multiples of the golden ratio, wrapped, from a random start.

    Any run of samples is spread evenly over the range: each tenth of N has N / 10, give or take one or two.
    """
    start = stream(seed, 0, split, TARGET_STREAM).uniform()
    return MAX_OCCLUSION * ((start + index * GOLDEN) % 1.0)


def measure(library: Library, actor: Actor, room: Room, props: list[Placed]) -> float:
    """Return the hidden share of the object at the full size of the image, one sample per pixel."""
    view = actor.view.scale(IMAGE_SIZE / LAYOUT_SIZE)
    alone = depth([actor.item], view)[0]
    return float((depth(items_of(library, props, room), view)[0] < alone)[np.isfinite(alone)].mean())

"""Cut-outs of solid things, to put pictures together from: the world's props, animals and vehicles."""

from __future__ import annotations

import functools
import hashlib
import math
from pathlib import Path

import numpy as np
from PIL import Image

from vig.scene import Camera, linear_from_srgb, srgb_from_linear
from vig_world import SPLITS, Split
from vig_world.asset_cache import asset_cache
from vig_world.assets.coats import TEXTURES, any_colour, stock_texture
from vig_world.assets.props import FAMILIES, Material, Prop, is_of_class
from vig_world.assets.props.material import material, plain, prop
from vig_world.assets.props.shapes import blob, box, moved, revolve, tube
from vig_world.mesh import Mesh, vertex_normals
from vig_world.raster.rasterize import rasterize

CUTOUTS_PER_SPLIT = 1600
"""Cut-outs of each kind, any and lookalike, that a split has."""
CUTOUT_PIXELS = 112
"""Side of the picture in which a cut-out is rendered, pixels."""
SUPERSAMPLING = 2
"""Rendered points across each pixel."""
ANIMAL_SHARE = 0.3
VEHICLE_SHARE = 0.1
"""Share of cut-outs; those that are neither animals nor vehicles are props."""
LOOKALIKES = (
    "basket", "bowl", "cup_saucer", "cup_saucer", "flask", "goblet", "jug", "jug", "milk_bottle", "mug",
    "mug", "mug", "mug", "saucepan", "sugar_bowl", "teacups", "tumbler", "vase_plant",
)  # fmt: skip
"""Families of props that share something with vessels that pour, and are none; some more often."""


def draw_cutout(rng: np.random.Generator, split: Split) -> Image.Image:
    """One of a split's things: RGBA, sRGB, as large as its outline."""
    return _numbered_cutout(
        int(rng.integers(CUTOUTS_PER_SPLIT)) + CUTOUTS_PER_SPLIT * SPLITS.index(split), False
    )


def draw_other(rng: np.random.Generator, split: Split, name: str) -> Image.Image:
    """One of a split's things that are not of the class of this name; see `draw_cutout`."""
    first, number = CUTOUTS_PER_SPLIT * SPLITS.index(split), int(rng.integers(CUTOUTS_PER_SPLIT))
    while is_of_class(_family_of(first + number), name):
        number = (number + 1) % CUTOUTS_PER_SPLIT
    return _numbered_cutout(first + number, False)


def draw_vessel(rng: np.random.Generator, split: Split, name: str) -> Image.Image:
    """One of a split's vessels that are not of the class of this name; see `draw_cutout`."""
    number = int(rng.integers(CUTOUTS_PER_SPLIT))
    for _ in LOOKALIKES:
        if not is_of_class(
            LOOKALIKES[(number + CUTOUTS_PER_SPLIT * SPLITS.index(split)) % len(LOOKALIKES)], name
        ):
            break
        number = (number + 1) % CUTOUTS_PER_SPLIT
    return _numbered_cutout(number + CUTOUTS_PER_SPLIT * SPLITS.index(split), True)


@functools.lru_cache(maxsize=2 * CUTOUTS_PER_SPLIT)
def _numbered_cutout(number: int, lookalike: bool) -> Image.Image:
    """The cut-out of a number, made at most once on a machine: it takes a hundredth of a second."""
    name = f"{_code()}/{'lookalike' if lookalike else 'any'}/{number}"
    made = asset_cache().arrays(name, lambda: {"rgba": np.asarray(_make_cutout(number, lookalike))})
    return Image.fromarray(made["rgba"])


@functools.cache
def _code() -> str:
    """Under what name this file's cut-outs are kept."""
    return f"cutouts-{hashlib.sha256(Path(__file__).read_bytes()).hexdigest()[:8]}"


def _make_cutout(number: int, lookalike: bool) -> Image.Image:
    """A prop in a random pose under a random light."""
    rng = _stream(number, lookalike)
    kind = rng.random()
    family = LOOKALIKES[number % len(LOOKALIKES)] if lookalike else _family_of(number, kind)
    shown_prop = {"animal": _animal, "vehicle": _vehicle, **FAMILIES}[family](rng)
    if rng.random() < 0.4:  # in other colours than such things have
        shown_prop = Prop(
            shown_prop.family,
            tuple((mesh, _random_material(rng, surface)) for mesh, surface in shown_prop.parts),
        )
    fallen = rng.random() < 0.12 and not lookalike
    return render_cutout(rng, shown_prop, rng.uniform(0, 2 * math.pi) if fallen else 0.0)


def _stream(number: int, lookalike: bool) -> np.random.Generator:
    return np.random.default_rng(np.random.SeedSequence([number, 33, int(lookalike)]))


def _family_of(number: int, kind: float | None = None) -> str:
    """Of the thing of a number, of any kind; `kind` is the first number of its stream."""
    kind = float(_stream(number, False).random()) if kind is None else kind
    if kind < ANIMAL_SHARE:
        return "animal"
    if kind < ANIMAL_SHARE + VEHICLE_SHARE:
        return "vehicle"
    return list(FAMILIES)[number % len(FAMILIES)]


def place_cutout(
    cutout: Image.Image, middle: tuple[float, float], size: float, angle: float, side: int
) -> np.ndarray:
    """A cut-out in an otherwise empty picture: (side, side, 4) linear RGB, not multiplied, and coverage.

    Args:
        cutout: RGBA.
        middle: Where its middle comes to be, in widths from the picture's middle.
        size: Its longest side, in widths of the picture.
        angle: Degrees by which it is turned, counter-clockwise.
        side: Of the picture, pixels.
    """
    rotated = cutout.rotate(angle, Image.Resampling.BILINEAR, expand=True) if abs(angle) > 1 else cutout
    factor = size * side / max(cutout.size)
    shape = (max(1, round(rotated.width * factor)), max(1, round(rotated.height * factor)))
    rotated = rotated.resize(shape, Image.Resampling.BILINEAR)
    canvas = Image.new("RGBA", (side, side))
    left, top = (
        round((0.5 + offset) * side - length / 2) for offset, length in zip(middle, shape, strict=True)
    )
    canvas.paste(rotated, (left, top))
    pixels = np.asarray(canvas)
    return np.concatenate([_LINEAR[pixels[..., :3]], pixels[..., 3:] / np.float32(255)], axis=2)


_LINEAR = linear_from_srgb(np.arange(256) / 255).astype(np.float32)


def render_cutout(rng: np.random.Generator, shown_prop: Prop, roll: float) -> Image.Image:
    """A picture of a thing, turned at random about the vertical: RGBA, sRGB, as large as its outline.

    roll: of the camera, radians.
    """
    meshes = [mesh for mesh, _ in shown_prop.parts]
    points = np.concatenate([mesh.vertices for mesh in meshes])
    starts = np.cumsum([0] + [len(mesh.vertices) for mesh in meshes])
    faces = np.concatenate([mesh.faces + start for mesh, start in zip(meshes, starts, strict=False)])
    owner = np.repeat(np.arange(len(meshes)), [len(mesh.faces) for mesh in meshes])
    points = points - (points.min(0) + points.max(0)) / 2
    reach = float(np.linalg.norm(points, axis=1).max())
    size = CUTOUT_PIXELS * SUPERSAMPLING
    camera = Camera(size, size, 1.9 * size, size / 2, size / 2, 4.0 * reach, roll=roll)
    from_above = rng.random() < 0.25
    matrix = camera.camera_from_world(
        rng.uniform(0, 2 * math.pi), math.radians(rng.uniform(30, 85) if from_above else rng.uniform(-5, 30))
    )
    rotation = matrix[:3, :3]
    fragments = rasterize(points, faces, rotation, matrix[:3, 3], camera)
    covered = fragments.face >= 0
    face, weights = fragments.face[covered], fragments.barycentric[covered]
    normals = np.concatenate([vertex_normals(mesh.vertices, mesh.faces) for mesh in meshes])
    uv = np.concatenate([np.zeros((len(m.vertices), 2)) if m.uv is None else m.uv for m in meshes])
    attributes = np.concatenate([normals @ rotation.T, uv], axis=1)
    interpolated = np.add.reduce([weights[:, c, None] * attributes[faces[face, c]] for c in range(3)])
    normal = interpolated[:, :3] / (np.linalg.norm(interpolated[:, :3], axis=1, keepdims=True) + 1e-9)
    normal = np.where(normal[:, 2:] > 0, -normal, normal)
    colour = np.empty((len(face), 3), np.float32)
    shine = np.zeros((len(face), 1))
    for number, (_, surface) in enumerate(shown_prop.parts):
        of_part = owner[face] == number
        height, width = surface.texture.shape[:2]
        u, v = interpolated[of_part, 3], 1 - interpolated[of_part, 4]
        colour[of_part] = surface.texture[(v * height).astype(int) % height, (u * width).astype(int) % width]
        shine[of_part] = 0.7 * (1 - surface.roughness) ** 2
    light = rng.normal(size=3) + [0, -0.9, -0.9]
    light /= np.linalg.norm(light)
    half_vector = light - [0, 0, 1]
    half_vector /= np.linalg.norm(half_vector)
    shading = (
        rng.uniform(0.2, 0.6) * (0.75 - 0.25 * normal[:, 1:2])
        + rng.uniform(0.3, 0.9) * (normal @ light).clip(0)[:, None]
    )
    specular = (normal @ half_vector).clip(0)[:, None] ** np.exp(rng.uniform(2, 5.5))
    picture = np.zeros((size, size, 4), np.float32)
    picture[covered] = np.concatenate([colour * shading + shine * specular, np.ones_like(specular)], axis=1)
    parts = [
        picture[i::SUPERSAMPLING, j::SUPERSAMPLING]
        for i in range(SUPERSAMPLING)
        for j in range(SUPERSAMPLING)
    ]
    mean = np.add.reduce(parts) / len(parts)
    display = srgb_from_linear((mean[..., :3] / np.maximum(mean[..., 3:], 1e-6)).clip(0, 1))
    image = Image.fromarray((np.concatenate([display, mean[..., 3:]], axis=2) * 255).round().astype(np.uint8))
    return image.crop(image.getchannel("A").getbbox() or (0, 0, 1, 1))


def _random_material(rng: np.random.Generator, original: Material) -> Material:
    """A material in any colour or texture."""
    if rng.random() < 0.5:
        image = np.broadcast_to(any_colour(rng), (4, 4, 3))
    else:
        image = stock_texture(int(rng.integers(TEXTURES)))
    return Material(image, original.kind, original.roughness)


def _hide(rng: np.random.Generator) -> Material:
    """A hide: of one colour, in patches of two, or of any texture."""
    kind = rng.random()
    if kind < 0.4:
        return plain("cloth", rng, any_colour(rng))
    if kind < 0.6:
        return material("cloth", rng, "speckle", any_colour(rng))
    y, x = np.mgrid[:64, :64] / 64 * 2 * math.pi
    waves = rng.integers(-3, 4, (5, 2))
    value = sum(np.sin(a * x + b * y + rng.uniform(0, 6.28)) for a, b in waves)
    image = np.where((value > rng.uniform(-1, 1))[..., None], any_colour(rng), any_colour(rng))
    return Material(image.astype(np.float32), "cloth", float(rng.uniform(0.3, 1.0)))


def _limb(start: list[float], end: list[float], radius: float, taper: float) -> Mesh:
    """A rounded, tapering limb between two points (3,)."""
    t = np.linspace(0, 1, 7)[:, None]
    path = np.array(start) * (1 - t) + np.array(end) * t
    path = path + 1e-4 * np.sin(3 * t)  # never straight up, see `tube`
    width = radius * (1 + (taper - 1) * t[:, 0]) * np.sqrt(1 - (2 * t[:, 0] - 1) ** 8 + 0.02)
    return tube(path, width, 8, up=(0.0, 1.0, 0.0))


def _animal(rng: np.random.Generator) -> Prop:
    """A four-legged animal: cow, horse, dog, sheep, pig or the like, standing or lying, as a toy of it is."""
    length, thickness = 1.0, rng.uniform(0.16, 0.34)
    leg = rng.uniform(0.15, 0.6) if rng.random() < 0.85 else 0.05
    coat = _hide(rng)
    second_coat = _hide(rng) if rng.random() < 0.3 else coat
    belly = leg + thickness
    parts: list[tuple[Mesh, Material]] = [
        (
            moved(blob((length, 1.6 * thickness, 2 * thickness), 16, 10, rng.uniform(2.0, 3.0)), (0, 0, leg)),
            coat,
        )
    ]
    for x in (-0.36, 0.36):
        for y in (-0.5, 0.5):
            foot = [x + rng.uniform(-0.12, 0.12), y * thickness, 0.0]
            limb = _limb([x, y * thickness, belly], foot, rng.uniform(0.04, 0.08), rng.uniform(0.5, 1.0))
            parts.append((limb, second_coat))
    rise, ahead = rng.uniform(-0.1, 0.5), rng.uniform(0.05, 0.3)
    neck = [0.42, 0.0, belly + 0.3 * thickness]
    head = [0.45 + ahead, 0.0, belly + 0.3 * thickness + rise]
    parts.append((_limb(neck, head, rng.uniform(0.08, 0.16), rng.uniform(0.6, 1.0)), coat))
    nose = [head[0] + rng.uniform(0.12, 0.3), 0.0, head[2] - rng.uniform(0.0, 0.2)]
    parts.append((_limb(head, nose, rng.uniform(0.08, 0.14), rng.uniform(0.5, 0.9)), second_coat))
    for y in (-1, 1):
        tip = [head[0] - 0.04, y * rng.uniform(0.08, 0.16), head[2] + rng.uniform(0.0, 0.22)]
        parts.append((_limb([head[0], y * 0.05, head[2]], tip, 0.035, 0.4), second_coat))
    end = [-0.5 - rng.uniform(0.02, 0.25), 0.0, belly + rng.uniform(-0.4, 0.2)]
    parts.append((_limb([-0.46, 0.0, belly + 0.4 * thickness], end, rng.uniform(0.02, 0.06), 0.6), coat))
    if rng.random() < 0.3:
        parts.append((moved(box((1.2, 0.6, 0.03)), (0, 0, -0.03)), plain("plastic", rng, any_colour(rng))))
    return prop("animal", *parts)


def _vehicle(rng: np.random.Generator) -> Prop:
    """A toy car, van or lorry."""
    paint = plain("metal", rng, any_colour(rng))
    glass, tyre = plain("glass", rng, [0.04, 0.05, 0.06]), plain("plastic", rng, [0.03, 0.03, 0.03])
    width, height = rng.uniform(0.36, 0.5), rng.uniform(0.14, 0.3)
    clearance = rng.uniform(0.04, 0.1)
    body = blob((1.0, width, height), 24, 10, rng.uniform(3.5, 7.0))
    cabin_long, cabin_high = rng.uniform(0.4, 0.85), rng.uniform(0.12, 0.3)
    cabin_place = (rng.uniform(-0.15, 0.1), 0.0, clearance + 0.85 * height)
    cabin = blob((cabin_long, 0.88 * width, 1.15 * cabin_high), 24, 8, rng.uniform(2.5, 5.0))
    roof = blob((0.8 * cabin_long, 0.8 * width, 0.3 * cabin_high), 24, 6, 4.0)
    parts = [
        (moved(body, (0, 0, clearance)), paint),
        (moved(cabin, cabin_place), glass),
        (moved(roof, (cabin_place[0], 0.0, cabin_place[2] + 0.88 * cabin_high)), paint),
    ]
    radius = rng.uniform(0.08, 0.13)
    profile = [[0, 0], [0.5 * radius, 0], [radius, 0.01], [radius, 0.09], [0.5 * radius, 0.1], [0, 0.1]]
    wheel = revolve(profile, 16)
    upright_wheel = Mesh(wheel.vertices[:, [0, 2, 1]] * [1, -1, 1], wheel.faces, wheel.uv)
    hub = plain("metal", rng, any_colour(rng))
    for x in (-0.3, 0.3):
        for y in (-0.5 * width + 0.07, 0.5 * width + 0.03):
            parts.append((moved(upright_wheel, (x, y, radius)), tyre if rng.random() < 0.9 else hub))
    stripe = plain("plastic", rng, any_colour(rng))
    if rng.random() < 0.5:
        parts.append(
            (moved(box((1.01, 1.01 * width, 0.12 * height)), (0, 0, clearance + 0.5 * height)), stripe)
        )
    return prop("vehicle", *parts)

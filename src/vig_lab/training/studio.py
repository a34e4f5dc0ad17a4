"""A studio: training images drawn afresh, as wide as photographs are.

Each holds the object of a class with any surface, in any light, on a plain, set or cluttered ground, with
things beside and before it, through a camera of any lens, and what is true of it. All is a pure function of a
seed and an index.
"""

from __future__ import annotations

import functools
import io
import math
from dataclasses import dataclass, replace

import numpy as np
import torch
from PIL import Image
from scipy import ndimage

from vig.photo import Window
from vig.renderer.explained import vertex_irradiance
from vig.scene import (
    EXPOSURE_L00,
    IMAGE_SIZE,
    Camera,
    Latents,
    ObjectClass,
    srgb_from_linear,
)
from vig_lab.training.surfaces import DIELECTRIC, TEXTURES, Environment, Surface, any_colour, stock_texture
from vig_world.assets.target import draw_shape, shape_vertices
from vig_world.dataset.spec import Split
from vig_world.mesh import vertex_normals
from vig_world.renderers.rasterize import rasterize

SAMPLES = 2
"""Points across a pixel at which the object is drawn."""


@dataclass(frozen=True)
class StudioSettings:
    """Shares and spreads of what is drawn.

    Attributes:
        decorated: Share of objects that are painted.
        metal: Share that are of metal.
        glass: Share through which the ground shows.
        occluded: Share with things before the object.
        absent: Share of images without the object; half of these show part of one, such as a body alone.
        level: Share of views from within 15 degrees of the horizon.
        boxed: Share framed by a box about the object; others by the class's standard camera.
        small: Share in which the object is small and away from the middle.
        roll: Standard deviation of the camera's roll, radians; one image in five has up to eight times that.
        warp: Standard deviation by which shapes leave the model, as a share of the object's size.
    """

    decorated: float = 0.5
    metal: float = 0.08
    glass: float = 0.03
    occluded: float = 0.45
    absent: float = 0.1
    level: float = 0.6
    boxed: float = 0.6
    small: float = 0.1
    roll: float = 0.07
    warp: float = 0.02


@dataclass(frozen=True)
class StudioImage:
    """One image and what is true of it.

    Attributes:
        image: (H, W, 3) uint8 sRGB.
        latents: (P,) float32, in the order of `vig.scene.Latents.to_vector`; the albedo is the mean of the
            surface that is seen.
        roll: Clockwise turn of the image, radians.
        visible: (H, W) uint8, the share of each pixel in which the object is seen, of 255.
        hidden: (H, W) uint8, the share in which something before it is.
    """

    image: np.ndarray
    latents: np.ndarray
    roll: float
    visible: np.ndarray
    hidden: np.ndarray


@dataclass(frozen=True)
class _Layer:
    """Something drawn: linear RGB (H, W, 3), not multiplied with its coverage (H, W)."""

    colour: np.ndarray
    cover: np.ndarray

    def over(self, picture: np.ndarray) -> np.ndarray:
        """The layer before a picture (H, W, 3)."""
        return picture + self.cover[..., None] * (self.colour - picture)


class Studio:
    """Draws images of a class."""

    def __init__(
        self,
        object_class: ObjectClass,
        settings: StudioSettings = StudioSettings(),
        split: Split = "train",
    ):
        """Objects are of the class's designs of a split, see `draw_shape`."""
        self.object_class, self.settings, self.split = object_class, settings, split
        model = object_class.shape_model
        self.size = float(np.ptp(model.mean, axis=0).max())
        self.height = float(model.mean[:, 2].max())
        self._factor = np.linalg.cholesky(
            object_class.light_prior_covariance + 1e-9 * np.eye(len(object_class.light_prior_mean))
        )

    def draw(self, seed: int, index: int) -> StudioImage:
        """Draw an image."""
        rng = np.random.default_rng(np.random.SeedSequence([seed, index, 71]))
        settings = self.settings
        latents, vertices = self._shape(rng)
        camera = self._camera(rng, vertices, latents)
        surface = Surface.draw(
            rng, len(self.object_class.shape_model.part_names), settings.decorated, settings.metal
        )
        ground = _ground(rng)
        environment = Environment.draw(rng)
        absent = rng.random() < settings.absent
        faces = self.object_class.shape_model.faces
        if absent:
            faces = self._part(rng)
        tint = 1 + rng.normal(0, 0.04, 3)
        if len(faces):
            layer, albedo = self._object(rng, latents, vertices, faces, camera, surface, environment, ground)
            layer = replace(layer, colour=layer.colour * tint)
        else:
            layer = _Layer(ground, np.zeros(ground.shape[:2], np.float32))
            albedo = surface.colours.mean(0)
        place = _place(layer.cover)
        picture = _shadowed(rng, ground, layer.cover, place)
        colours = [*surface.colours[:2], any_colour(rng)]
        for _ in range(int(rng.choice([0, 1, 2, 3], p=[0.4, 0.3, 0.2, 0.1]))):
            picture = _thing(rng, colours, place, before=False).over(picture)
        picture = layer.over(picture)
        visible = layer.cover.copy()
        if rng.random() < settings.occluded:
            for _ in range(int(rng.integers(1, 4))):
                thing = _thing(rng, colours, place, before=True)
                picture = thing.over(picture)
                visible = visible * (1 - thing.cover)
        hidden = layer.cover - visible
        if absent:
            visible, hidden = np.zeros_like(visible), np.zeros_like(hidden)
        vector = replace(latents, albedo=torch.from_numpy(albedo[None].astype(np.float32))).to_vector()
        return StudioImage(
            _photographed(rng, picture),
            vector[0].numpy(),
            camera.roll,
            *(np.round(255 * share).astype(np.uint8) for share in (visible, hidden)),
        )

    def _shape(self, rng: np.random.Generator) -> tuple[Latents, np.ndarray]:
        """Latents but for the albedo, and vertices, a little off the model."""
        settings = self.settings
        shape, design = draw_shape(rng, self.object_class, self.split)
        kind = rng.random()
        if kind < settings.level:
            elevation = math.radians(rng.uniform(-4, 15))
        else:
            low = kind < settings.level + 0.6 * (1 - settings.level)
            elevation = math.radians(rng.uniform(15, 42) if low else rng.uniform(42, 89))
        light = self._factor @ rng.standard_normal(9) * rng.uniform(0.3, 1.3)
        light = light + rng.uniform(0.3, 1.0) * self.object_class.light_prior_mean
        light[0] = EXPOSURE_L00  # as in datasets: at a set exposure
        numbers = (shape, [rng.uniform(0, 2 * math.pi)], [elevation], np.full(3, 0.5), light)
        tensors = [torch.from_numpy(np.asarray(each, np.float32))[None] for each in numbers]
        latents = Latents(tensors[0], tensors[1][0], tensors[2][0], tensors[3], tensors[4])
        vertices = shape_vertices(shape, design, self.object_class)
        # A few long waves, as real ones are no members of the family; the mirror plane stays one.
        for _ in range(2):
            wave = rng.normal(size=3) * [1, 0, 1] * 2 * math.pi / self.size
            move = rng.normal(0, settings.warp * self.size, 3) * [1, 0, 1]
            vertices = vertices + np.sin(vertices @ wave + rng.uniform(0, 6.28))[:, None] * move
        vertices = vertices * np.exp(rng.normal(0, 0.06, 3))
        vertices[:, 2] -= vertices[:, 2].min()
        return latents, vertices.astype(np.float32)

    def _camera(self, rng: np.random.Generator, vertices: np.ndarray, latents: Latents) -> Camera:
        """A camera whose image frames the object as boxes do, or as the paper's camera does, about."""
        settings = self.settings
        camera = Camera.standard(IMAGE_SIZE, self.object_class.target_height)
        farther = math.exp(rng.uniform(math.log(0.9), math.log(12))) if rng.random() < 0.7 else 1.0
        wide = rng.random() < 0.2
        roll = float(rng.uniform(-8, 8) if wide else rng.normal()) * settings.roll
        camera = replace(camera, distance=camera.distance * farther, focal=camera.focal * farther, roll=roll)
        if rng.random() < settings.boxed:
            matrix = camera.camera_from_world(float(latents.azimuth), float(latents.elevation))
            seen = vertices @ matrix[:3, :3].T + matrix[:3, 3]
            x, y = (camera.focal * seen[:, :2] / seen[:, 2:]).T
            box = (x.min(), y.min(), float(np.ptp(x)), float(np.ptp(y)))
            window = Window.round_box(box)
            scale = IMAGE_SIZE / window.side
            camera = replace(
                camera, focal=camera.focal * scale, cx=-window.left * scale, cy=-window.top * scale
            )
        scale, shift = math.exp(rng.normal(0, 0.11)), rng.normal(0, 0.05, 2)
        if rng.random() < settings.small:
            scale, shift = rng.uniform(0.35, 0.9), rng.uniform(-0.25, 0.25, 2)
        middle = IMAGE_SIZE / 2
        return replace(
            camera,
            focal=camera.focal * scale,
            cx=middle + (camera.cx - middle) * scale + shift[0] * IMAGE_SIZE,
            cy=middle + (camera.cy - middle) * scale + shift[1] * IMAGE_SIZE,
        )

    def _part(self, rng: np.random.Generator) -> np.ndarray:
        """Faces of something like the object that is none, the first part with another; or nothing."""
        model = self.object_class.shape_model
        if rng.random() < 0.5:
            return model.faces[:0]
        part = model.parts[model.faces[:, 0]]
        kept = {0, int(rng.integers(1, len(model.part_names)))}
        return model.faces[np.isin(part, list(kept))]

    def _object(
        self,
        rng: np.random.Generator,
        latents: Latents,
        vertices: np.ndarray,
        faces: np.ndarray,
        camera: Camera,
        surface: Surface,
        environment: Environment,
        ground: np.ndarray,
    ) -> tuple[_Layer, np.ndarray]:
        """The object lit, and the mean albedo (3,) of what is seen of it."""
        model = self.object_class.shape_model
        matrix = camera.camera_from_world(float(latents.azimuth), float(latents.elevation))
        rotation, translation = matrix[:3, :3], matrix[:3, 3]
        fragments = rasterize(vertices, faces, rotation, translation, camera.scaled(SAMPLES))
        on = fragments.face >= 0
        corners, weights = faces[fragments.face[on]], fragments.barycentric[on]
        normals = vertex_normals(vertices, model.faces)
        shade = vertex_irradiance(latents, torch.from_numpy(normals), self.object_class).numpy()
        table = np.concatenate([vertices, normals, shade[:, None]], axis=1)
        rows = np.add.reduce([weights[:, corner, None] * table[corners[:, corner]] for corner in range(3)])
        points, normal, irradiance = rows[:, :3], rows[:, 3:6], rows[:, 6:]
        normal /= np.linalg.norm(normal, axis=1, keepdims=True) + 1e-9
        part = model.parts[corners[:, 0]]
        albedo = surface.albedo(points, part, self.height)
        towards = -rotation.T @ translation - points
        towards /= np.linalg.norm(towards, axis=1, keepdims=True)
        facing = (normal * towards).sum(1, keepdims=True)
        normal = np.where(facing < 0, -normal, normal)
        facing = np.abs(facing)
        mirrored = environment.radiance_from(2 * facing * normal - towards, surface.roughness)
        colour = albedo * np.maximum(irradiance, 0)
        if surface.metal:
            # What lights a mirror is about what lights a matt surface.
            colour = albedo * mirrored * rng.uniform(0.5, 1.1)
        elif surface.gloss:
            fresnel = DIELECTRIC + (1 - DIELECTRIC) * (1 - facing) ** 5
            colour = colour * (1 - 0.5 * fresnel) + surface.gloss * fresnel * mirrored
        if rng.random() < self.settings.glass:
            row, column = np.nonzero(on)
            bent = np.stack([row, column], 1) / SAMPLES + normal[:, 2:0:-1] * rng.uniform(3, 12)
            bent = np.clip(bent.astype(int), 0, IMAGE_SIZE - 1)
            through = ground[bent[:, 0], bent[:, 1]] * (0.3 + 0.7 * np.sqrt(albedo))
            colour = 0.85 * through + 0.15 * colour
        size = IMAGE_SIZE * SAMPLES
        picture = np.zeros((size, size, 4), np.float32)
        picture[on] = np.concatenate([colour, np.ones((len(colour), 1))], axis=1)
        parts = [picture[i::SAMPLES, j::SAMPLES] for i in range(SAMPLES) for j in range(SAMPLES)]
        mean = np.add.reduce(parts) / len(parts)
        cover = mean[..., 3]
        layer = _Layer(mean[..., :3] / np.maximum(cover, 1e-6)[..., None], cover)
        return layer, albedo.mean(0) if len(albedo) else surface.colours.mean(0)


@functools.cache
def _pixels() -> tuple[np.ndarray, np.ndarray]:
    """x and y (H, W) of pixel centres, in widths of the image, from its middle."""
    y, x = (np.mgrid[:IMAGE_SIZE, :IMAGE_SIZE] + 0.5) / IMAGE_SIZE - 0.5
    return x.astype(np.float32), y.astype(np.float32)


def _ground(rng: np.random.Generator) -> np.ndarray:
    """What is behind the object: (H, W, 3) linear RGB."""
    x, y = _pixels()
    kind = rng.random()
    if kind < 0.33:  # seamless
        bright = rng.choice(3, p=[0.5, 0.15, 0.35])
        first = (rng.uniform(0.75, 1.15, 3) ** 0.3, rng.uniform(0.0, 0.04, 3), any_colour(rng))[bright]
        slope = rng.normal(0, 0.35, 2)
        glow = np.exp(-(x**2 + y**2) / rng.uniform(0.1, 1.0)) * rng.uniform(-0.1, 0.4)
        return (first * np.clip(1 + slope[0] * x + slope[1] * y + glow, 0.05, 2)[..., None]).astype(
            np.float32
        )
    if kind < 0.6:  # a table before a wall
        edge = rng.uniform(-0.35, 0.4) + rng.normal(0, 0.05) * x
        below = np.clip((y - edge) * rng.choice([20, 60, 150]), 0, 1)[..., None]
        wall, table = (_sheet(rng) * _slope(rng) for _ in range(2))
        wall = _softened(wall, float(rng.uniform(0, 4)))
        picture = wall * (1 - below) + table * below
    else:  # clutter
        picture = _sheet(rng) * _slope(rng)
        for _ in range(int(rng.integers(4, 14))):
            centre = rng.uniform(-0.6, 0.6, 2)
            thing = _thing(rng, [any_colour(rng)], (*centre, rng.uniform(0.1, 0.5)), before=False)
            picture = thing.over(picture)
        picture = _softened(picture, float(rng.choice([0.0, 1.5, 4.0, 8.0])))
    return np.clip(picture, 0, 1.5).astype(np.float32)


def _sheet(rng: np.random.Generator) -> np.ndarray:
    """A flat texture or one colour: (H, W, 3)."""
    if rng.random() < 0.3:
        return np.broadcast_to(any_colour(rng), (IMAGE_SIZE, IMAGE_SIZE, 3))
    image = stock_texture(int(rng.integers(TEXTURES)))
    x, y = _pixels()
    angle, scale = rng.uniform(0, 6.28), np.exp(rng.uniform(np.log(0.4), np.log(4)))
    u, v = math.cos(angle) * x - math.sin(angle) * y, math.sin(angle) * x + math.cos(angle) * y
    side = len(image)
    return image[(v * scale * side).astype(int) % side, (u * scale * side).astype(int) % side]


def _slope(rng: np.random.Generator) -> np.ndarray:
    """Uneven light: (H, W, 1)."""
    x, y = _pixels()
    slope = rng.normal(0, 0.5, 2)
    return np.clip(rng.uniform(0.4, 1.3) * (1 + slope[0] * x + slope[1] * y), 0.05, 1.6)[..., None]


def _softened(picture: np.ndarray, blur: float) -> np.ndarray:
    """Out of focus by `blur` pixels."""
    if blur < 0.3:
        return picture
    size = 2 * int(blur) + 1
    once = ndimage.uniform_filter(picture, (size, size, 0), mode="nearest")
    return np.asarray(ndimage.uniform_filter(once, (size, size, 0), mode="nearest"))


def _place(cover: np.ndarray) -> tuple[float, float, float]:
    """Middle x, y and size of what is covered, in widths of the image, from its middle."""
    rows, columns = np.flatnonzero(cover.max(1) > 0.5), np.flatnonzero(cover.max(0) > 0.5)
    if not len(rows) or not len(columns):
        return 0.0, 0.0, 0.6
    x, y = (columns[0] + columns[-1]) / 2, (rows[0] + rows[-1]) / 2
    size = max(columns[-1] - columns[0], rows[-1] - rows[0])
    return x / IMAGE_SIZE - 0.5, y / IMAGE_SIZE - 0.5, size / IMAGE_SIZE


def _shadowed(
    rng: np.random.Generator, ground: np.ndarray, cover: np.ndarray, place: tuple[float, float, float]
) -> np.ndarray:
    """The ground with a soft shadow under and beside what stands on it."""
    if rng.random() < 0.25 or not cover.any():
        return ground
    x, y = _pixels()
    foot = np.flatnonzero(cover.max(1) > 0.5)
    low = (foot[-1] / IMAGE_SIZE - 0.5) if len(foot) else place[1]
    wide, high = place[2] * rng.uniform(0.35, 0.8), place[2] * rng.uniform(0.05, 0.25)
    off = rng.normal(0, 0.3) * wide
    away = ((x - place[0] - off) / wide) ** 2 + ((y - low + 0.3 * high) / high) ** 2
    dark = rng.uniform(0.15, 0.8) / (1 + np.exp(rng.uniform(2, 12) * (away.clip(0, 5) - 1)))
    return np.asarray(ground * (1 - dark[..., None]))


def _thing(
    rng: np.random.Generator, colours: list[np.ndarray], place: tuple[float, float, float], before: bool
) -> _Layer:
    """Something of a simple shape near a place, in one of the given colours, in another, or textured."""
    x, y = _pixels()
    angle = rng.uniform(0, math.pi)
    if before:
        middle = np.array(place[:2]) + rng.uniform(-0.6, 0.6, 2) * place[2]
        reach = place[2] * np.exp(rng.uniform(np.log(0.04), np.log(0.45), 2))
    else:
        middle = np.array(place[:2]) + rng.uniform(-1, 1, 2) * np.maximum(place[2], 0.3)
        reach = np.exp(rng.uniform(np.log(0.03), np.log(0.4), 2))
    cos, sin = math.cos(angle), math.sin(angle)
    along = cos * (x - middle[0]) + sin * (y - middle[1])
    across = cos * (y - middle[1]) - sin * (x - middle[0])
    if rng.random() < 0.3:  # a rod, a finger, a stalk
        reach = np.array([rng.uniform(0.15, 0.9), rng.uniform(0.01, 0.06)])
    across = across + rng.normal(0, 0.3) * along**2
    p, q = np.abs(along) / reach[0], np.abs(across) / reach[1]
    power = rng.choice([1.3, 2.0, 2.0, 6.0, 12.0])
    radius = (p**power + q**power) ** (1 / power)
    if rng.random() < 0.35:  # an uneven outline, as of leaves or cloth
        turn = np.arctan2(across / reach[1], along / reach[0])
        radius = radius * (
            1 + rng.uniform(0.05, 0.3) * np.sin(int(rng.integers(2, 9)) * turn + rng.uniform(0, 6))
        )
    soft = IMAGE_SIZE * min(reach) * rng.choice([1.0, 1.0, 0.4])
    cover = np.clip(0.5 + (1 - radius) * soft, 0, 1)
    if rng.random() < 0.12:  # a ring or a handle
        cover = cover * np.clip(0.5 + (radius - rng.uniform(0.5, 0.85)) * soft, 0, 1)
    own = rng.random()
    if own < 0.3:
        colour = colours[int(rng.integers(len(colours)))] * rng.uniform(0.7, 1.3)
    else:
        colour = any_colour(rng) if own < 0.65 else _sheet(rng)
    normal = np.clip(across / reach[1], -1, 1)
    light = rng.uniform(0.5, 1.2) * (1 + rng.uniform(-0.7, 0.7) * normal - 0.4 * rng.random() * normal**2)
    shaded = np.broadcast_to(colour, (IMAGE_SIZE, IMAGE_SIZE, 3)) * np.clip(light, 0.05, 2)[..., None]
    if rng.random() < 0.2:
        glint = np.exp(-(((along / reach[0]) - 0.3) ** 2 + ((across / reach[1]) + 0.3) ** 2) / 0.02)
        shaded = shaded + rng.uniform(0.2, 1) * glint[..., None]
    return _Layer(shaded.astype(np.float32), cover.astype(np.float32))


def _photographed(rng: np.random.Generator, picture: np.ndarray) -> np.ndarray:
    """What a camera, its software and a web site make of linear light: (H, W, 3) uint8 sRGB."""
    gain = math.exp(rng.normal(0, 0.2)) * np.exp(rng.normal(0, 0.04, 3))
    x, y = _pixels()
    dark = 1 - rng.uniform(0, 0.35) * (rng.random() < 0.3) * 2 * (x**2 + y**2)
    picture = picture * (gain * dark[..., None])
    if rng.random() < 0.6:
        picture = ndimage.gaussian_filter(picture, (*[float(rng.uniform(0.3, 1.0))] * 2, 0), truncate=2.5)
    display = srgb_from_linear(np.clip(picture, 0, 1)).astype(np.float32)
    if rng.random() < 0.3:  # contrast
        display = np.clip(0.5 + (display - 0.5) * rng.uniform(0.75, 1.4) + rng.normal(0, 0.05), 0, 1)
    if rng.random() < 0.25:  # sharpening
        soft = ndimage.uniform_filter(display, (3, 3, 0))
        display = np.clip(display + rng.uniform(0.3, 1.2) * (display - soft), 0, 1)
    display = display + rng.normal(0, 1, display.shape).astype(np.float32) * rng.uniform(0, 0.025)
    if rng.random() < 0.03:
        display = np.broadcast_to(display.mean(2, keepdims=True), display.shape)
    image = Image.fromarray((np.clip(display, 0, 1) * 255).round().astype(np.uint8))
    if rng.random() < 0.2:  # few pixels
        side = int(rng.integers(60, IMAGE_SIZE))
        image = image.resize((side, side), Image.Resampling.BOX).resize(
            (IMAGE_SIZE,) * 2, Image.Resampling.BICUBIC
        )
    if rng.random() < 0.7:
        file = io.BytesIO()
        image.save(file, "JPEG", quality=int(rng.integers(35, 96)))
        image = Image.open(file)
    return np.asarray(image)

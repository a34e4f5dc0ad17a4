"""A studio: training images drawn afresh, as wide as photographs are.

Each holds the object of a class with any surface, in any light, on a plain, set or cluttered ground, with
things beside and before it, through any lens, and its truth. All is a pure function of a seed and an index.
"""

import math
import sys
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np

from vig.renderer.drawing import vertex_irradiance
from vig.scene import EXPOSURE_L00, IMAGE_SIZE, SHAPE_LIMIT, Latents, ObjectClass, ShapeModel
from vig_world.assets.coats import any_colour, draw_coat
from vig_world.assets.held_out import held_out_designs_of
from vig_world.assets.source_meshes import SourceMesh, source_meshes_of
from vig_world.assets.target import DESIGN_SPREAD, NO_DESIGN, nearest_coefficients, shape_vertices
from vig_world.composition.photographs import framing_lens, reframe
from vig_world.dataset.spec import Coat, Lens, Split
from vig_world.mesh import vertex_normals
from vig_world.raster.view import View
from vig_world.renderers.coated import appearance_of
from vig_world.studio.cutouts import SUPERSAMPLING, model_cutouts
from vig_world.studio.grounds import cast_shadow, draw_ground
from vig_world.studio.layers import Environment, Layer, continue_border, photograph, place_of
from vig_world.studio.source_objects import appearance, draw_paint
from vig_world.studio.things import draw_instead, draw_thing, occlude

MAX_ATTEMPTS = 8
"""Attempts at drawing an image, each from its own random stream, before an error is raised."""
NOTHING, OTHER_VESSEL, OTHER_THING, PART, WHOLE = range(5)
"""Kinds of things that images show in the object's place."""


@dataclass(frozen=True)
class StudioSettings:
    """Shares and spreads of the drawn images.

    Attributes:
        decorated: Share of objects that are painted.
        metal: Share that are of metal.
        glass: Share through which the ground shows.
        occluded: Share with things before the object, which hide up to `most_hidden` of it.
        absent: Share of images without the object; a quarter of these show part of one, such as a body alone,
            a quarter a vessel, a quarter any other thing in its place.
        level: Share of views from within 15 degrees of the horizon.
        boxed: Share framed by a box about the object; others by the class's standard camera.
        small: Share in which the object is small and away from the middle.
        roll: Standard deviation of the camera's roll, radians.
        rolled: Share in which the roll is uniform up to `most_roll`, radians, instead.
        continued: Share in which the window reaches beyond its photo, whose border is continued.
        warp: Standard deviation by which shapes leave the model, at most, as a share of the object's size.
        source: Share of objects drawn as the user's mesh with its materials, where there is one; the others
            are the template with a coat.
        own_colours: Share of these whose materials are as their files have them; others are recoloured.
        props: Models to put before and behind objects as well, see `mesh_folder`; none where empty.
    """

    decorated: float = 0.5
    metal: float = 0.08
    glass: float = 0.03
    occluded: float = 0.6
    most_hidden: float = 0.8
    absent: float = 0.15
    level: float = 0.6
    boxed: float = 0.6
    small: float = 0.1
    roll: float = 0.07
    rolled: float = 0.2
    most_roll: float = 0.65
    continued: float = 0.2
    warp: float = 0.02
    source: float = 0.8
    own_colours: float = 0.4
    props: str = ""


@dataclass(frozen=True)
class StudioImage:
    """One image and its truth.

    Attributes:
        image: (H, W, 3) uint8 sRGB.
        latents: (P,) float32, in the order of `vig.scene.Latents.to_vector`; the albedo is the mean of the
            surface that is seen.
        lens: That of the camera, which stands at the latents' azimuth and elevation.
        vertices: (V, 3) float32, metres, of the object as drawn: near the latents' shape, but not of it.
        faces: (F, 3) of the object as drawn.
        coat: What covers it; None for one of the user's meshes, which has its materials.
        visible: (H, W) uint8, the share of each pixel in which the object is seen, of 255.
        hidden: (H, W) uint8, the share in which something before it is.
        model: Number of the model of the object, see `Studio.models`.
    """

    image: np.ndarray
    latents: np.ndarray
    lens: Lens
    vertices: np.ndarray
    faces: np.ndarray
    coat: Coat | None
    visible: np.ndarray
    hidden: np.ndarray
    model: int

    @property
    def roll(self) -> float:
        """Return the clockwise turn of the image, radians."""
        return self.lens.roll


@dataclass(frozen=True, eq=False)
class StudioModel:
    """A model of drawn objects: template (V, 3), metres, as it lies on a mesh, coefficients (K,) of the
    shape nearest to it, the mesh where it has materials, whether the class was built from it (others are
    refused ones), and the number of the design that was made from it, else `NO_DESIGN`.
    """

    template: np.ndarray
    nearest: np.ndarray
    mesh: SourceMesh | None
    of_class: bool
    design: int


class Studio:
    """Draws images of a class.

    Attributes:
        models: Models of the split, those of the fold alone where one is chosen; none where the class has no
            designs, and shapes are those of its model.
    """

    def __init__(
        self,
        object_class: ObjectClass,
        settings: StudioSettings = StudioSettings(),
        split: Split = "train",
        fold: tuple[int, int] | None = None,
        refused: bool = True,
        things: Split | None = None,
    ):
        """Make a studio of the class's designs and meshes of a split; fold k of n has those with numbers k
        modulo n; without `refused` only those from which the class was built. Grounds and other things are
        of that split, too, or of another.
        """
        self.object_class, self.settings, self.split = object_class, settings, things or split
        model = object_class.shape_model
        self.size = float(np.ptp(model.mean, axis=0).max())
        self.height = float(model.mean[:, 2].max())
        self._body_parts, self._detachable_parts = separate_parts(model)
        self.models = dict(enumerate(_models(object_class, split)))
        if fold is not None:
            self.models = {n: model for n, model in self.models.items() if n % fold[1] == fold[0]}
        if not refused:
            self.models = {n: model for n, model in self.models.items() if model.of_class}
        self._props = model_cutouts(settings.props, self.split, object_class.name) if settings.props else None
        self._light_factor = np.linalg.cholesky(
            object_class.light_prior_covariance + 1e-9 * np.eye(len(object_class.light_prior_mean))
        )

    def draw(self, seed: int, index: int, first: int = 0) -> StudioImage:
        """Draw an image; one that fails is drawn anew from its next stream, `MAX_ATTEMPTS` times at most.

        first: Number of the first stream.
        """
        for number in range(first, first + MAX_ATTEMPTS):
            key = (number,) if number else ()
            try:
                return self._draw_once(
                    np.random.default_rng(np.random.SeedSequence([seed, index, 71], spawn_key=key))
                )
            except Exception as error:  # no image ends a training
                failure = error
            print(f"studio image {index} is drawn anew: {failure!r}", file=sys.stderr, flush=True)
        raise failure

    def _draw_once(self, rng: np.random.Generator) -> StudioImage:
        settings = self.settings
        number, model = self._model(rng)
        mesh = model.mesh if model is not None and rng.random() < settings.source else None
        latents, vertices = self._shape(rng, model)
        angles = float(latents.azimuth[0]), float(latents.elevation[0])
        lens = self._lens(rng, vertices, *angles)
        view = View.through(lens, self.object_class, *angles, SUPERSAMPLING * IMAGE_SIZE)
        parts = len(self.object_class.shape_model.part_names)
        kinds = WHOLE if self._detachable_parts else PART
        coat = draw_coat(rng, parts, settings.decorated, settings.metal)
        ground = draw_ground(rng, self.split, lens.roll)
        environment = Environment.draw(rng)
        absent = rng.random() < settings.absent
        shown = int(rng.integers(kinds)) if absent else WHOLE
        tint = 1 + rng.normal(0, 0.04, 3)
        albedo = np.mean(coat.colours, axis=0)
        surface = vertices, self.object_class.shape_model.faces
        if shown >= PART:
            faces = self._part(rng) if shown == PART else self.object_class.shape_model.faces
            if shown == WHOLE and mesh is not None:
                drawn = self._source_object(rng, latents, mesh, vertices, view, environment)
                layer, albedo, surface = drawn
            else:
                layer, albedo = self._object(rng, latents, vertices, faces, view, coat, environment, ground)
            layer = replace(layer, colour=layer.colour * tint)
        elif shown in (OTHER_VESSEL, OTHER_THING):
            vessel, name = shown == OTHER_VESSEL, self.object_class.name
            layer = draw_instead(rng, self.split, name, vessel, self._props)
        else:
            layer = Layer(ground, np.zeros(ground.shape[:2], np.float32))
        place = place_of(layer.cover)
        picture = cast_shadow(rng, ground, layer.cover, place)
        colours = [*map(np.array, coat.colours[:2]), any_colour(rng)]
        for _ in range(int(rng.choice([0, 1, 2, 3], p=[0.4, 0.3, 0.2, 0.1]))):
            picture = draw_thing(rng, self.split, colours, place, False, self._props).over(picture)
        picture = layer.over(picture)
        visible = layer.cover.copy()
        if rng.random() < settings.occluded:
            things = (self.split, colours, place, self._props)
            picture, visible = occlude(rng, picture, layer.cover, settings.most_hidden, *things)
        hidden = layer.cover - visible
        if absent:
            visible, hidden = np.zeros_like(visible), np.zeros_like(hidden)
        image = photograph(rng, picture)
        if rng.random() < settings.continued:
            image = continue_border(rng, image, layer.cover > 0)
        vector = replace(latents, albedo=albedo[None].astype(np.float32)).to_vector()
        return StudioImage(
            image,
            vector[0],
            lens,
            *surface,
            coat if mesh is None else None,
            np.round(255 * visible).astype(np.uint8),
            np.round(255 * hidden).astype(np.uint8),
            number,
        )

    def _model(self, rng: np.random.Generator) -> tuple[int, StudioModel | None]:
        """Return the model of the object, with its number; 0 and None where the class has none."""
        if not self.models:
            return 0, None
        number = list(self.models)[int(rng.integers(len(self.models)))]
        return number, self.models[number]

    def _shape(self, rng: np.random.Generator, model: StudioModel | None) -> tuple[Latents, np.ndarray]:
        """Return latents but for the albedo, and vertices, a little off the shape model, or the given one."""
        settings = self.settings
        shape_model = self.object_class.shape_model
        draws = rng.standard_normal(shape_model.modes)
        if model is None:
            shape = np.clip(draws, -SHAPE_LIMIT, SHAPE_LIMIT)
            vertices = shape_vertices(shape, NO_DESIGN, self.object_class)
        else:
            shape = np.clip(model.nearest + DESIGN_SPREAD * draws, -SHAPE_LIMIT, SHAPE_LIMIT)
            both = np.stack([shape, model.nearest]).astype(np.float32)
            moved, at_rest = shape_model.vertices(both)
            vertices = model.template + moved - at_rest
            vertices[:, 2] -= vertices[:, 2].min()
        kind = rng.random()
        if kind < settings.level:
            elevation = math.radians(rng.uniform(-4, 15))
        else:
            low = kind < settings.level + 0.6 * (1 - settings.level)
            elevation = math.radians(rng.uniform(15, 42) if low else rng.uniform(42, 89))
        light = self._light_factor @ rng.standard_normal(9) * rng.uniform(0.3, 1.3)
        light = light + rng.uniform(0.3, 1.0) * self.object_class.light_prior_mean
        light[0] = EXPOSURE_L00  # a set exposure, like that of datasets
        numbers = (shape, [rng.uniform(0, 2 * math.pi)], [elevation], np.full(3, 0.5), light)
        rows = [np.asarray(values, np.float32)[None] for values in numbers]
        latents = Latents(rows[0], rows[1][0], rows[2][0], rows[3], rows[4])
        # Long waves move shapes off the model, as real objects are; they keep the mirror plane y = 0.
        warp = settings.warp * rng.random()
        for _ in range(2):
            wave = rng.normal(size=3) * [1, 0, 1] * 2 * math.pi / self.size
            move = rng.normal(0, warp * self.size, 3) * [1, 0, 1]
            vertices = vertices + np.sin(vertices @ wave + rng.uniform(0, 6.28))[:, None] * move
        vertices = vertices * np.exp(rng.normal(0, 0.06, 3))
        vertices[:, 2] -= vertices[:, 2].min()
        return latents, vertices.astype(np.float32)

    def _lens(self, rng: np.random.Generator, vertices: np.ndarray, azimuth: float, elevation: float) -> Lens:
        """Return a lens whose image frames the object as boxes do, or as the paper's camera does, about."""
        settings = self.settings
        farther = math.exp(rng.uniform(math.log(0.9), math.log(12))) if rng.random() < 0.7 else 1.0
        widely_rolled = rng.random() < settings.rolled
        roll = rng.uniform(-1, 1) * settings.most_roll if widely_rolled else rng.normal(0, settings.roll)
        lens = Lens(farther, float(roll))
        if rng.random() < settings.boxed:
            lens = framing_lens(lens, self.object_class, vertices, azimuth, elevation)
        scale, shift = math.exp(rng.normal(0, 0.11)), rng.normal(0, 0.05, 2)
        if rng.random() < settings.small:
            scale, shift = rng.uniform(0.35, 0.9), rng.uniform(-0.25, 0.25, 2)
        return reframe(lens, scale, shift)

    def _part(self, rng: np.random.Generator) -> np.ndarray:
        """Return faces of something like the object that is none: its body with one other part."""
        model = self.object_class.shape_model
        kept_parts = [*self._body_parts, self._detachable_parts[rng.integers(len(self._detachable_parts))]]
        return model.faces[np.isin(model.parts[model.faces[:, 0]], kept_parts)]

    def _source_object(
        self,
        rng: np.random.Generator,
        latents: Latents,
        mesh: SourceMesh,
        vertices: np.ndarray,
        view: View,
        environment: Environment,
    ) -> tuple[Layer, np.ndarray, tuple[np.ndarray, np.ndarray]]:
        """Return one of the user's meshes, lit; the mean albedo (3,) of its visible part; and its vertices
        (V, 3) and the faces (F, 3) that are drawn, those of clear glass left out.
        """
        paint = draw_paint(rng, mesh, self.settings.own_colours)
        light, vertices = np.asarray(latents.light[0]), mesh.follow_template(vertices)
        look = appearance(mesh, vertices, paint, light, view, environment.radiance_from)
        mean = look.albedo.mean(0) if len(look.albedo) else np.full(3, 0.5)
        return Layer(*look.average(SUPERSAMPLING)), mean, (vertices, mesh.faces[paint.drawn[mesh.material]])

    def _object(
        self,
        rng: np.random.Generator,
        latents: Latents,
        vertices: np.ndarray,
        faces: np.ndarray,
        view: View,
        coat: Coat,
        environment: Environment,
        ground: np.ndarray,
    ) -> tuple[Layer, np.ndarray]:
        """Return the object lit, and the mean albedo (3,) of its visible part."""
        model = self.object_class.shape_model
        normals = vertex_normals(vertices, model.faces)
        light = vertex_irradiance(latents, normals, self.object_class)
        reflectance = float(rng.uniform(0.5, 1.1))
        appearance = appearance_of(
            coat, model, vertices, faces, normals, light, view, environment.radiance_from, reflectance
        )
        if rng.random() < self.settings.glass:
            row, column = np.nonzero(appearance.on)
            refracted = np.stack([row, column], 1) / SUPERSAMPLING + appearance.normal[
                :, 2:0:-1
            ] * rng.uniform(3, 12)
            refracted = np.clip(refracted.astype(int), 0, IMAGE_SIZE - 1)
            transmitted = ground[refracted[:, 0], refracted[:, 1]] * (0.3 + 0.7 * np.sqrt(appearance.albedo))
            appearance = replace(appearance, colour=0.85 * transmitted + 0.15 * appearance.colour)
        mean = appearance.albedo.mean(0) if len(appearance.albedo) else np.mean(coat.colours, axis=0)
        return Layer(*appearance.average(SUPERSAMPLING)), mean


@lru_cache(maxsize=8)
def _models(object_class: ObjectClass, split: Split) -> tuple[StudioModel, ...]:
    """Return the designs of a split, each with its mesh where that has materials, then refused meshes."""
    designs, meshes = held_out_designs_of(object_class), source_meshes_of(object_class)
    of_design, shape_model = {mesh.design: mesh for mesh in meshes}, object_class.shape_model

    def model(shape: np.ndarray, mesh: SourceMesh | None, of_class: bool, design: int) -> StudioModel:
        nearest = nearest_coefficients(shape_model, shape[None])[0]
        return StudioModel(shape, nearest, mesh, of_class, design)

    numbers = [] if designs is None else [n for n, of in enumerate(designs.splits) if of == split]
    models = (
        [] if designs is None else [model(designs.vertices[n], of_design.get(n), True, n) for n in numbers]
    )
    others = [mesh for mesh in meshes if mesh.design < 0 and mesh.split == split]
    return (*models, *(model(mesh.registered, mesh, designs is None, NO_DESIGN) for mesh in others))


def separate_parts(model: ShapeModel) -> tuple[list[int], list[int]]:
    """Return the first part with all that share triangles with it; and the others, which are separable."""
    faces = model.parts[model.faces]
    body = {0}
    while True:
        connected = {int(part) for part in faces[np.isin(faces, list(body)).any(1)].ravel()}
        if connected <= body:
            return sorted(body), sorted(set(range(len(model.part_names))) - body)
        body |= connected

"""The object class that registered meshes make: shapes in metres, their components, parts and families."""

from dataclasses import dataclass

import numpy as np

from vig.io.progress import Meter
from vig.scene import Family, ObjectClass, ShapeModel, Symmetry
from vig_train.building.model import Components, SymmetryProjection, families_of, fit_components
from vig_train.building.pose import ClassSymmetry
from vig_train.building.settings import BuildSettings
from vig_train.building.stages import BuildRun, RegisteredMeshes, Template
from vig_train.building.surface import vertex_areas
from vig_train.building.symmetries import MIRROR_Y, mirror_map, mirror_projection, rotation_projection
from vig_world.dataset.spec import Split


@dataclass(frozen=True, eq=False)
class ClassShapes:
    """Shapes of the accepted meshes, in correspondence, as symmetric as the class is, and how they vary.

    Attributes:
        registered: The meshes that they come from.
        symmetries: Symmetries of the class.
        numbers: (A,) indices of the accepted meshes; all that follows is in their order.
        splits: (A,) split of each.
        trained: Those, from 0, that the components come from; the others are held out.
        vertices: (A, V, 3) in metres, standing on z = 0.
        scale: Metres of a unit of the class's frame.
        components: Shape model of the shapes for training.
    """

    registered: RegisteredMeshes
    symmetries: ClassSymmetry
    numbers: list[int]
    splits: list[Split]
    trained: list[int]
    vertices: np.ndarray
    scale: float
    components: Components

    @staticmethod
    def of(registered: RegisteredMeshes, symmetries: ClassSymmetry, length: float) -> "ClassShapes":
        """Make shapes whose mean has a longest side of `length` metres."""
        numbers, template = registered.accepted, registered.template
        shapes, symmetrise = _symmetrise(registered.vertices[numbers], template, symmetries)
        shapes[:, :, 2] -= shapes[:, :, 2].min(1)[:, None]
        scale = length / np.ptp(shapes.mean(0), axis=0).max()
        shapes = shapes * scale
        splits = splits_of(len(numbers))
        trained = [index for index, split in enumerate(splits) if split == "train"]
        areas = vertex_areas(template.vertices, template.faces)
        components = fit_components(shapes[trained], areas / areas.sum(), symmetrise)
        return ClassShapes(registered, symmetries, numbers, splits, trained, shapes, scale, components)

    def object_from_mesh(self, number: int) -> np.ndarray:
        """Return the similarity (4, 4) from the coordinates of a mesh's file to the class's frame, metres."""
        mesh = self.registered.meshes[number]
        similarity = np.eye(4)
        similarity[:3, :3] = self.scale * mesh.linear
        similarity[:3, 3] = self.scale * (mesh.offset - self._ground(number))
        return similarity

    def template_on(self, number: int) -> np.ndarray:
        """Return vertices (V, 3) of the template as it lies on any mesh, in metres, standing on z = 0."""
        return self.scale * (self.registered.vertices[number] - self._ground(number))

    def _ground(self, number: int) -> np.ndarray:
        return np.array([0, 0, self.registered.vertices[number][:, 2].min()])


def _symmetrise(
    shapes: np.ndarray, template: Template, symmetries: ClassSymmetry
) -> tuple[np.ndarray, SymmetryProjection | None]:
    """Return shapes (A, V, 3) as symmetric as their class, and how deformations are; one alone is exact."""
    if len(shapes) == 1:
        return shapes, None
    if symmetries.symmetry == "any-turn":
        made_round = rotation_projection(template.vertices, template.faces)
        return made_round(shapes), made_round
    if not symmetries.mirror:
        return shapes, None
    mirrored = mirror_map(template.vertices, template.faces)
    shapes = np.stack([(shape + (mirrored @ shape) * MIRROR_Y) / 2 for shape in shapes])
    return shapes, mirror_projection(template.vertices)


def splits_of(count: int) -> list[Split]:
    """Return the split of each of so many accepted meshes: with ten or more, a third are held out."""
    order: tuple[Split, ...] = ("train", "train", "validation", "train", "train", "test")
    # From ten meshes on, one in six is held out for validation and one in six for the test.
    return [order[index % 6] if count >= 10 else "train" for index in range(count)]


def object_class_of(
    settings: BuildSettings,
    shapes: ClassShapes,
    dark: tuple[np.ndarray, float] | None,
    run: BuildRun,
) -> ObjectClass:
    """Return the class of these shapes.

    dark: Vertices (V,) bool of its dark part, and their relative reflectance; see `dark_part`.
    """
    model = _shape_model(shapes, dark)
    packaged = ObjectClass.load("teapot")  # no panorama has to be made
    mean, covariance = packaged.light_prior_mean, packaged.light_prior_covariance
    size = np.ptp(shapes.components.mean, axis=0)
    x, _, z = shapes.components.mean.T  # a user may click the farthest vertices
    # A dark part is evidence for the front by itself: on 205 photos of real cars views are as good
    # with a `view_weight` of 1,000 as with 3,000, and those that are turned have a lower confidence.
    # The standard camera is 1.5 longest sides of the mean shape away.
    return ObjectClass(
        settings.name,
        model,
        target_height=float(np.round(size[2] / 2, 4)),
        light_prior_mean=mean,
        light_prior_covariance=covariance,
        families=_families(model, shapes, run),
        symmetry=Symmetry(shapes.symmetries.symmetry),
        mirror=shapes.symmetries.mirror,
        front=settings.shows,
        points={"front": int(x.argmax()), "back": int(x.argmin()), "top": int(z.argmax())},
        viewing_distance=float(np.round(1.5 * size.max(), 4)),
        places=settings.places,
        fit_settings={} if dark is None else {"view_weight": 1000.0},
        part_reflectance=None if dark is None else (1.0, round(dark[1], 4)),
        object_from_mesh=shapes.object_from_mesh(shapes.numbers[0]) if len(shapes.numbers) == 1 else None,
    )


def _shape_model(shapes: ClassShapes, dark: tuple[np.ndarray, float] | None) -> ShapeModel:
    components = shapes.components
    return ShapeModel(
        components.mean.astype(np.float32),
        components.basis.astype(np.float32),
        shapes.registered.template.faces.astype(np.int32),
        np.zeros(len(components.mean), np.int32) if dark is None else dark[0].astype(np.int32),
        ("body",) if dark is None else ("body", "dark"),
        components.ratio.astype(np.float32),
    )


def _families(model: ShapeModel, shapes: ClassShapes, run: BuildRun) -> tuple[Family, ...]:
    """Return families by the number of holes; none of surfaces of revolution, whose handles are not of the
    shape, and none of a single shape.
    """
    if shapes.symmetries.symmetry == "any-turn" or len(shapes.trained) == 1:
        return ()
    kinds = []
    with Meter(len(shapes.trained), 0, run.progress, "meshes") as meter:
        for index in shapes.trained:
            holes = shapes.registered.meshes[shapes.numbers[index]].hole_count(run)
            kinds.append("no hole" if holes == 0 else f"{holes} hole{'s' if holes > 1 else ''}")
            meter.advance(1)
    return families_of(model, shapes.vertices[shapes.trained].astype(np.float32), kinds)

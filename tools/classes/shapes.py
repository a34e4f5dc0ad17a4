"""Packaged classes whose shapes are designed by code: their shape models and packs."""

import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from vig.io.files import write_json
from vig.scene import EXPOSURE_L00, ObjectClass, ShapeModel
from vig.scene.object_class import PACKAGED
from vig_train.packs.transfer import write_transfer
from vig_world.assets.coded_designs import CATALOGUE, PARAMETERS_FILE, Design, Kind, Parameters
from vig_world.assets.designs.design import TeapotDesign
from vig_world.assets.held_out import DESIGNS_FILE, name_designs
from vig_world.assets.target import nearest_coefficients
from vig_world.library import Library


@dataclass(frozen=True)
class CodedClass:
    """A class whose shapes are designed by code.

    Attributes:
        name: Name of the class.
        vertices: Returns the vertices (V, 3) of a design.
        faces: (F, 3) of every design.
        parts: (V,) number of each vertex's part.
        part_names: Names of the parts.
        designs: Designs from which the shape model is learned.
        modes: Components of the shape model.
        scenes: Designs of scenes by split. Never reorder them: datasets hold their numbers.
        fields: Returns further fields of the class, given its shape model.
    """

    name: str
    vertices: Callable[[Any], np.ndarray]
    faces: np.ndarray
    parts: np.ndarray
    part_names: tuple[str, ...]
    designs: Sequence[Design]
    modes: int
    scenes: Mapping[str, Sequence[Design]]
    fields: Callable[[ShapeModel], dict[str, Any]]

    def vertices_of(self, designs: Sequence[Design]) -> np.ndarray:
        """Return the vertices of designs, (N, V, 3) float32."""
        return np.stack([self.vertices(design) for design in designs])

    def build(self) -> ObjectClass:
        """Fit shape model and light prior; a pure function of the code."""
        designs = self.vertices_of(self.designs)
        model = fit_shape_model(designs, self.faces, self.parts, self.part_names, self.modes)
        mean, covariance = light_prior()
        return ObjectClass(
            self.name, model, light_prior_mean=mean, light_prior_covariance=covariance, **self.fields(model)
        )


def main(coded: CodedClass, folder: Path | None = None) -> None:
    """Build, save and describe a class.

    folder: Where to, unless the command line names one; by default that of the packaged class.
    """
    folder = Path(sys.argv[1]) if len(sys.argv) > 1 else folder or PACKAGED / coded.name
    built = coded.build()
    built.save(folder)
    save_coded(coded.scenes, folder)
    write_transfer(built, folder)
    vertices = {split: coded.vertices_of(designs) for split, designs in coded.scenes.items()}
    print(*describe_model(built.shape_model, vertices), folder, sep="\n")


def save_coded(designs: Mapping[str, Sequence[Design]], folder: Path) -> None:
    """Add designs by split to a class pack that `ObjectClass.save` has written, by their parameters."""
    save_parameters([design for of_split in designs.values() for design in of_split], folder)
    (folder / DESIGNS_FILE).unlink(missing_ok=True)
    name_designs(folder, [(design.name, split) for split, of_split in designs.items() for design in of_split])


def save_parameters(designs: Sequence[Design], folder: Path) -> None:
    """Write the parameters of designs of one kind into a class pack."""
    kind: Kind = "teapot" if isinstance(designs[0], TeapotDesign) else "mug"
    drawn = {design.name: asdict(design) for design in designs if design.name not in CATALOGUE[kind]}
    for parameters in drawn.values():
        del parameters["name"]
    write_json(folder / PARAMETERS_FILE, asdict(Parameters(kind, drawn)), 1)


def fit_shape_model(
    designs: np.ndarray, faces: np.ndarray, parts: np.ndarray, part_names: tuple[str, ...], modes: int = 10
) -> ShapeModel:
    """Return PCA of designs (N, V, 3) in correspondence; at most N - 1 modes.

    The sign of a component is such that its largest displacement is positive, so that the model does
    not depend on the linear-algebra library.
    """
    count = len(designs)
    if not 1 <= modes < count:
        raise ValueError(f"modes must be from 1 to {count - 1} for {count} designs; got {modes}")
    flat = designs.reshape(count, -1).astype(np.float64)
    mean = flat.mean(0)
    _, singular, components = np.linalg.svd(flat - mean, full_matrices=False)
    variance = singular**2 / (count - 1)
    largest = np.abs(components).argmax(axis=1)
    components *= np.sign(components[np.arange(len(components)), largest])[:, None]
    basis = components[:modes] * np.sqrt(variance[:modes, None])
    return ShapeModel(
        mean.reshape(-1, 3).astype(np.float32),
        basis.reshape(modes, -1, 3).astype(np.float32),
        faces.astype(np.int32),
        parts.astype(np.int32),
        tuple(part_names),
        (variance[:modes] / variance.sum()).astype(np.float32),
    )


def beyond_model_mm(model: ShapeModel, vertices: np.ndarray) -> np.ndarray:
    """Return how far shapes (N, V, 3) are from the model's nearest (N,): mean of the vertices, mm."""
    nearest = model.vertices(nearest_coefficients(model, vertices))
    return 1000 * np.linalg.norm(vertices - nearest, axis=-1).mean(axis=1)


def describe_model(model: ShapeModel, kinds: Mapping[str, np.ndarray]) -> Iterator[str]:
    """Yield lines on a shape model: its size, its components, and how near it comes to designs.

    Args:
        model: The shape model.
        kinds: Vertices (N, V, 3) of designs that are compared with it, by name.
    """
    ratio = model.explained_variance_ratio
    yield f"{len(model.mean)} vertices, {len(model.faces)} faces, mean size {np.ptp(model.mean, axis=0)} m"
    yield f"{model.modes} components hold {ratio.sum():.4f} of the variance: {np.round(ratio, 3)}"
    yield "mean distance of vertices from the nearest shape, % of the design's longest side, by components"
    for components in range(2, model.modes + 1, 2):
        errors = (f"{kind} {relative_distance(model, v, components):.2%}" for kind, v in kinds.items())
        yield f"{components:2d}: {', '.join(errors)}"
    for name, vertices in kinds.items():
        away = beyond_model_mm(model, vertices)
        far = f"{away.min():.1f} to {away.max():.1f}, mean {away.mean():.1f} mm"
        yield f"{name} designs from the model: {far}"


def relative_distance(model: ShapeModel, vertices: np.ndarray, components: int) -> float:
    """Return the mean of the same, over each shape's longest side, by a model's first components."""
    ratio = model.explained_variance_ratio[:components]
    fewer = replace(model, basis=model.basis[:components], explained_variance_ratio=ratio)
    return float((beyond_model_mm(fewer, vertices) / (1000 * np.ptp(vertices, axis=1).max(1))).mean())


def light_prior() -> tuple[np.ndarray, np.ndarray]:
    """Return the prior of light on things indoors, from the training panoramas: the same for all classes.

    Mean (9,) and covariance (9, 9) of spherical harmonics in the world frame, at the paper's exposure.
    """
    angles = 2 * np.pi * np.arange(12) / 12  # of each panorama about the vertical
    library = Library("train")
    lights = np.array(
        [
            library.light(number, angle, albedo)
            for number in range(library.panoramas)
            for angle in angles
            for albedo in (0.1, 0.25, 0.5)  # of the object's support
        ]
    )
    covariance = np.cov(lights.T)
    # L00 is uncertain by 5 %, so that an exposure slightly off can be explained.
    covariance[0, 0] += (0.05 * EXPOSURE_L00) ** 2
    return lights.mean(0), covariance

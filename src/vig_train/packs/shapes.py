"""Packaged classes whose shapes are designed by code: their shape models and packs."""

from __future__ import annotations

import sys
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from vig.scene import ObjectClass, ShapeModel
from vig.scene.object_class import PACKAGED
from vig_train.packs.transfer import write_transfer
from vig_world.assets.designs import TeapotDesign
from vig_world.assets.held_out import save_coded
from vig_world.assets.mugs import MugDesign
from vig_world.assets.target import nearest_coefficients


def fit_shape_model(
    designs: np.ndarray,
    faces: np.ndarray,
    parts: np.ndarray,
    part_names: tuple[str, ...],
    modes: int = 10,
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


def save_packaged(built: ObjectClass, scenes: Mapping[str, Sequence[MugDesign | TeapotDesign]]) -> Path:
    """Save a class in the folder that the command line names, or as the packaged one.

    Args:
        built: The class.
        scenes: Designs of scenes, by split.
    """
    folder = Path(sys.argv[1]) if len(sys.argv) > 1 else PACKAGED / built.name
    built.save(folder)
    save_coded(scenes, folder)
    write_transfer(built, folder)
    return folder


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
    yield from distance_lines(model, kinds)


def distance_lines(model: ShapeModel, designs: Mapping[str, np.ndarray]) -> Iterator[str]:
    """Yield how far shapes (N, V, 3) of each name are from the model, a line each."""
    for name, vertices in designs.items():
        away = beyond_model_mm(model, vertices)
        far = f"{away.min():.1f} to {away.max():.1f}, mean {away.mean():.1f} mm"
        yield f"{name} designs from the model: {far}"


def relative_distance(model: ShapeModel, vertices: np.ndarray, components: int) -> float:
    """Return the mean of the same, over each shape's longest side, by a model's first components."""
    ratio = model.explained_variance_ratio[:components]
    fewer = replace(model, basis=model.basis[:components], explained_variance_ratio=ratio)
    return float((beyond_model_mm(fewer, vertices) / (1000 * np.ptp(vertices, axis=1).max(1))).mean())

"""Packs of one class fitted from equal starts: what their shape models are worth, whatever their networks.

    python -m benchmarks.packs DATASET PACK PACK... [--count 200] [--seed 0]
    python -m benchmarks.packs --meshes FOLDER

The first PACK's network looks at each photo of a test dataset of that class. Every pack then starts from the
view, light, colours and mask that it saw, and from its own mean shape: only the shape models differ. Rows are
of all photos and of those of each of the first PACK's families. `--meshes` writes what a pack to compare can
be built from: the teapot's training designs with their correspondence thrown away.
"""

from __future__ import annotations

import argparse
from dataclasses import replace
from pathlib import Path

import numpy as np
import torch
import trimesh
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

from vig.inference import ExplainSettings
from vig.inference.families import family_of
from vig.recognition import Prediction, Recognizer
from vig.scene import Latents, ObjectClass, linear_from_srgb, regressed_layout
from vig_train.building.template import split_long_edges
from vig_train.evaluation.fits import fit_all
from vig_train.evaluation.framing import fit_settings, frame_images
from vig_train.evaluation.metrics import angle_error_deg, segmentation_iou
from vig_world.assets.designs import TEAPOT_FACES, TRAINING_DESIGNS, teapot_vertices
from vig_world.assets.target import shape_vertices
from vig_world.dataset import read_dataset


def write_meshes(folder: Path) -> None:
    """The training designs, edges cut at random lengths, vertices shuffled, turned, in units of any kind."""
    folder.mkdir(parents=True, exist_ok=True)
    for number, design in enumerate(TRAINING_DESIGNS):
        rng = np.random.default_rng(number)
        vertices, faces = split_long_edges(
            teapot_vertices(design).astype(float), TEAPOT_FACES, rng.uniform(0.008, 0.03)
        )
        order = rng.permutation(len(vertices))
        faces = rng.permutation(np.argsort(order)[faces])
        if number % 5:
            turn = Rotation.from_euler("z", 90 * rng.integers(4), degrees=True)
        else:
            turn = Rotation.random(random_state=number)
        points = turn.apply(vertices[order]) * rng.choice([1, 100, 39.37])
        trimesh.Trimesh(points, faces, process=False).export(folder / f"{number:03d}.ply")


def without_shape(prediction: Prediction, modes: int) -> Prediction:
    """A prediction whose shape is the mean of a class of `modes` components, with its prior's deviation."""
    old, new = prediction.layout, regressed_layout(modes)
    numbers = torch.zeros(len(prediction), new.size)
    deviation = torch.ones_like(numbers)
    for block in new.blocks:
        if block.name != "shape":
            numbers[:, new[block.name]] = prediction.numbers[:, old[block.name]]
            deviation[:, new[block.name]] = prediction.deviation[:, old[block.name]]
    return replace(prediction, numbers=numbers, deviation=deviation)


def surface_error(vertices: np.ndarray, truth: np.ndarray) -> float:
    """Mean distance both ways in % of the size, of vertices (V, 3) put into the truth's box."""
    low, size = truth.min(0), np.ptp(truth, axis=0).max()
    placed = (vertices - vertices.min(0)) * (size / np.ptp(vertices, axis=0).max()) + low
    placed += (truth.max(0) - placed.max(0)) / 2
    both = cKDTree(placed).query(truth)[0].mean() + cKDTree(truth).query(placed)[0].mean()
    return float(50 * both / size)


def main() -> None:
    """Print a row for each pack."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("dataset", type=Path, nargs="?")
    parser.add_argument("packs", nargs="*")
    parser.add_argument(
        "--meshes", type=Path, help="folder to write the designs' meshes to, and nothing else"
    )
    parser.add_argument("--count", type=int, default=200, help="photos, drawn at random")
    parser.add_argument("--seed", type=int, default=0, help="of the draw")
    told = parser.parse_args()
    if told.meshes:
        return write_meshes(told.meshes)
    if not told.packs:
        parser.error("expected a dataset and at least one pack")
    classes = [ObjectClass.load(pack) for pack in told.packs]
    recognizer, dataset = Recognizer.of_class(classes[0]), read_dataset(told.dataset, "test")
    images, visible = frame_images(dataset, recognizer)
    chosen = np.sort(np.random.default_rng(told.seed).permutation(len(images))[: told.count])
    photos = torch.from_numpy(linear_from_srgb(images[chosen].astype(np.float32) / 255)).float()
    prediction = recognizer(photos)
    truth = Latents.from_vector(torch.from_numpy(dataset.latents[chosen]))
    designs = dataset.design[chosen].tolist()
    shapes = [
        shape_vertices(shape, design, classes[0])
        for shape, design in zip(truth.shape.numpy(), designs, strict=True)
    ]
    kinds = [family_of(shape, classes[0]) or "" for shape in truth.shape]
    parts = {"all": np.ones(len(kinds), bool)}
    parts |= {kind: np.array([each == kind for each in kinds]) for kind in sorted({*kinds} - {""})}
    print("pack: azimuth median, within 15 and 30 degrees; elevation; visible IoU, mean; surface, median")
    for pack, one in zip(told.packs, classes, strict=True):
        settings = fit_settings(ExplainSettings(calibrated=False), dataset)
        start = without_shape(prediction, one.shape_model.modes)
        fits = fit_all(images[chosen], photos, start, one, settings, torch.get_num_threads())
        latents = Latents.from_vector(torch.from_numpy(fits.latents))
        azimuth = angle_error_deg(latents.azimuth, truth.azimuth)
        elevation = angle_error_deg(latents.elevation, truth.elevation)
        seen = segmentation_iou(fits.masks, visible[chosen])
        found = one.shape_model.vertices(latents.shape).numpy()
        surface = np.array([surface_error(*pair) for pair in zip(found, shapes, strict=True)])
        for name, part in parts.items():
            off = azimuth[part]
            print(
                f"{pack}, {name} ({part.sum()}): {np.median(off):.1f}, {(off <= 15).mean():.1%},"
                f" {(off <= 30).mean():.1%}; {np.median(elevation[part]):.1f}; {seen[part].mean():.3f};"
                f" {np.median(surface[part]):.2f} %",
                flush=True,
            )


if __name__ == "__main__":
    main()

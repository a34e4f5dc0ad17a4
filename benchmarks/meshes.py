"""Explanations of meshes that no model was made from, in scenes of the generator.

    python -m benchmarks.meshes MESH... --out D [--count 60] [--seed S] [--tier cycles]
        [--envmaps DIR] [--props DIR] [--json FILE]

A MESH is FILE, or FILE,up=y,turn=90,parts=NAME+NAME: the axis that points up (default y), by how many
degrees it is turned counter-clockwise about that axis so that its front shows along +X, and the scene's nodes
that are meant (all by default). Each becomes a class of one shape, as long as the packaged teapot's mean.
Scenes in which more than 75 % of it is hidden do not count.
"""

from __future__ import annotations

import argparse
import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import torch
import trimesh

from benchmarks.measuring import metric, report, write
from vig.inference import ExplainSettings, Verdict, explain
from vig.recognition import Recognizer
from vig.scene import ObjectClass, ShapeModel, layout_of_width, linear_from_srgb
from vig_train.evaluation.framing import fit_settings, frame_images
from vig_train.evaluation.metrics import angle_error_deg
from vig_train.evaluation.statistics import NEAR_DEG
from vig_world.dataset import read_dataset
from vig_world.generation.write import make_dataset
from vig_world.library import OwnAssets, OwnFolders

MOST_HIDDEN = 0.75
UP = {
    "x": [[0, 1, 0], [0, 0, 1], [1, 0, 0]],
    "y": [[1, 0, 0], [0, 0, -1], [0, 1, 0]],
    "z": np.eye(3).tolist(),
}
"""Rotations that turn an axis to +Z."""


def class_of(named: str, teapot: ObjectClass) -> ObjectClass:
    """A class of one shape, from a MESH as the command line takes it."""
    path, *rest = named.split(",")
    given = dict(each.split("=", 1) for each in rest)
    scene = trimesh.load_scene(path)
    nodes = given["parts"].split("+") if "parts" in given else list(scene.graph.nodes_geometry)
    meshes = []
    for node in nodes:
        pose, geometry = scene.graph[node]
        meshes.append(scene.geometry[geometry].copy().apply_transform(pose))
    mesh = trimesh.util.concatenate(meshes)
    mesh = trimesh.Trimesh(mesh.vertices, mesh.faces)  # welded, whatever its texture's seams
    turn = math.radians(float(given.get("turn", 0)))
    about = np.array([[math.cos(turn), -math.sin(turn), 0], [math.sin(turn), math.cos(turn), 0], [0, 0, 1]])
    points = mesh.vertices @ (about @ np.array(UP[given.get("up", "y")], float)).T
    own = teapot.shape_model.mean
    points = points * np.ptp(own, axis=0).max() / np.ptp(points, axis=0).max()
    points[:, 2] -= points[:, 2].min()
    foot = points[points[:, 2] < 0.1 * points[:, 2].max(), :2]
    points[:, :2] -= (foot.min(0) + foot.max(0)) / 2
    count = len(points)
    model = ShapeModel(
        points.astype(np.float32),
        np.zeros((1, count, 3), np.float32),
        mesh.faces.astype(np.int32),
        np.zeros(count, np.int32),
        ("body",),
        np.ones(1, np.float32),
    )
    return replace(teapot, name=Path(path).stem, shape_model=model, folder=None, transfer=None, families=())


def main() -> None:
    """Make the scenes, explain them, print a line for each mesh and all, and write JSON where asked."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("meshes", nargs="+")
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--count", type=int, default=60)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--tier", default="raster")
    parser.add_argument("--envmaps")
    parser.add_argument("--props")
    parser.add_argument("--json", type=Path)
    given = parser.parse_args()
    teapot = ObjectClass.load("teapot")
    recognizer = Recognizer.of_class(teapot)
    own, _ = OwnAssets.read(OwnFolders(given.envmaps, given.props, None))
    found, seen = [], []
    print("mesh: images, azimuth: median, within 15 and 30 degrees; visible IoU; trusted, of these within 15")
    for number, named in enumerate(given.meshes):
        one, folder = class_of(named, teapot), given.out / f"{number}"
        share = given.count // len(given.meshes) + (number < given.count % len(given.meshes))
        make_dataset(
            folder, share, given.seed + number, given.tier, "test", object_class=one, own=own, photo=True
        )
        dataset = read_dataset(folder, "test")
        images, visible = frame_images(dataset, recognizer)
        at = layout_of_width(dataset.latents.shape[1]).at("azimuth")
        photos = torch.from_numpy(linear_from_srgb(images.astype(np.float32) / 255)).float()
        rows = []
        for index, fit in enumerate(
            explain(photos, teapot, recognizer, fit_settings(ExplainSettings(), dataset))
        ):
            truth = torch.tensor([dataset.latents[index, at]])
            mask = fit.mask.numpy()
            union = (mask | visible[index]).sum()
            off = float(angle_error_deg(fit.latents.azimuth, truth)[0])
            if dataset.occlusion[index] <= MOST_HIDDEN:
                trusted = fit.verdict is Verdict.TRUSTED
                rows.append((off, (mask & visible[index]).sum() / max(union, 1), trusted))
        found.append(np.array(rows, float))
        seen.append(one.name)
    found.append(np.concatenate(found))
    for name, rows_ in zip([*seen, "all"], found, strict=True):
        azimuth, iou, trusted = rows_.T
        near, twice = (f"{(azimuth < most).mean():.1%}" for most in (NEAR_DEG, 2 * NEAR_DEG))
        of_trusted = f"{(azimuth[trusted > 0] < NEAR_DEG).mean():.1%}" if trusted.any() else "-"
        said = f"{np.median(azimuth):.1f}, {near}, {twice}; {np.median(iou):.3f}"
        print(f"{name}: {len(rows_)}, {said}; {trusted.mean():.1%}, {of_trusted}")
    if given.json:
        azimuth, iou, _ = found[-1].T
        metrics = [
            metric("azimuth_within_15", [100 * (azimuth < NEAR_DEG).mean()], "%", "higher"),
            metric("visible_iou", [np.median(iou)], "", "higher"),
        ]
        write(report(metrics, threads=torch.get_num_threads()), given.json)


if __name__ == "__main__":
    main()

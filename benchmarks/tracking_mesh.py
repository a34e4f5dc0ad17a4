"""`vig.Tracker` on videos of the very objects of mesh files, which turn while something passes before them.

    python -m benchmarks.tracking_mesh MESH... [--frames 60] [--seed 8] [--show FOLDER]

The generator makes a video of each mesh (`benchmarks.turning`, 640 x 480), whose own colours it shows in
the scene's light. The first frame in which less than .3 is hidden gives the box. Errors are those of frames
that are at most half hidden, without those that the tracker calls lost; that of the distance is a share of
it. Found again: of such frames after the object was hidden by .6 or more, those that are within 15 degrees.
At last the tracker sees one frame a hundred times: how far a still object drifts.
"""

import argparse
import math
from pathlib import Path

import numpy as np
from PIL import Image
from scipy.spatial import cKDTree

from benchmarks.turning import draw_turning
from vig import Explainer, Tracker
from vig.known_object import Surface
from vig.photo.masks import box_of
from vig.scene.light import linear_from_srgb
from vig_world.assets.target import target_vertices
from vig_world.library import Library
from vig_world.raster.draw import Colouring, SurfaceSamples, draw
from vig_world.raster.items import Target
from vig_world.raster.view import View
from vig_world.renderers.rasterized import items_of

SIZE = 640, 480


def main() -> None:
    """Print a line for each mesh."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("meshes", type=Path, nargs="+")
    parser.add_argument("--frames", type=int, default=60)
    parser.add_argument("--seed", type=int, default=8)
    parser.add_argument("--show", type=Path, help="folder for every fifth frame, side by side")
    arguments = parser.parse_args()
    print("mesh  turned, degrees: median, most  distance: median  lost  found again  step, ms  drift")
    for number, mesh in enumerate(arguments.meshes):
        explainer = Explainer.of_mesh(mesh)
        print(mesh.stem, *_measured(explainer, arguments, number), sep="  ", flush=True)


def _measured(explainer: Explainer, arguments: argparse.Namespace, number: int) -> list[str]:
    library, object_class = Library("test"), explainer.object_class
    assert explainer.known is not None
    colouring, shown = _colouring(explainer.known.surface), []
    hidden, turned, far, lost, steps = [], [], [], [], []
    tracker = None
    for scene in draw_turning(library, object_class, arguments.seed, number).frames(arguments.frames):
        view = View.of_scene(scene, object_class, SIZE)
        target = Target.of(
            object_class, target_vertices(scene, object_class), scene.shape, (1, 1, 1), scene.light
        )
        picture = draw(
            items_of(library, scene.props, scene.room, finished=True), target, view, scene.light, colouring
        )
        if tracker is None and picture.occlusion >= 0.3:
            continue
        if tracker is None:
            first, tracker = picture.image, Tracker(explainer, K=view.camera.K)
            box = box_of(picture.amodal)
            pose = tracker.start(picture.image, box=box)
        else:
            pose = tracker.step(picture.image)
            steps.append(1000 * pose.seconds)
        assert pose is not None
        trace = float(np.trace(pose.camera_from_object[:3, :3] @ view.rotation.T))
        turned.append(math.degrees(math.acos(np.clip((trace - 1) / 2, -1, 1))))
        away = np.linalg.norm(pose.camera_from_object[:3, 3] - view.translation)
        far.append(away / np.linalg.norm(view.translation))
        hidden.append(picture.occlusion)
        lost.append(pose.lost)
        shown.append(picture.image)
    if arguments.show is not None:
        Image.fromarray(np.concatenate(shown[::5], axis=1)).save(arguments.show / f"{number}.png")
    if tracker is None:
        return ["no frame in which less than .3 is hidden"]
    gone = np.nonzero(np.array(hidden) >= 0.6)[0]
    seen = np.array(hidden) <= 0.5
    after = seen & (np.arange(len(seen)) > (gone[-1] if len(gone) else len(seen)))
    has = ~np.array(lost) & (np.array(turned) < 15)
    counted = seen & ~np.array(lost)
    tracker.start(first, box=box)
    poses = [tracker.step(first) for _ in range(100)]
    way = [np.linalg.norm((pose.camera_from_object - poses[0].camera_from_object)[:3, 3]) for pose in poses]
    drift = max(way) / np.linalg.norm(poses[0].camera_from_object[:3, 3])
    return [
        f"{np.median(np.array(turned)[counted]):.1f}, {np.max(np.array(turned)[counted]):.0f}",
        f"{np.median(np.array(far)[counted]):.3f}",
        f"{(seen & np.array(lost)).sum()} of {seen.sum()}",
        f"{has[after].sum()} of {after.sum()}",
        f"{np.median(steps):.0f}",
        f"{drift:.4f}",
    ]


def _colouring(surface: Surface) -> Colouring:
    """The surface's own colours in the scene's light, from the nearest of many points on it."""
    rng = np.random.default_rng(0)
    corners = surface.vertices[surface.faces].astype(np.float64)
    area = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
    face = rng.choice(len(area), 400_000, p=area / area.sum())
    shares = rng.dirichlet((1, 1, 1), len(face))
    points = np.einsum("nk,nkj->nj", shares, corners[face])
    uv = np.einsum("nk,nkj->nj", shares, surface.uv[surface.faces[face]]) % 1
    width, height = surface.sizes[surface.texture_of_face[face]].T
    starts = np.cumsum([0, *surface.sizes.astype(int).prod(1)])[surface.texture_of_face[face]]
    column, row = (uv[:, 0] * width).astype(int), ((1 - uv[:, 1]) * height).clip(0, height - 1).astype(int)
    colours = linear_from_srgb(surface.texels[starts + row * width + column] / np.float32(255))
    tree = cKDTree(points)

    def colouring(at: SurfaceSamples) -> np.ndarray:
        mean = colours[tree.query(at.points.T, 4)[1]].mean(1)
        return np.asarray(mean * at.irradiance[:, None] * math.pi)

    return colouring


if __name__ == "__main__":
    main()

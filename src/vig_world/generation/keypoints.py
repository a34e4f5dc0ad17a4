"""Keypoints of a dataset's objects: points that the class names, corners and centre of the object's box."""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from vig.io.errors import UserError
from vig.scene import ObjectClass
from vig_world.assets.target import target_vertices
from vig_world.dataset.format import read_info
from vig_world.dataset.read import Dataset
from vig_world.raster.view import View

CORNERS = tuple(f"corner_{number:03b}" for number in range(8))
"""Corners of the box along the object's axes: 1 stands for the greater x, y, z, in this order."""
EDGES = tuple((i, i | bit) for i in range(8) for bit in (4, 2, 1) if not i & bit)  # pairs of corners
OUTSIDE, HIDDEN, SEEN = 0, 1, 2  # COCO's numbers of visibility


@dataclass(frozen=True)
class Keypoints:
    """Keypoints of one sample: place (N, 2) float64, x and y in pixels from the image's corner, nan behind
    the camera; seen (N,) int, one of `OUTSIDE` (the frame), `HIDDEN`, `SEEN`.
    """

    place: np.ndarray
    seen: np.ndarray

    def rows(self) -> list[tuple[float, float, int]]:
        """Return x, y and visibility of each point; x and y are 0 outside the frame, as in COCO."""
        place = np.where(self.seen[:, None] != OUTSIDE, self.place, 0.0)
        return [(x, y, seen) for (x, y), seen in zip(place.tolist(), self.seen.tolist(), strict=True)]


def names_of(object_class: ObjectClass) -> tuple[str, ...]:
    """Return the names of a class's keypoints, in their order."""
    return (*object_class.points, *CORNERS, "centre")


def points_of(object_class: ObjectClass, vertices: np.ndarray) -> np.ndarray:
    """Return the keypoints (N, 3) of an object (V, 3) of a class, in its frame, metres."""
    named = vertices[[*object_class.points.values()]].reshape(-1, 3)
    low, high = vertices.min(0), vertices.max(0)
    corners = [np.where([i & 4, i & 2, i & 1], high, low) for i in range(8)]
    return np.concatenate([named, corners, [(low + high) / 2]]).astype(np.float64)


def mirror_order(object_class: ObjectClass) -> list[int] | None:
    """Return which keypoint each one is in a mirror image of an object: (N,); None where it shows none."""
    if not object_class.mirror:
        return None
    points = points_of(object_class, object_class.shape_model.mean)
    gaps = np.linalg.norm(points * [1, -1, 1] - points[:, None], axis=2)
    partner = gaps.argmin(0)
    # Distance from a point's mirror image, over the length of the mean shape's box.
    close = gaps.min(0) <= 0.02 * np.ptp(points, axis=0).max()
    return partner.tolist() if close.all() and (partner[partner] == np.arange(len(points))).all() else None


def class_of(root: Path, split: str, given: ObjectClass | None) -> ObjectClass:
    """Return the class that a split was made with: the one given, or the packaged one of its name.

    Raises UserError when it is another one, or there is none of that name.
    """
    settings = read_info(root)["splits"][split]
    object_class = given or ObjectClass.load(settings["class"])
    if object_class.fingerprint != settings["class_fingerprint"]:
        raise UserError(
            f"'{root}' was made with another class than this '{object_class.name}';"
            " give the folder of its class pack with --class."
        )
    return object_class


def class_of_keypoints(root: Path, split: str, given: ObjectClass | None) -> ObjectClass:
    """Return the class as `class_of`; UserError also where the objects of a split have no keypoints."""
    if read_info(root)["splits"][split]["world"] == "studio":
        raise UserError(
            f"expected a dataset of the world photo or paper; got '{root}' of the studio, whose objects are"
            " warped and have no keypoints. Make another, or export to coco or webdataset."
        )
    return class_of(root, split, given)


def keypoints(dataset: Dataset, object_class: ObjectClass, indices: Iterable[int]) -> Iterator[Keypoints]:
    """Yield the keypoints of some samples. Raises UserError when a file of theirs is missing or damaged."""
    specs, size = dataset.specs(), dataset.size
    for index in indices:
        spec = specs[index]
        vertices = target_vertices(spec, object_class)
        view = View.of_scene(spec, object_class, size)
        depth, mask = (dataset.read(kind, [index])[0] for kind in ("depth", "mask_visib"))
        points = points_of(object_class, vertices)
        # By so much of its box's diagonal a point may lie behind its pixel's surface.
        slack = 0.02 * float(np.linalg.norm(np.ptp(vertices, axis=0)))
        yield _locate_keypoints(points, len(object_class.points), view, depth, mask, slack)


def _locate_keypoints(
    points: np.ndarray, on_surface: int, view: View, depth: np.ndarray, mask: np.ndarray, slack: float
) -> Keypoints:
    """Project points (N, 3), of which the first `on_surface` lie on the object, into a view with depth
    image (H, W) and mask of the object's visible pixels (H, W).

    A point is seen where nothing lies before it. One of the surface must also be at a pixel of the mask or
    beside one: at an outline the pixel itself may be another thing's.
    """
    camera = view.camera
    in_camera = points @ view.rotation.T + view.translation
    z = in_camera[:, 2]
    in_camera[z <= 0] = np.nan
    place = camera.focal * in_camera[:, :2] / z[:, None] + [camera.cx, camera.cy]
    inside = ((place >= 0) & (place < [camera.width, camera.height])).all(1)
    seen = np.full(len(points), OUTSIDE)
    for number in np.flatnonzero(inside):
        column, row = place[number].astype(int)
        nearby = slice(max(row - 1, 0), row + 2), slice(max(column - 1, 0), column + 2)
        # Within a pixel a slanted surface has many depths, of which the image has the least.
        reach = slack + z[number] / camera.focal
        if number < on_surface:
            around = depth[nearby][mask[nearby]]
            free = bool((around + reach >= z[number]).any())
        else:
            free = bool(depth[row, column] + reach >= z[number])
        seen[number] = SEEN if free else HIDDEN
    return Keypoints(place, seen)

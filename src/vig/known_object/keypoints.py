"""Keypoints of the views of a known object, and places of a whole photo that show the same."""

from __future__ import annotations

import math
from contextlib import suppress
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path

import numpy as np

from vig.io.checks import check_arrays, check_indices, read_tensors, reading
from vig.io.errors import UserError
from vig.io.files import write_arrays
from vig.known_object.search import VIEW_DISTANCE, Views, towards
from vig.parallel import thread_count
from vig.photo import Intrinsics
from vig.scene.light import srgb8_from_linear
from vig_native import engine

FILE = "keypoints.safetensors"
_TABLE = {
    "place": ("float32", ("N", 2)),
    "angle": ("float32", ("N",)),
    "size": ("float32", ("N",)),
    "descriptor": ("float16", ("N", 128)),
    "view": ("int32", ("N",)),
    "point": ("float32", ("N", 3)),
}
DIRECTIONS, PIXELS = 100, 200
"""Views whose keypoints are kept, some 20 degrees apart, and pixels of the object's diameter in them."""
SIMILAR, MAX_ALIKE = 0.9, 6
"""Least cosine of the descriptors of a match, and matches of each of a photo's keypoints at most."""
MIN_MATCHES = 5  # keypoints that one pose explains


@dataclass(frozen=True)
class Keypoints:
    """Scale-invariant keypoints of a picture (SIFT, Lowe 2004) whose descriptors are square roots of shares
    (Arandjelovic and Zisserman 2012).

    Attributes:
        place: (N, 2) float32 pixels x, y.
        angle: (N,) float32 radians, clockwise.
        size: (N,) float32 pixels.
        descriptor: (N, 128) float32 of length 1.
    """

    place: np.ndarray
    angle: np.ndarray
    size: np.ndarray
    descriptor: np.ndarray

    @staticmethod
    def available() -> bool:
        """Return whether OpenCV is installed, which finds them."""
        return find_spec("cv2") is not None

    @staticmethod
    def of(picture: np.ndarray) -> Keypoints:
        """Return those of a picture (H, W, 3), uint8 sRGB or linear RGB; UserError without OpenCV."""
        try:
            import cv2
        except ModuleNotFoundError:
            raise UserError(
                "expected a box or a mask, or the package opencv-python-headless, with which the object of a"
                " mesh is found in a photo; got none. Give --box x,y,w,h round the whole object, or --mask,"
                ' or pip install "vig[match]".'
            ) from None
        cv2.setNumThreads(thread_count())
        if picture.dtype != np.uint8:
            picture = srgb8_from_linear(picture)
        most_length = 2000  # pixels of a photo's longer side in which keypoints are sought
        shrunk = min(1.0, most_length / max(picture.shape[:2]))
        grey = cv2.cvtColor(picture, cv2.COLOR_RGB2GRAY)
        if shrunk < 1:
            size = [max(1, round(side * shrunk)) for side in grey.shape[::-1]]
            grey = cv2.resize(grey, size, interpolation=cv2.INTER_AREA)
        # 0.02: of OpenCV's .04, as print in shadow has little contrast
        found, shares = cv2.SIFT_create(contrastThreshold=0.02).detectAndCompute(grey, None)  # type: ignore[attr-defined]
        shares = np.zeros((0, 128), np.float32) if shares is None else shares
        numbers = np.array([(*each.pt, each.size, each.angle) for each in found], np.float32).reshape(-1, 4)
        return Keypoints(
            (numbers[:, :2] + np.float32(0.5)) / np.float32(shrunk),
            np.radians(numbers[:, 3]),
            numbers[:, 2] / np.float32(shrunk),
            np.sqrt(shares / np.maximum(shares.sum(1, keepdims=True), 1e-9)),
        )

    def __getitem__(self, rows: np.ndarray) -> Keypoints:
        """Return some of them."""
        return Keypoints(*(each[rows] for each in vars(self).values()))


@dataclass(frozen=True)
class MatchedPose:
    """A pose at which keypoints of a photo are those of an object.

    Attributes:
        weight: Sum over them of how far descriptors are more alike than `SIMILAR`.
        pose: (4, 4) from the surface, its middle at the origin, to the camera, metres.
        keypoints: Their numbers.
    """

    weight: float
    pose: np.ndarray
    keypoints: frozenset[int]

    def is_like(self, other: MatchedPose) -> bool:
        """Return whether the other explains mostly the same, turned alike."""
        cosine = (np.trace(self.pose[:3, :3].T @ other.pose[:3, :3]) - 1) / 2
        shared = len(self.keypoints & other.keypoints)
        return bool(cosine > math.cos(math.radians(20)) and shared > len(other.keypoints) / 2)


@dataclass(frozen=True)
class ViewKeypoints:
    """Keypoints of a surface seen from all round.

    Attributes:
        keypoints: Their places count from the middles of the views.
        view: (N,) int32 numbers of their views.
        point: (N, 3) float32 where they are on the surface, metres from its middle.
        rotations: (DIRECTIONS, 3, 3) float64 from the surface to the views' cameras.
        radius: Radius of the surface, metres.
    """

    keypoints: Keypoints
    view: np.ndarray
    point: np.ndarray
    rotations: np.ndarray
    radius: float

    @staticmethod
    def of(views: Views, folder: Path | None = None) -> ViewKeypoints:
        """Return those of a surface's views: read from the folder of its pack, else made and kept there
        where it can be written.
        """
        rotations = Views.directions(DIRECTIONS)
        if folder is not None and (folder / FILE).exists():
            with reading(folder / FILE, "keypoints of an object", "Remove it, it is made again."):
                arrays, _ = read_tensors(folder / FILE)
                check_arrays(arrays, _TABLE)
                check_indices("view", arrays["view"], DIRECTIONS)
        else:
            arrays = _keypoint_table(views, rotations)
            if folder is not None:
                with suppress(OSError, UserError):  # a pack that others own
                    write_arrays(folder / FILE, arrays)
        descriptor = arrays["descriptor"].astype(np.float32)
        keypoints = Keypoints(arrays["place"], arrays["angle"], arrays["size"], descriptor)
        return ViewKeypoints(keypoints, arrays["view"], arrays["point"], rotations, views.radius)


@dataclass(frozen=True)
class Matches:
    """Pairs of keypoints of a photo and of a surface's views that look alike.

    Attributes:
        photo: Keypoints of the photo.
        lens: Intrinsics of the photo.
        views: Keypoints of the views.
        mine: (M,) numbers of the photo's.
        its: (M,) numbers of the views'.
        weight: (M,) how far their descriptors are more alike than `SIMILAR`, and .02.
    """

    photo: Keypoints
    lens: Intrinsics
    views: ViewKeypoints
    mine: np.ndarray
    its: np.ndarray
    weight: np.ndarray

    @staticmethod
    def of(photo: Keypoints, views: ViewKeypoints, lens: Intrinsics) -> Matches:
        """Return the pairs that look alike."""
        parts = [np.zeros((3, 0))]
        for start in range(0, len(photo.angle), 512):
            alike = photo.descriptor[start : start + 512] @ views.keypoints.descriptor.T
            row, column = np.nonzero(alike > SIMILAR)
            cosine = alike[row, column]
            order = np.lexsort((-cosine, row))
            row, column, cosine = row[order], column[order], cosine[order]
            kept = np.arange(len(row)) - np.searchsorted(row, row) < MAX_ALIKE
            parts.append(np.stack([row + start, column, cosine - SIMILAR + 0.02])[:, kept])
        mine, its, weight = np.concatenate(parts, axis=1)
        return Matches(photo, lens, views, mine.astype(int), its.astype(int), weight)

    def poses(self) -> list[MatchedPose]:
        """Return poses at which the photo shows the surface's keypoints, the likeliest first."""
        found = list[MatchedPose]()
        for _, pose in sorted(self._poses_of_views(), key=lambda each: -each[0])[:40]:
            fitted = self._fit_to_matches(pose)
            if fitted is not None and not any(each.is_like(fitted) for each in found):
                found.append(fitted)
        return sorted(found, key=lambda each: -each.weight)

    def agreeing(self, pose: np.ndarray, tolerance: float = 0.05) -> np.ndarray:
        """Return the rows of matches that a pose (4, 4) explains, one for each of the photo's keypoints.

        tolerance: Distance of a point from its keypoint, of the object's diameter in the photo.
        """
        radius, rotations = self.views.radius, self.views.rotations
        seen = self.views.point[self.its] @ pose[:3, :3].T + pose[:3, 3]
        flat = seen @ self.lens.K.T
        error = np.linalg.norm(
            flat[:, :2] / np.maximum(flat[:, 2:], 1e-6) - self.photo.place[self.mine], axis=1
        )
        sight = pose[:3, :3].T @ (pose[:3, 3] / np.linalg.norm(pose[:3, 3]))
        facing = rotations[:, 2] @ sight > 0.6
        # 400: pixels that the diameter counts for at most
        size = min(2 * radius * self.lens.fx / pose[2, 3], 400.0)
        near = (error < tolerance * size) & facing[self.views.view[self.its]] & (seen[:, 2] > 0)
        inside = np.nonzero(near)[0]
        inside = inside[np.argsort(error[inside], kind="stable")]
        return inside[np.unique(self.mine[inside], return_index=True)[1]]

    def _poses_of_views(self) -> list[tuple[float, np.ndarray]]:
        """Return (votes, pose) of views whose keypoints a photo shows about as they are in the view: turned,
        magnified and moved.
        """
        photo, its, number, found = self.photo, self.views.keypoints, self.views.view[self.its], []
        # Turn and magnification as one complex number, places as complex numbers.
        turn = photo.angle[self.mine] - its.angle[self.its]
        factor = photo.size[self.mine] / its.size[self.its] * np.exp(1j * turn)
        at = photo.place[self.mine] @ [1, 1j]
        on = its.place[self.its] @ [1, 1j]
        middle = at - factor * on
        for view in np.unique(number):
            rows = np.nonzero(number == view)[0]
            rows = np.sort(rows[np.argsort(-self.weight[rows], kind="stable")[:120]])
            for _ in range(2):  # objects of one kind
                if len(rows) < MIN_MATCHES:
                    break
                each = factor[rows, None]
                error = np.abs(middle[rows, None] + each * on[rows] - at[rows])
                ratio = factor[rows] / each
                agree = (np.abs(np.log(np.abs(ratio))) < 0.5) & (np.cos(np.angle(ratio)) > 0.85)
                agree &= error < np.minimum(0.06 * PIXELS * np.abs(each), 25)
                first = np.unique(self.mine[rows], return_index=True)[1]
                votes = np.maximum.reduceat(agree * self.weight[rows], first, axis=1)
                sums = votes.sum(1) * ((votes > 0).sum(1) >= MIN_MATCHES - 1)
                best = int(sums.argmax())
                if sums[best] <= 0:
                    break
                inside = rows[agree[best]]
                from_middle, to = on[inside] - on[inside].mean(), at[inside] - at[inside].mean()
                fitted = (from_middle.conj() * to).sum() / max(float((np.abs(from_middle) ** 2).sum()), 1e-9)
                if 0.1 < np.abs(fitted) < 20:
                    place = at[inside].mean() - fitted * on[inside].mean()
                    found.append((float(sums[best]), self._pose(self.views.rotations[view], fitted, place)))
                rows = rows[~np.isin(self.mine[rows], self.mine[inside])]
        return found

    def _pose(self, rotation: np.ndarray, factor: complex, place: complex) -> np.ndarray:
        """Return the pose (4, 4) of a view that is turned and magnified, its middle at a place."""
        lens = self.lens
        ray = np.array([(place.real - lens.cx) / lens.fx, (place.imag - lens.cy) / lens.fy, 1.0])
        c, s = factor.real / abs(factor), factor.imag / abs(factor)
        pose = np.eye(4)
        pose[:3, :3] = towards(ray[None])[0] @ np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]]) @ rotation
        pose[:3, 3] = (
            ray * lens.fx * VIEW_DISTANCE * self.views.radius / (Views.focal_of(PIXELS) * abs(factor))
        )
        return pose

    def _fit_to_matches(self, pose: np.ndarray) -> MatchedPose | None:
        """Return a pose after fits to the matches of all views that agree with it, which are fewer each
        time; None where too few do.
        """
        import cv2

        radius = self.views.radius
        at, on = (a.astype(np.float64) for a in (self.photo.place[self.mine], self.views.point[self.its]))
        inside = np.zeros(0, int)
        for tolerance in (0.1, 0.05, 0.03):
            inside = self.agreeing(pose, tolerance)
            if len(inside) < MIN_MATCHES:
                return None
            start = cv2.Rodrigues(pose[:3, :3])[0], pose[:3, 3:].copy()
            done, turn, shift = cv2.solvePnP(on[inside], at[inside], self.lens.K, None, *start, True)
            if not done or not 2 * radius < shift[2, 0] < 1e3 * radius:
                return None
            pose = np.eye(4)
            pose[:3, :3], pose[:3, 3] = cv2.Rodrigues(turn)[0], shift[:, 0]
        return MatchedPose(float(self.weight[inside].sum()), pose, frozenset(self.mine[inside].tolist()))


def _keypoint_table(views: Views, rotations: np.ndarray) -> dict[str, np.ndarray]:
    """Return the arrays of `_TABLE` of a surface's views."""
    surface, focal, distance = views.surface, Views.focal_of(PIXELS), VIEW_DISTANCE * views.radius
    camera = focal, PIXELS / 2, PIXELS / 2, PIXELS, PIXELS
    away, parts = np.array([0.0, 0.0, distance]), []
    for number, (coverage, colour, _) in enumerate(views.draw_rotations(rotations, PIXELS)):
        covered = coverage[..., None]
        found = Keypoints.of(srgb8_from_linear(colour * covered + 0.2 * (1 - covered)))
        column, row = found.place.astype(int).T
        inside = _inner(coverage > 0.9)[row, column]
        found, column, row = found[inside], column[inside], row[inside]
        seen = (surface.vertices - surface.middle) @ rotations[number].T + away
        depth = engine.rasterize(seen.astype(np.float32), surface.faces, camera, 1e-3, False)[2]
        place = found.place - np.float32(PIXELS / 2)
        ray = np.column_stack([place / focal, np.ones(len(row))]) * depth[row, column][:, None]
        point = (ray - away) @ rotations[number]
        on = np.isfinite(point).all(1)
        drawn = vars(found) | {"place": place, "view": np.full(len(row), number), "point": point}
        parts.append({name: values[on] for name, values in drawn.items()})
    return {
        name: np.concatenate([part[name] for part in parts]).astype(kind)
        for name, (kind, _) in _TABLE.items()
    }


def _inner(covered: np.ndarray) -> np.ndarray:
    """Return the pixels (H, W) bool whose neighbours within two pixels are covered."""
    height, width = covered.shape
    padded = np.pad(covered, 2)
    shifted = [padded[i : i + height, j : j + width] for i in range(5) for j in range(5)]
    return np.asarray(np.all(shifted, axis=0))

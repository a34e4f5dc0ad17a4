"""Search for the pose of a known object in a window of a photo: views all round, the best few refined."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from vig.known_object.picture import WEIGHTS, Picture, weights_of
from vig.known_object.surface import Surface, sphere
from vig_native import engine

VIEWS, TURNS = 400, 36
"""Directions from which an object is drawn, some 10 degrees apart, and turns of each about the sight line."""
VIEW_PIXELS, VIEW_SAMPLES = 24, 4
"""Pixels a side of a view, and samples a side of each: print is blurred, as in a photo that small."""
VIEW_DISTANCE = 6.0  # distance of the views' camera in radii of the object, with little perspective
MAX_ASPECT = 0.35
"""A view is left out where the log ratio of its box's sides differs by more from the given box's, unless
fewer than 200 remained."""
SAME = math.radians(5.0)  # angle below which poses that were refined are one
APART = math.radians(16.0)  # least angle between views that are refined
LOOSE_OUTLINE = 1.0
"""`ScoreWeights.outline` for views where a box alone separates the object from its surroundings."""


@dataclass(frozen=True)
class Stage:
    """Searches near the best poses of the stage before.

    Attributes:
        count: How many poses.
        pixels: Pixels of the box's longer side.
        evaluations: Number of evaluations of each pose.
        steps: First steps: radians, shares of the distance across and away.
        lag: Poses whose scores are lower than the best by more are left as they are.
    """

    count: int
    pixels: int
    evaluations: int
    steps: tuple[float, float, float]
    lag: float


STAGES = (
    Stage(20, 32, 35, (0.14, 0.02, 0.03), math.inf),
    Stage(8, 48, 60, (0.1, 0.014, 0.02), 4.0),
    Stage(4, 80, 90, (0.06, 0.008, 0.012), 2.5),
    Stage(2, 80, 120, (0.025, 0.003, 0.005), 1.5),
)
"""Chosen on every third object of the photos of HOPE under one light."""


@dataclass(frozen=True)
class Poses:
    """Poses before the camera of a picture, the best first.

    Attributes:
        rotations: (N, 3, 3) float32.
        translations: (N, 3) float32 metres, of the middle of the surface.
        scores: (N,) float64.
    """

    rotations: np.ndarray
    translations: np.ndarray
    scores: np.ndarray

    def __getitem__(self, rows: slice | np.ndarray) -> Poses:
        """Return some of them."""
        return Poses(self.rotations[rows], self.translations[rows], self.scores[rows])

    @property
    def matrices(self) -> np.ndarray:
        """Return them as (N, 4, 4)."""
        poses = np.tile(np.eye(4), (len(self.scores), 1, 1))
        poses[:, :3, :3], poses[:, :3, 3] = self.rotations, self.translations
        return poses

    def beside(self, others: np.ndarray) -> Poses:
        """Return them and others (N, 4, 4), which have no score yet."""
        return Poses(
            np.concatenate([self.rotations, others[:, :3, :3]]).astype(np.float32),
            np.concatenate([self.translations, others[:, :3, 3]]).astype(np.float32),
            np.concatenate([self.scores, np.full(len(others), -np.inf)]),
        )

    def distinct(self, least: float = SAME) -> Poses:
        """Return those that are turned by at least an angle, radians, against all before them."""
        chosen: list[int] = []
        for number, rotation in enumerate(self.rotations):
            traces = np.einsum("ij,kij->k", rotation, self.rotations[chosen])
            if (traces < 1 + 2 * math.cos(least)).all():
                chosen.append(number)
        return self[np.array(chosen)]

    def add_keypoint_scores(self, keypoints: Sequence[int]) -> Poses:
        """Return them with 0.05 n added to each score, n of the keypoints that each explains."""
        # 0.05, 40: chosen on HOPE under two of its lights
        scores = self.scores + 0.05 * np.minimum(keypoints, 40)
        return replace(self, scores=scores)[np.argsort(-scores, kind="stable")]

    def refine(self, surface: Surface, picture: Picture, stage: Stage) -> Poses:
        """Return the best `stage.count` after a search near each, the best first, and then the others."""
        ordered = self[np.argsort(-self.scores, kind="stable")]
        count = min(stage.count, int((ordered.scores >= ordered.scores[0] - stage.lag).sum()))
        near, rest = ordered[:count], ordered[count:]
        found = engine.refine_poses(
            surface.mesh,
            picture.native(surface),
            near.rotations,
            near.translations,
            stage.evaluations,
            stage.steps,
            1,
        )
        best = Poses(*found)[np.argsort(-found[2], kind="stable")]
        parts = zip(vars(best).values(), vars(rest).values(), strict=True)
        return Poses(*(np.concatenate(pair) for pair in parts))

    def at_box(self, surface: Surface, picture: Picture) -> Poses:
        """Return them moved so that each fills the picture's box, where that has the higher score."""
        if picture.box is None:
            return self
        left, right, top, bottom = picture.box
        at = np.array([left + right, top + bottom]) / 2 - picture.colour.shape[1] / 2
        points = surface.outermost - surface.middle
        turned, moved = points @ self.rotations.transpose(0, 2, 1), self.translations.astype(np.float64)
        for _ in range(4):  # each a fixed point's step: the size by the depth, then the place
            seen = turned + moved[:, None]
            flat = picture.focal * seen[..., :2] / seen[..., 2:]
            low, high = flat.min(1), flat.max(1)
            grown = np.sqrt((high - low).prod(1) / ((right - left) * (bottom - top)))[:, None]
            across = (at - (low + high) / 2) / picture.focal
            moved = moved * grown + np.column_stack([across * (moved * grown)[:, 2:], np.zeros(len(moved))])
        native, moved = picture.native(surface), moved.astype(np.float32)
        there, here = (
            engine.refine_poses(surface.mesh, native, self.rotations, places, 0, (0.0, 0.0, 0.0), 1)[2]
            for places in (moved, self.translations)
        )
        return Poses(
            self.rotations,
            np.where((there > here)[:, None], moved, self.translations),
            np.maximum(there, here),
        )


@dataclass(frozen=True)
class Views:
    """Small pictures of a surface from all round it, and the bounds of each at every turn."""

    surface: Surface

    @staticmethod
    def directions(count: int) -> np.ndarray:
        """Return (count, 3, 3) float64, from a surface to cameras on a Fibonacci sphere."""
        forward = -sphere(count)
        up = np.where(np.abs(forward[:, 2:]) < 0.99, [[0.0, 0.0, 1.0]], [[0.0, 1.0, 0.0]])
        right = np.cross(forward, up)
        right /= np.linalg.norm(right, axis=1, keepdims=True)
        return np.stack([right, np.cross(forward, right), forward], 1)

    @cached_property
    def rotations(self) -> np.ndarray:
        """Return the rotations (VIEWS, 3, 3) of the views."""
        return Views.directions(VIEWS)

    @cached_property
    def radius(self) -> float:
        """Return the radius of the surface about its middle, metres."""
        return float(np.linalg.norm(self.surface.vertices - self.surface.middle, axis=1).max())

    @staticmethod
    def focal_of(pixels: int) -> float:
        """Return the focal length at which a sphere of the surface's radius fills a view."""
        return 0.98 * pixels / 2 * math.sqrt(VIEW_DISTANCE**2 - 1)

    @cached_property
    def focal(self) -> float:
        """Return the focal length of the views."""
        return Views.focal_of(VIEW_PIXELS)

    def draw_rotations(self, rotations: np.ndarray, pixels: int) -> Iterator[tuple[np.ndarray, ...]]:
        """Yield for each rotation (N, 3, 3) covered shares (n, n), linear RGB and normals (n, n, 3)."""
        nothing = np.zeros((pixels, pixels, 3), np.float32)
        focal = Views.focal_of(pixels)
        per_pixel = VIEW_DISTANCE * self.radius / focal
        camera, unused = (focal, pixels / 2, pixels / 2), WEIGHTS.of_box(1.0, 1.0)
        photo = engine.pose_photo(nothing, nothing[..., 0], camera, None, None, False, per_pixel, unused)
        middle = np.array([0, 0, VIEW_DISTANCE * self.radius], np.float32)
        for rotation in rotations.astype(np.float32):
            yield engine.draw_pose(self.surface.mesh, photo, rotation, middle)[:3]

    @cached_property
    def planes(self) -> np.ndarray:
        """Return (VIEWS, 7, n, n) float32: covered share, linear RGB, normal in the camera's frame."""
        share = VIEW_SAMPLES // 2  # each pixel that is drawn has two samples a side
        planes = np.empty((VIEWS, 7, VIEW_PIXELS, VIEW_PIXELS), np.float32)
        for number, drawn in enumerate(self.draw_rotations(self.rotations, VIEW_PIXELS * share)):
            coverage, colour, normal = drawn
            sums = np.concatenate(
                [coverage[..., None], coverage[..., None] * np.concatenate([colour, normal], 2)], 2
            )
            pooled = sums.reshape(VIEW_PIXELS, share, VIEW_PIXELS, share, 7).mean((1, 3))
            pooled[..., 1:] /= np.maximum(pooled[..., :1], 1e-6)
            planes[number] = pooled.transpose(2, 0, 1)
        return planes

    @cached_property
    def bounds(self) -> tuple[np.ndarray, np.ndarray]:
        """Return least and greatest x, y (TURNS, VIEWS, 2) in pixels of the views, from their middle."""
        outermost = (self.surface.outermost - self.surface.middle) / self.radius
        seen = np.einsum("nij,vj->nvi", self.rotations, outermost)
        flat = seen[..., :2] / (seen[..., 2:] + VIEW_DISTANCE) * self.focal
        turned = np.einsum("aij,nvj->anvi", _turns()[:, :2, :2], flat)
        return turned.min(2), turned.max(2)

    def candidates(self, picture: Picture, agrees: Callable[[np.ndarray], np.ndarray]) -> Poses:
        """Return the views that explain a picture best, `APART` from each other, as poses.

        agrees: Function that returns which (N,) of rotations (N, 3, 3) may be right; all may where none is.
        """
        assert picture.box is not None
        left, right, top, bottom = picture.box
        low, high = self.bounds
        width, height = np.moveaxis(high - low, 2, 0)
        aspect = math.log((right - left) / (bottom - top)) - np.log(width / height)
        turn, view = np.nonzero(
            np.abs(aspect) < max(MAX_ASPECT, float(np.partition(np.abs(aspect), 200, axis=None)[200]))
        )
        scale = np.sqrt((right - left) * (bottom - top) / (width * height))[turn, view]
        at = np.array([left + right, top + bottom]) / 2 - scale[:, None] * (low + high)[turn, view] / 2
        return self._best(picture, turn, view, scale, at, 8 * aspect[turn, view] ** 2, agrees)

    def about(self, picture: Picture, rotation: np.ndarray, depth: float, places: np.ndarray) -> Poses:
        """Return the poses at places (M, 2) in pixels, near a rotation (3, 3), that explain a picture best.

        depth: Depth of the surface's middle, metres.
        """
        near = 1 + 2 * math.cos(math.radians(60.0))  # by which it may have turned while it was not seen
        turn, view = np.nonzero(
            np.einsum("aij,njk,ik->an", _turns(), self.rotations, rotation, optimize=True) > near
        )
        count = len(turn)
        turn, view = (np.tile(numbers, len(places)) for numbers in (turn, view))
        scale = np.full(len(turn), picture.focal * VIEW_DISTANCE * self.radius / (self.focal * depth))
        return self._best(
            picture, turn, view, scale, places.repeat(count, 0), 0.0, lambda all_: all_[:, 0, 0] < 2
        )

    def _best(
        self,
        picture: Picture,
        turn: np.ndarray,
        view: np.ndarray,
        scale: np.ndarray,
        at: np.ndarray,
        penalty: np.ndarray | float,
        agrees: Callable[[np.ndarray], np.ndarray],
    ) -> Poses:
        """Return the best of views (N,), turned, magnified and placed at (N, 2), `APART` from each other."""
        angle = turn * math.tau / TURNS
        placed = np.stack([scale * np.cos(angle), scale * np.sin(angle), at[:, 0], at[:, 1], scale], 1)
        colour = picture.colour * np.float32(picture.exposure)
        planes = np.concatenate([colour.transpose(2, 0, 1), picture.owned[None]])
        middle = picture.colour.shape[1] / 2
        ray = np.column_stack([(at - middle) / picture.focal, np.ones(len(at))])
        rotations = towards(ray) @ _turns()[turn] @ self.rotations[view]
        # A view's pixel is focal / distance of its camera; the picture's is `scale` as large.
        depth = picture.focal * VIEW_DISTANCE * self.radius / (self.focal * scale)
        weights = weights_of(self.surface)
        scores = engine.score_views(
            self.planes, np.ascontiguousarray(planes), view.astype(np.int32), placed.astype(np.float32),
            weights.outline if picture.outlined else LOOSE_OUTLINE, weights.unseen, 1,
        ) - penalty  # fmt: skip
        allowed = agrees(rotations)
        scores = np.where(allowed, scores, -math.inf) if allowed.any() else scores
        chosen: list[int] = []
        for index in np.argsort(-scores, kind="stable")[:1500]:
            traces = np.einsum("ij,kij->k", rotations[index], rotations[chosen])
            if np.isfinite(scores[index]) and (traces < 1 + 2 * math.cos(APART)).all():
                chosen.append(int(index))
            if len(chosen) == STAGES[0].count:
                break
        translations = (ray * depth[:, None])[chosen]
        return Poses(rotations[chosen].astype(np.float32), translations.astype(np.float32), scores[chosen])


def _turns() -> np.ndarray:
    """Return rotations (TURNS, 3, 3) about the optical axis."""
    angle = np.arange(TURNS) * math.tau / TURNS
    turns = np.zeros((TURNS, 3, 3))
    turns[:, 0, 0] = turns[:, 1, 1] = np.cos(angle)
    turns[:, 1, 0], turns[:, 0, 1], turns[:, 2, 2] = np.sin(angle), -np.sin(angle), 1
    return turns


def towards(ray: np.ndarray) -> np.ndarray:
    """Return the least rotations (N, 3, 3) from the optical axis to rays (N, 3)."""
    x, y, z = (ray / np.linalg.norm(ray, axis=1, keepdims=True)).T
    share = 1 / (1 + z)
    rows = [[1 - share * x * x, -share * x * y, x], [-share * x * y, 1 - share * y * y, y], [-x, -y, z]]
    return np.moveaxis(np.array(rows), 2, 0)


def locate(surface: Surface, poses: Poses, picture_of: Callable[[int], Picture]) -> Poses:
    """Return poses after all stages; the last one's come first, then others of the stage before.

    picture_of: Function that returns the photo at so many pixels of the box's longer side.
    """
    stages = replace(STAGES[0], count=len(poses.scores)), *STAGES[1:]
    for stage in stages:
        picture = picture_of(stage.pixels)
        poses = poses[: max(stage.count, STAGES[-2].count)].at_box(surface, picture)
        poses = poses.refine(surface, picture, stage).distinct()
    return poses

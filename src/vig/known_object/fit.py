"""Fits of a known object: its place in a photo, the search for its pose, masks, verdict, deviations."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from typing import Any

import numpy as np

from vig.hints import Hints
from vig.inference.settings import UNIFORM_TURN, Fit, OtherView, Verdict
from vig.known_object.align import PIXELS as ALIGN_PIXELS
from vig.known_object.align import align, contiguous, small_turns
from vig.known_object.keypoints import Keypoints, Matches, ViewKeypoints
from vig.known_object.picture import WEIGHTS, Picture, Place
from vig.known_object.search import VIEW_PIXELS, Poses, Stage, Views, locate
from vig.known_object.surface import FILE, Surface
from vig.known_object.verdict import DISTINCT, TRUSTED, judge, print_explained, rivals_of
from vig.likelihood import SPATIAL, spatial_posterior
from vig.photo import ImagePyramid, Intrinsics, Window
from vig.photo.window import DISTANCE_RATIO_BOUNDS
from vig.scene import IMAGE_SIZE, Latents, ObjectClass, latent_layout
from vig.scene.camera import FOCAL_OVER_WIDTH, angle_difference, view_of
from vig_native import engine
from vig_renderer.harmonics import COSINE_LOBE, L_COUNT, Y00, Y1

MARGIN = 1.3  # side of the window that is searched over the longer side of the object's box
STEPS = np.array([0.05, 0.05, 0.05, 0.01, 0.01, 0.02])
"""Differences by which a score's curvature is measured: radians about x, y, z; shares of the distance."""


@dataclass(frozen=True)
class KnownObject:
    """One object whose mesh is known.

    Attributes:
        object_class: Its class, of exact shape.
        surface: Its triangles with textures.
    """

    object_class: ObjectClass
    surface: Surface

    @staticmethod
    def of(object_class: ObjectClass) -> "KnownObject | None":
        """Return the object of a class pack that has a surface, else None."""
        folder = object_class.folder
        if folder is None or not (folder / FILE).exists():
            return None
        return KnownObject(object_class, Surface.load(folder))

    def is_sought(self, told: Hints) -> bool:
        """Return whether it is sought in any rotation, not fitted standing: no roll is told, and it has
        colours or its visible pixels are known.
        """
        return told.roll_deg is None and (told.mask is not None or not self.surface.one_colour)

    def is_followed(self, told: Hints) -> bool:
        """Return whether videos follow it by its colours, in any rotation: no roll is given."""
        return told.roll_deg is None and not self.surface.one_colour

    @cached_property
    def views(self) -> Views:
        """Return the surface as seen from all round."""
        return Views(self.surface)

    @cached_property
    def keypoints(self) -> ViewKeypoints:
        """Return the keypoints of the views, kept in the pack."""
        return ViewKeypoints.of(self.views, self.object_class.folder)

    def explain(
        self, pyramid: ImagePyramid, place: Place, lens: Intrinsics | None, told: Hints
    ) -> tuple[Window, Fit, float]:
        """Return a window of the photo, the fit in it, and the ratio of its camera, see `ExplainSettings`.

        Args:
            pyramid: The photo.
            place: The place of the object in it.
            lens: Intrinsics of the photo; None: those usual of phones and webcams.
            told: Its pose begins the search, in place of views all round; without one only views within
                `DISTINCT` of its azimuth and elevation are tried.
        """
        height, width = pyramid.shape[:2]
        known, lens = lens is not None, lens or assumed_lens(width, height)
        x, y, w, h = place.box
        Window.of(width, height, place.box)  # which refuses boxes beside the photo
        side = MARGIN * max(w, h)
        window = Window(x + w / 2 - side / 2, y + h / 2 - side / 2, side, lens=lens)
        poses, keypoints = self._search(pyramid, window, place, told)
        window, fit, ratio = self._fit(pyramid, window, place, poses, lens, keypoints)
        if fit.verdict is Verdict.TRUSTED and not known:
            fit = replace(fit, reason=f"{fit.reason}; without K its distance is a guess")
        return window, fit, ratio

    def follow(
        self,
        pyramid: ImagePyramid,
        expected: np.ndarray,
        stages: Sequence[Stage],
        lens: Intrinsics,
        seek: bool = False,
    ) -> tuple[Window, Fit, float, np.ndarray]:
        """Return window, fit and ratio as `explain`, and the pose (4, 4), by a search near some poses.

        expected: (N, 4, 4) camera_from_object, the likeliest first. `seek`: the object may be elsewhere about
        there, and turned.
        """
        turns = expected[:, :3, :3]
        middles = turns @ self.surface.middle + expected[:, :3, 3]
        points = (self.surface.outermost - self.surface.middle) @ turns[0].T
        seen = (points + middles[:, None]) @ lens.K.T
        flat = (seen[..., :2] / np.maximum(seen[..., 2:], 1e-3)).reshape(-1, 2)
        low, high = flat.min(0), flat.max(0)
        grown = (1.0 if seek else 0.1) * (high - low).max()
        low, high = low - grown, high + grown
        side = MARGIN * float((high - low).max())
        left, top = (low + high - side) / 2
        window = Window(float(left), float(top), side, lens=lens)
        (x, y), (w, h) = low.tolist(), (high - low).tolist()
        place = Place((x, y, w, h))
        alone = np.ptp((points + middles[0]) @ lens.K.T / middles[0, 2], axis=0)[:2]

        # -1.5: chosen on generated videos; on stills of HOPE it is no clear gain
        most = -1.5 if len(stages) > 1 else math.inf

        def picture_of(pixels: int) -> Picture:
            size = round(pixels * side / alone.max())
            picture = self._picture(pyramid, window, place, size)
            return replace(picture, size=tuple(alone * size / side), most_surroundings=most)

        poses = Poses(*contiguous(window.turn @ turns, middles @ window.turn.T), np.zeros(len(expected)))
        if seek:
            picture = picture_of(VIEW_PIXELS)
            reach = max(w, h) / 2 - alone.max() / 2
            grid = (np.arange(-reach, reach, alone.max() / 4) + side / 2) * len(picture.seen) / side
            places = np.stack(np.meshgrid(grid, grid), -1).reshape(-1, 2)
            about = self.views.about(picture, poses.rotations[0], float(middles[0, 2]), places)
            poses = about.beside(poses.matrices)
        elif len(stages) > 1:
            picture = picture_of(ALIGN_PIXELS)
            poses = poses.beside(np.stack([align(self.surface, picture, each) for each in poses.matrices]))
        for stage in stages:
            picture = picture_of(stage.pixels)
            ranking = replace(stage, count=len(poses.scores), evaluations=0, lag=math.inf)
            poses = poses.refine(self.surface, picture, ranking).refine(self.surface, picture, stage)
        poses = poses[:1]
        back = window.turn.T
        pose = np.eye(4)
        pose[:3, :3] = back @ poses.rotations[0]
        pose[:3, 3] = back @ poses.translations[0] - pose[:3, :3] @ self.surface.middle
        return *self._fit(pyramid, window, place, poses, lens, None), pose

    def _search(
        self, pyramid: ImagePyramid, window: Window, place: Place, told: Hints
    ) -> tuple[Poses, int | None]:
        """Return poses before the window's camera, the best first, and how many keypoints this one explains;
        None where they were not sought.
        """

        def picture_of(pixels: int) -> Picture:
            return self._picture(pyramid, window, place, round(MARGIN * pixels))

        if told.pose is not None:
            turn, shift = told.pose[:3, :3], told.pose[:3, 3]
            rotation, middle = window.turn @ turn, window.turn @ (turn @ self.surface.middle + shift)
            poses = Poses(*contiguous(rotation[None], middle[None]), np.zeros(1))
            return locate(self.surface, poses, picture_of), None
        agrees = partial(_agrees, told.views())
        poses = self.views.candidates(picture_of(VIEW_PIXELS), agrees)
        if self.surface.one_colour or not Keypoints.available():
            return locate(self.surface, poses, picture_of), None
        # Longer side of the object's box in which keypoints are sought, and poses of these that begin the
        # search.
        keypoint_pixels, most_starts = 300, 8
        matches = self._matches(picture_of(keypoint_pixels))
        starts = np.array([each.pose for each in matches.poses()[:most_starts]]).reshape(-1, 4, 4)
        starts = starts[agrees(starts[:, :3, :3])]
        poses = locate(self.surface, poses.beside(starts), picture_of)
        poses = poses.add_keypoint_scores([len(matches.agreeing(pose)) for pose in poses.matrices])
        return poses, len(matches.agreeing(poses[:1].matrices[0]))

    def _matches(self, picture: Picture) -> Matches:
        """Return the matches of what a picture may show of the object, before the picture's camera."""
        n, (rows, columns) = len(picture.seen), picture.within
        photo = Keypoints.of((picture.colour * picture.exposure).clip(0, 1))
        column, row = photo.place.astype(int).T
        shown = np.zeros((n, n), bool)
        shown[rows, columns] = picture.seen[rows, columns] > 0.5
        lens = Intrinsics.of((picture.focal, picture.focal, n / 2, n / 2), n, n)
        return Matches.of(photo[shown[row, column]], self.keypoints, lens)

    def _picture(self, pyramid: ImagePyramid, window: Window, place: Place, size: int) -> Picture:
        """Return the window at a size in pixels."""
        colour, inside = window.crop(pyramid, size)
        seen = inside.astype(np.float32)
        for mask, shown in ((place.seen, True), (place.hidden, False)):
            if mask is not None:
                picture = np.repeat((mask == shown)[:, :, None].astype(np.float32), 3, axis=2)
                seen = seen * window.crop(picture, size)[0][..., 0]
        x, y, w, h = (size * number for number in window.box_within(place.box))
        box = None if window.roll else (x, x + w, y, y + h)
        w, h = (size / window.side * number for number in place.box[2:])
        assert window.focal is not None
        colour = np.ascontiguousarray(colour, np.float32)
        focal = window.focal * size / window.side
        seen = np.ascontiguousarray(seen, np.float32)
        extent = None if place.boxed else (w, h)
        return Picture(colour, seen, place.seen is not None, focal, box, extent)

    def _fit(
        self,
        pyramid: ImagePyramid,
        window: Window,
        place: Place,
        poses: Poses,
        lens: Intrinsics,
        keypoints: int | None,
    ) -> tuple[Window, Fit, float]:
        """Return window, fit and ratio of the best of some poses before the camera of `window`.

        keypoints: How many it explains; None where they were not sought.
        """
        back = window.turn.T
        rotations, middles = back @ poses.rotations, poses.translations @ window.turn
        targets = middles + (rotations @ (self._target - self.surface.middle))
        around = self._window(rotations[0], middles[0], targets[0], lens)
        distances = np.linalg.norm(targets, axis=1)
        low, high = DISTANCE_RATIO_BOUNDS
        ratio = float(np.clip(distances[0] / self.object_class.viewing_distance, low, high))
        picture = self._picture(pyramid, around, place, IMAGE_SIZE)
        native = picture.native(self.surface)
        rotation, middle = around.turn @ rotations[0], around.turn @ middles[0]
        drawn = engine.draw_pose(self.surface.mesh, native, *contiguous(rotation, middle))
        coverage, colour, normal, inlier, light = drawn
        light[:3] -= math.log(picture.exposure)
        visible = coverage * picture.seen
        if place.seen is None and not place.whole:
            rendered = colour * np.exp(light[:3] + (normal @ light[3:])[..., None])
            prior, amodal = SPATIAL.log_prior(*coverage.shape), coverage >= 0.5
            assert SPATIAL.mask is not None
            images = np.stack([picture.colour, rendered, prior]).astype(np.float32)[:, None]
            posterior = spatial_posterior(images[0], images[1], images[2], amodal[None], SPATIAL.mask)
            visible = posterior[0] * picture.seen
        explained = print_explained(picture, coverage, colour, inlier)
        albedo, lit = _appearance(colour, coverage, light, rotation)
        assert around.focal is not None
        scale = math.log(around.focal / (FOCAL_OVER_WIDTH * around.side * ratio))
        views = [
            self._view(around, around.turn @ turn, around.turn @ target, albedo, lit, scale - math.log(far))
            for turn, target, far in zip(rotations, targets, distances / distances[0], strict=True)
        ]
        latents, framing = views[0]
        rivals, one_colour = rivals_of(poses, self.surface), self.surface.one_colour
        verdict, reason, right = judge(poses.scores, rivals, keypoints, picture.outlined, one_colour)
        height, width = pyramid.shape[:2]
        if verdict is Verdict.TRUSTED and not (0 <= lens.cx <= width and 0 <= lens.cy <= height):
            reason = f"the principal point is beside the photo of {width} x {height}: is K of another size?"
            verdict, right = Verdict.AMBIGUOUS, 0.99 * TRUSTED
        if not (visible > 0.5).any():
            verdict, reason = Verdict.FAILED, Verdict.FAILED.value
            right = right if math.isnan(right) else 0.0
        small = self._picture(pyramid, around, place, IMAGE_SIZE // 2).native(self.surface)
        sure = verdict is Verdict.TRUSTED or len(poses.scores) == 1
        deviation, framing_deviation = self._deviation(small, rotation, middle, latents, sure)
        framing_deviation[:2] *= around.focal / around.side
        gaps = (WEIGHTS.pixels * (poses.scores[0] - poses.scores)).tolist()
        fit = Fit(
            latents=latents,
            framing=framing,
            deviation=deviation,
            framing_deviation=framing_deviation,
            visible=visible.astype(np.float32),
            mask=visible > 0.5,
            mask_by_pixel=inlier > 0.5,
            coverage=coverage,
            verdict=verdict,
            reason=reason,
            confidence=right,
            mask_confidence=math.nan,
            mask_trusted=False,
            confidence_features=np.array([explained]),  # see `explained_share`
            evidence=float(WEIGHTS.pixels * poses.scores[0]),
            start_evidence=float(WEIGHTS.pixels * poses.scores[0]),
            evaluations=0,
            alternatives=tuple(OtherView(*views[number], math.nan, gaps[number]) for number in rivals),
            descent=np.concatenate([latents.to_vector(), framing[None]], axis=1),
            view_threshold=math.nan if math.isnan(right) or not picture.outlined else TRUSTED,
            position_deviation=np.zeros(3, np.float32),
        )
        return around, fit, ratio

    @property
    def _target(self) -> np.ndarray:
        """Return the point (3,) of the object at which the camera of a window looks, metres."""
        return np.array([0.0, 0.0, self.object_class.target_height])

    def _window(
        self, rotation: np.ndarray, middle: np.ndarray, target: np.ndarray, lens: Intrinsics
    ) -> Window:
        """Return the upright window whose camera looks at a target before the camera of the photo.

        The whole surface is in it, with a tenth about it.
        """
        x, y = (lens.K @ target)[:2] / target[2]
        looking = Window(float(x) - 0.5, float(y) - 0.5, 1.0, lens=lens)
        roll = view_of(looking.turn @ rotation)[2]
        looking = replace(looking, roll=roll)
        seen = ((self.surface.vertices - self.surface.middle) @ rotation.T + middle) @ looking.turn.T
        assert looking.focal is not None
        reach = looking.focal * float(np.abs(seen[:, :2] / seen[:, 2:]).max())
        return replace(looking, left=float(x) - 1.1 * reach, top=float(y) - 1.1 * reach, side=2.2 * reach)

    def _view(
        self,
        window: Window,
        rotation: np.ndarray,
        target: np.ndarray,
        albedo: np.ndarray,
        light: np.ndarray,
        scale: float,
    ) -> tuple[Latents, np.ndarray]:
        """Return the latents and framing of a pose before the window's camera."""
        azimuth, elevation, roll = view_of(rotation)
        assert window.focal is not None
        shift = window.focal * target[:2] / target[2] / window.side
        shape = np.zeros((1, self.object_class.shape_model.modes), np.float32)
        angles = np.array([[azimuth], [elevation]], np.float32)
        latents = Latents(shape, angles[0], angles[1], albedo, light)
        return latents, np.array([*shift, scale, roll], np.float32)

    def _deviation(
        self, photo: Any, rotation: np.ndarray, middle: np.ndarray, latents: Latents, sure: bool
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return deviations of latents (P,) and framing (4,) from the curvature of the score at a pose.

        Shifts are in shares of the distance. `sure`: whether the pose is known but for these.
        """
        moves = np.concatenate([np.zeros((1, 6)), np.diag(STEPS), -np.diag(STEPS)])
        turned = small_turns(moves[:, :3]) @ rotation
        moved = middle + moves[:, 3:] * middle[2]
        moved[:, :2] *= moved[:, 2:] / middle[2]
        *_, scores = engine.refine_poses(
            self.surface.mesh, photo, *contiguous(turned, moved), 0, (0.0, 0.0, 0.0), 1
        )
        curvature = (2 * scores[0] - scores[1:7] - scores[7:]) / STEPS**2
        about_x, about_y, about_z, x, y, z = 1 / np.sqrt(
            np.maximum(WEIGHTS.pixels * curvature, 1 / (3 * STEPS) ** 2)
        )
        layout = latent_layout(latents.shape.shape[1])
        deviation = np.zeros(layout.size, np.float32)
        level = max(math.cos(float(latents.elevation[0])), 0.2)
        deviation[layout["azimuth"]] = min(about_y / level, UNIFORM_TURN) if sure else UNIFORM_TURN
        deviation[layout["elevation"]] = about_x
        return deviation, np.array([x, y, z, about_z], np.float32)


def assumed_lens(width: int, height: int) -> Intrinsics:
    """Return the lens of a photo of which none is known."""
    return Intrinsics.of(0.9 * max(width, height), width, height)  # that of phones and webcams


def _agrees(view: tuple[float | None, ...], rotations: np.ndarray) -> np.ndarray:
    """Return which of rotations (N, 3, 3) camera_from_object are near a view's known angles: (N,) bool."""
    if view == (None, None, None):
        return np.ones(len(rotations), bool)
    angles = view_of(np.moveaxis(rotations, 0, 2))
    off = [angle_difference(mine, told) for mine, told in zip(angles, view, strict=True) if told is not None]
    return np.asarray((np.abs(off) < DISTINCT).all(0))


def _appearance(
    colour: np.ndarray, coverage: np.ndarray, light: np.ndarray, rotation: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return one albedo (1, 3) and light (1, 9) in place of a texture, gains and a slope of log colours.

    light: (6,) log gains of the channels, and the slope along the normal in the camera's frame; reflected
    light is then about gain x (1 + slope . normal).
    """
    weight = coverage / max(float(coverage.sum()), 1e-6)
    gain = np.exp(light[:3])
    seen = (colour * weight[..., None]).sum((0, 1)) * gain
    level = max(float(gain.mean()), 1e-3)
    albedo = (seen / level).clip(0.0, 1.0)
    slope = rotation.T @ light[3:]  # in the object's frame
    lit = np.zeros(L_COUNT)
    # For a normal (x, y, z) it is L00 Y00 + 2 / 3 (L1-1 y + L10 z + L11 x) Y1, see `vig.scene.light`.
    lit[0] = level / Y00
    lit[1:4] = level * slope[[1, 2, 0]] / (COSINE_LOBE[1] * Y1)
    return albedo[None].astype(np.float32), lit[None].astype(np.float32)

"""A causal tracker: each frame's pose from that frame and those before it."""

import math
import time
from collections import deque
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from vig.explainer import Box, Explainer, Photo
from vig.explanation import Explanation
from vig.hints import Hints, check_hints
from vig.inference.settings import UNIFORM_TURN, Verdict
from vig.io.errors import UserError
from vig.known_object import Keypoints, PoseFollower, WholePhoto, explained_share
from vig.parallel import on_one_core
from vig.photo import ImagePyramid
from vig.photo.images import coded_photo
from vig.photo.lens import camera_as_shown, check_camera
from vig.photo.pinhole import pose_covariance
from vig.scene import Camera, ObjectClass
from vig.scene.camera import FOCAL_OVER_WIDTH
from vig.video.following import Follower, Sighting
from vig.video.smoothing import LikeliestPath
from vig.video.trajectory import FAR, FramePose, Trajectory, azimuth_off, camera_before, view_evidence
from vig_renderer.defaults import with_default_settings

MEMORY = 24  # frames whose numbers are smoothed for the pose in the last one
GIVEN_UP = 8  # frames without the object after which it is sought in the whole frame
ALIKE = np.array([2.6, 1.3, 1.0, 1.0, 1.0, 1.3])
"""Factors of the smoothed deviations of azimuth, elevation, place, size and roll, so that for the angles
90 % intervals held on videos of the validation split."""


@dataclass(frozen=True, eq=False)
class TrackedPose(FramePose):
    """A `Tracker`'s pose of a frame of H x W pixels.

    Attributes:
        covariance: (6, 6) of `camera_from_object`: x, y, z in metres, then turns about these axes in radians.
        seconds: Duration of the step.
        explanation: Explanation of the frame by itself, near the pose where this one is surer.
    """

    covariance: np.ndarray
    seconds: float
    explanation: Explanation

    @property
    def amodal(self) -> np.ndarray:
        """Return all pixels (H, W) bool that the object covers, hidden ones included."""
        return self.explanation.amodal

    @property
    def mask(self) -> np.ndarray:
        """Return the pixels (H, W) bool in which the object is seen; made when they are first asked for."""
        return self.explanation.mask


@with_default_settings
class Tracker:
    """Tracker of one object in the frames of a camera, each pose from the frames before it alone.

    Example:
        ```python
        tracker = vig.Tracker("mug", K=(800, 800, 320, 240))
        for frame in camera:
            pose = tracker(frame)
            print(pose.camera_from_object, pose.covariance, pose.lost)
        ```
    """

    def __init__(self, object_class: str | Path | ObjectClass | Explainer = "teapot", K: Any = None):
        """Load a class, or take an explainer.

        Args:
            object_class: A class as `Explainer` takes it, or an explainer, which has settings.
            K: Intrinsics of the camera, (3, 3) or as `Explainer.explain` takes them. Without them the focal
                length is a guess, and so are the distance and the units of the pose.

        Raises:
            UserError: There is no such class, or the camera is something else.
        """
        if not isinstance(object_class, Explainer):
            object_class = Explainer(object_class)
        self.explainer = object_class
        self._fold = max(object_class.object_class.symmetry.fold, 1)
        if K is not None:
            check_camera(K)
        self._K, self._number = K, -1
        self._follower: Follower | None = None
        self._known: PoseFollower | None = None
        self._last: float | None = None

    def __call__(self, frame: Photo) -> TrackedPose | None:
        """Return the pose in the next frame; None until the object is found in one."""
        return self.step(frame) if self._follower or self._known else self.start(frame)

    def start(
        self,
        frame: Photo,
        mask: np.ndarray | None = None,
        box: Box | None = None,
        K: Any = None,
        hints: Hints | None = None,
    ) -> TrackedPose | None:
        """Begin, or begin anew, by explaining the object as in a photo.

        Args:
            frame: A photo as `Explainer.explain` takes it; those that follow have its size.
            mask: (H, W) bool, the object's visible pixels, or
            box: x, y, width, height in pixels round the whole object; without either it is sought.
            K: Intrinsics in place of the tracker's.
            hints: Further knowledge of this frame.

        Returns:
            The pose; None where neither is given and the frame does not show the object.

        Raises:
            UserError: See `Explainer.explain`.
        """
        self._number += 1
        if (K := self._K if K is None else K) is not None:
            self._K = camera_as_shown(frame, K)
        return self._begin(coded_photo(frame), check_hints(hints, mask), box)

    def step(self, frame: Photo) -> TrackedPose:
        """Return the pose in the next frame, from that of the last.

        Raises:
            UserError: It was not started, or the frame is unreadable or of another size.
        """
        began, picture = time.perf_counter(), coded_photo(frame)
        if self._follower is None and self._known is None:
            raise UserError("expected a tracker that was started; got one that was not. Call start(frame).")
        if picture.shape[1::-1] != self._size:
            (width, height), (w, h) = self._size, picture.shape[1::-1]
            raise UserError(
                f"expected frames of one size, {width} x {height}; got one of {w} x {h}. Start again for it."
            )
        self._number += 1
        following = self._known or self._follower
        assert following is not None
        can_find = self.explainer.recognizer.has_map if self._known is None else Keypoints.available()
        if following.missed and following.missed % GIVEN_UP == 0 and can_find:
            if (pose := self._begin(picture)) is not None:
                return pose
        if self._known is not None:
            seen, found = on_one_core(partial(self._known.step, ImagePyramid(picture))), self._found
            if seen is not None:
                window, fit, ratio = seen
                found = replace(found, window=window, fit=fit, camera_distance_ratio=ratio)
            found = replace(found, picture=picture)
            return self._known_pose(found, began)
        assert self._follower is not None
        explanation, sighting = self._follower.explain(picture)
        return self._pose(picture, explanation, sighting, began)

    def _begin(
        self, picture: np.ndarray, hints: Hints | None = None, box: Box | None = None
    ) -> TrackedPose | None:
        """Start in a picture (H, W, 3)."""
        began = time.perf_counter()
        if (known := self.explainer.known) is not None and known.is_followed(hints or Hints()):
            if hints is None and box is None:
                lens = None if self._K is None else (self._K, "given")
                look = partial(self.explainer.find_and_explain, WholePhoto(picture), lens, 1)
                seen = on_one_core(look)
                if not seen or seen[0].verdict is Verdict.ABSENT:
                    return None
                explanation = seen[0]
            else:
                explanation = self.explainer.explain(picture, box=box, hints=hints, K=self._K)
            assert explanation.window.lens is not None
            pose = explanation.camera_from_object
            usual = explained_share(explanation.fit)
            self._known = PoseFollower(known, explanation.window.lens, pose, usual)
            self._size = picture.shape[1], picture.shape[0]
            return self._known_pose(explanation, began)
        follower = Follower(self.explainer, hints=hints, camera=self._K)
        explanation, sighting = follower.explain(picture, box)
        if sighting.lost and hints is None and box is None:
            return None
        window, (height, width) = explanation.window, picture.shape[:2]
        if self._K is None:
            focal = explanation.camera_distance_ratio * FOCAL_OVER_WIDTH * window.side
            follower.camera = self._matrix = np.array(
                [[focal, 0, width / 2], [0, focal, height / 2], [0, 0, 1]]
            )
        else:
            assert window.lens is not None
            self._matrix = window.lens.K
        self._size, self._distance_known = (width, height), explanation.distance_known
        follower.hints = None
        follower.place = sighting.place if follower.place is None else follower.place
        self._follower, self._nothing_seen = follower, True
        self._seen: tuple[list[Sighting], np.ndarray, Explanation] | None = None
        return self._pose(picture, explanation, sighting, began)

    def _known_pose(self, explanation: Explanation, began: float) -> TrackedPose:
        """Return a known object's pose in the last frame, or in the last one that showed it."""
        lost = self._known is not None and self._known.missed > 0
        if not lost:
            self._found = explanation
        found, number = self._found, self._number
        here, seconds = Sighting.of(found), time.perf_counter() - began
        return TrackedPose(
            number,
            found.azimuth_deg,
            math.degrees(here.azimuth_deviation),
            found.elevation_deg,
            math.degrees(here.elevation_deviation),
            found.camera,
            None if lost else here.hidden,
            lost,
            found.pinhole_pose()[2],
            seconds,
            explanation,
        )

    def _pose(
        self, picture: np.ndarray, explanation: Explanation, sighting: Sighting, began: float
    ) -> TrackedPose:
        """Return the pose of the last frame by all frames."""
        assert self._follower is not None
        if self._nothing_seen and (self._seen is None or not sighting.lost):
            self._views, self._last = LikeliestPath(MEMORY), None
            self._sightings: deque[tuple[Sighting, ...]] = deque(maxlen=MEMORY)
            self._nothing_seen = sighting.lost
        if self._follower.missed < MEMORY:  # else the last numbers stay
            self._views.add(view_evidence(sighting, self._fold))
            # One frame at least must count.
            self._sightings.append((sighting if self._sightings else replace(sighting, lost=False),))
        path = self._views.angles(self._last)
        self._last, path = float(path[-1]), path / self._fold
        if self._seen is None or not sighting.lost:
            trajectory = Trajectory.of(self._fits(path), path, self._fold)
            if not sighting.lost and trajectory.contradicts(-1, sighting, self._fold):
                self._sightings[-1] = sighting, *self._near(path[-1], explanation)
                trajectory = Trajectory.of(self._fits(path), path, self._fold)
            self._seen = self._fits(path), path, explanation
        else:  # from all that was seen, however long ago
            (fits, path, _), gone = self._seen, min(self._follower.missed, MEMORY)
            path = np.append(path, np.full(gone, path[-1]))
            trajectory = Trajectory.of([*fits, *[sighting] * gone], path, self._fold)
        numbers, deviations = trajectory.numbers[:, :6, -1]
        before = trajectory.numbers[0, 0, -2] if len(path) > 1 else numbers[0]
        self._follower.view = 2 * numbers[0] - before, numbers[1]
        deviations *= ALIKE
        deviations[0] = min(deviations[0], UNIFORM_TURN / self._fold)
        camera, covariance = self._camera_and_covariance(numbers, deviations, self._seen[2])
        return TrackedPose(
            number=self._number,
            azimuth_deg=math.degrees(numbers[0]) % (360 / self._fold),
            azimuth_deviation_deg=math.degrees(deviations[0]),
            elevation_deg=math.degrees(numbers[1]),
            elevation_deviation_deg=math.degrees(deviations[1]),
            camera=camera,
            hidden_fraction=self._sightings[-1][-1].hidden,
            lost=sighting.lost,
            covariance=covariance,
            seconds=time.perf_counter() - began,
            explanation=explanation,
        )

    def _near(self, azimuth: float, explanation: Explanation) -> list[Sighting]:
        """Return the sighting of the alternative nearest to an azimuth, if it is of that view."""
        views = explanation.fit.alternatives
        off = [abs(azimuth_off(float(view.latents.azimuth[0]), azimuth, self._fold)) for view in views]
        if not off or min(off) > FAR:
            return []
        view = views[int(np.argmin(off))]
        fit = replace(explanation.fit, latents=view.latents, framing=view.framing)
        return [Sighting.of(replace(explanation, fit=fit))]

    def _fits(self, path: np.ndarray) -> list[Sighting]:
        """Select for each frame in memory the fit that is nearer to the likeliest view in `path` (T,)."""

        def nearest(fits: tuple[Sighting, ...], at: float) -> Sighting:
            return min(fits, key=lambda fit: abs(azimuth_off(fit.azimuths[0], at, self._fold)))

        return list(map(nearest, self._sightings, path))

    def _camera_and_covariance(
        self, numbers: np.ndarray, deviations: np.ndarray, explanation: Explanation
    ) -> tuple[Camera, np.ndarray]:
        """Return the frame's camera, and the covariance (6, 6) of the pose before it.

        numbers: (6,) azimuth, elevation, middle, scale and roll, see `Trajectory`; deviations: (6,) of these.
        """
        matrix, focal = self._matrix, math.sqrt(self._matrix[0, 0] * self._matrix[1, 1])
        units = np.array([1.0, 1.0, focal, focal, 1.0, 1.0])

        def pose_of(numbers: np.ndarray) -> tuple[Camera, np.ndarray]:
            return camera_before(matrix, self._size, explanation.camera.target_height, units * numbers)

        camera, here = pose_of(numbers / units)
        covariance = pose_covariance(lambda at: pose_of(at)[1], numbers / units, deviations / units)
        covariance[:3, :3] += explanation.position_covariance(here, self._distance_known)
        return camera, covariance

"""The object from frame to frame: each frame is explained at the object's expected place."""

import math
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from vig.explainer import Box, Explainer, Photo
from vig.explanation import Explanation
from vig.hints import Hints
from vig.inference import ExpectedStart, Verdict
from vig.inference.presence import MIN_PRESENT
from vig.parallel import on_one_core
from vig.photo import Window
from vig.photo.checks import MIN_SIDE
from vig.photo.images import coded_photo
from vig.photo.pinhole import project, turned_pose
from vig.recognition import Prediction, find
from vig.scene import Camera, latent_layout, rotate_z

MAX_HIDDEN = 0.85  # share hidden from which a frame does not locate the object
SLOWING = 0.9  # factor of the speed for each frame without the object


@dataclass(frozen=True)
class Sighting:
    """The kept part of a frame's explanation; angles in radians.

    Attributes:
        window: Window in which it was fitted.
        camera: Camera of the whole frame, as one that looks straight at the object.
        azimuths: (N,) of the fit, and of the alternatives.
        probabilities: (N,) that each is right.
        azimuth_deviation: Standard deviation of the fit's azimuth.
        elevation: Elevation of the fit.
        elevation_deviation: Standard deviation of the elevation.
        place: (3,) centre x, y and log of the longer side of the box of the whole object, pixels.
        hidden: Share hidden; None where the object is nowhere in the frame.
        albedo: (3,) linear RGB.
        shape: (K,) coefficients.
        lost: Whether the frame does not locate the object.
        network: (bins,) the network's probabilities of the views of the circle; None where it is not used.
    """

    window: Window
    camera: Camera
    azimuths: np.ndarray
    probabilities: np.ndarray
    azimuth_deviation: float
    elevation: float
    elevation_deviation: float
    place: np.ndarray
    hidden: float | None
    albedo: np.ndarray
    shape: np.ndarray
    lost: bool
    network: np.ndarray | None = None

    @staticmethod
    def of(explanation: Explanation, network: np.ndarray | None = None) -> "Sighting":
        """Return the sighting of an explanation."""
        layout = latent_layout(explanation.object_class.shape_model.modes).split(explanation.fit.deviation)
        views, hidden = explanation.fit.alternatives, _hidden_share(explanation)
        latents = explanation.latents, *(view.latents for view in views)
        centre, size = _box_of(explanation)
        calibrated = not math.isnan(explanation.confidence)
        shares = [explanation.confidence, *(view.probability for view in views)]
        # (0.6, 0.2): probabilities of a view and of its alternatives where the class has no calibration
        return Sighting(
            window=explanation.window,
            camera=_straight(explanation),
            azimuths=np.array([float(each.azimuth[0]) for each in latents]) % math.tau,
            probabilities=np.array(
                shares if calibrated else [(0.6, 0.2)[bool(n)] for n in range(len(shares))]
            ),
            azimuth_deviation=float(layout["azimuth"][0]),
            elevation=math.radians(explanation.elevation_deg),
            elevation_deviation=float(layout["elevation"][0]),
            place=np.array([*centre, math.log(size.max())]),
            hidden=hidden,
            albedo=explanation.latents.albedo[0],
            shape=explanation.latents.shape[0],
            lost=explanation.verdict in (Verdict.FAILED, Verdict.ABSENT)
            or hidden is None
            or hidden > MAX_HIDDEN,
            network=network,
        )

    @property
    def visible_share(self) -> float:
        """Return the share of the object that is seen."""
        return 0.0 if self.hidden is None else 1 - self.hidden


@dataclass
class RunningPrediction:
    """The network's predictions of frame after frame, each seen once: every second frame as its mirror image.

    The regressed numbers, which hardly change, are averaged over the frames that showed the object.
    """

    recognizer: Any
    latest: Prediction | None = None
    numbers: np.ndarray | None = None
    mirrored: bool = False

    def __call__(self, photos: np.ndarray) -> Prediction:
        """Predict for the next frame's window (1, S, S, 3)."""
        self.mirrored = not self.mirrored
        seen: Prediction = self.recognizer(photos, sides=(self.mirrored,))
        numbers_gain = 0.3  # share of the way from the numbers predicted so far to those of a frame
        if self.numbers is not None:
            seen = replace(seen, numbers=(1 - numbers_gain) * self.numbers + numbers_gain * seen.numbers)
        self.latest = seen
        return seen

    def keep(self) -> None:
        """Keep the latest frame, which showed the object."""
        if self.latest is not None:
            self.numbers = self.latest.numbers


def window_at(place: np.ndarray, roll: float) -> Window:
    """Return the window of a `Sighting.place` (3,), turned by radians."""
    side = math.exp(place[2])
    return Window.round_box((place[0] - side / 2, place[1] - side / 2, side, side), roll)


@dataclass
class Follower:
    """Explains frame after frame; see `track` for the arguments.

    Attributes:
        camera: Camera of all frames in place of a focal length, see `Explainer.explain`.
        place: Expected place of the object, as `Sighting.place`; None before it was seen.
        speed: (2,) of its centre, pixels a frame.
        roll: Roll of the window, radians.
        albedo: Albedo of the object so far; None before it was seen.
        missed: Number of frames since it was last seen.
        view: Azimuth and elevation, radians, that are expected in the next frame: it is then fitted from
            these and from the network's prediction, in less time. If None, it is fitted as a photo.
        latest: The last explanation that showed the object.
    """

    explainer: Explainer
    focal: float | None = None
    hints: Hints | None = None
    camera: Any = None
    place: np.ndarray | None = None
    speed: np.ndarray = field(default_factory=lambda: np.zeros(2))
    roll: float = 0.0
    albedo: np.ndarray | None = None
    missed: int = 0
    view: tuple[float, float] | None = None
    latest: Explanation | None = None

    def __post_init__(self) -> None:
        self.predict = RunningPrediction(self.explainer.recognizer)

    def explain(self, frame: Photo, box: Box | None = None) -> tuple[Explanation, Sighting]:
        """Explain the next frame; box: round the object in it, where it was not seen before."""
        if self.place is None:
            explanation = self.explainer.explain_frame(frame, None, self.focal, self.hints, self.camera, box)
            sighting = Sighting.of(explanation)
            if not sighting.lost:
                self.place, self.roll, self.albedo = sighting.place, sighting.camera.roll, sighting.albedo
                self.latest = explanation
            if box is not None:  # whatever is visible there: the object may be hidden from the start
                x, y, w, h = box
                self.place = np.array([x + w / 2, y + h / 2, math.log(max(w, h))])
                # 0.5: probability of the view in the first frame from which the colour in its box is taken
                # for the object's
                self.albedo = self.albedo if sighting.probabilities[0] > 0.5 else None
            return explanation, sighting
        self.place = self.place + [*self.speed, 0.0]
        explanation, sighting = self._at(frame, window_at(self.place, self.roll))
        # Frames without the object of which a tracker seeks it in one, which takes longer than a step.
        seek_every = 3
        seek = self.view is None or self.missed % seek_every == seek_every - 1
        found = self._find_again(frame, self.place) if seek and not self._is_object(sighting) else None
        if found is not None:
            again = self._at(frame, found)
            if self._is_object(again[1]):
                explanation, sighting = again
        if self._is_object(sighting):
            self._update(sighting)
            self.predict.keep()
            self.latest = explanation
            return explanation, sighting
        self.missed += 1
        self.speed = SLOWING * self.speed
        return explanation, replace(sighting, lost=True)

    def _at(self, frame: Photo, window: Window) -> tuple[Explanation, Sighting]:
        explanation = self.explainer.explain_frame(
            frame, window, self.focal, self.hints, self.camera, expected=self._expected_start(window)
        )
        seen = self.predict.latest
        return explanation, Sighting.of(explanation, None if seen is None else seen.azimuth[0])

    def _expected_start(self, window: Window) -> ExpectedStart | None:
        """Return the latest fit, turned to the expected view, at the expected place."""
        if self.view is None or self.latest is None or self.place is None:
            return None
        azimuth, elevation = (np.array([angle], np.float32) for angle in self.view)
        fitted, (_, size) = self.latest.latents, _box_of(self.latest)
        light = rotate_z(fitted.light, azimuth - fitted.azimuth)  # the camera's: it is the object that turns
        x, y = window.to_window(*self.place[:2].tolist())
        w, h = (size / size.max() * math.exp(self._side)).tolist()
        box = (x - w / 2, y - h / 2, w, h)
        left, top, wide, high = (number / window.side for number in box)
        latents = replace(fitted, azimuth=azimuth, elevation=elevation, light=light)
        return ExpectedStart(latents, (left + 0.5, top + 0.5, wide, high), self.predict)

    def _find_again(self, frame: Photo, place: np.ndarray) -> Window | None:
        """Return the window of an object near the predicted place, if it is surely there."""
        if not self.explainer.recognizer.has_map:
            return None
        # 3.0: sides of the square about the predicted place in which a lost object is sought
        photo, half = coded_photo(frame), 3.0 / 2 * math.exp(place[2])
        left, top, right, bottom = (
            max(0, int(middle + side)) for side in (-half, half) for middle in place[:2]
        )
        part = photo[top:bottom, left:right]
        if min(part.shape[:2]) < MIN_SIDE:
            return None
        best = on_one_core(lambda: find(part, self.explainer.recognizer))
        window = replace(best.window, left=best.window.left + left, top=best.window.top + top)
        return window if best.present >= MIN_PRESENT else None

    def _is_object(self, sighting: Sighting) -> bool:
        """Return whether the sighting may be of the object: near the prediction, as large, of its colour."""
        # 0.2: share by which each frame without the object widens these
        # 2.0: factor to which they are widened at most
        off, wider = sighting.place - self.place, min(1 + 0.2 * self.missed, 2.0)
        # 0.8: probability of a view from which an object in the place is the right one whatever its colour:
        # the colour of the frames before may be that of an occluder
        # 0.35, 0.4: sides of the predicted box, and log of its side, by which another object is off it
        return (
            not sighting.lost
            and math.hypot(*off[:2]) < wider * 0.35 * math.exp(self._side)
            and abs(off[2]) < wider * 0.4
            and (self._has_its_colour(sighting) or float(sighting.probabilities[0]) > 0.8)
        )

    def _has_its_colour(self, sighting: Sighting) -> bool:
        if self.albedo is None:
            return True
        apart = np.log(sighting.albedo + 0.05) - np.log(self.albedo + 0.05)  # dark ones are alike
        return float(np.sqrt(np.square(apart).mean())) < 0.5  # in logs

    @property
    def _side(self) -> float:
        assert self.place is not None
        return float(self.place[2])

    def _update(self, sighting: Sighting) -> None:
        """Update the track by a sighting, weighted by the square of its visible share."""
        assert self.place is not None
        sure, off = sighting.visible_share**2, sighting.place - self.place
        # Shares of the way from the predicted numbers to the frame's, where all of the object is visible
        self.place = self.place + sure * np.array([0.7, 0.7, 0.4]) * off
        self.speed = self.speed + sure * 0.2 * off[:2]
        self.roll += sure * 0.3 * (sighting.camera.roll - self.roll)
        albedo_so_far = self.albedo if self._has_its_colour(sighting) else None
        albedo_so_far = sighting.albedo if albedo_so_far is None else albedo_so_far
        self.albedo = albedo_so_far + sure * 0.2 * (sighting.albedo - albedo_so_far)
        self.missed = 0


def _box_of(explanation: Explanation) -> tuple[np.ndarray, np.ndarray]:
    """Return centre and size (2,) of the box of an explanation's vertices in the frame, or beyond it."""
    pixels = project(explanation.camera.K, explanation.camera_from_object, explanation.vertices)[:, :2]
    least, most = pixels.min(0), pixels.max(0)
    return (least + most) / 2, most - least


def _hidden_share(explanation: Explanation) -> float | None:
    """Return `Explanation.hidden_fraction` by the pixels of the window, which is quicker."""
    fit, window, (height, width) = explanation.fit, explanation.window, explanation.picture.shape[:2]
    size = len(fit.coverage)
    offsets = ((np.arange(size) + 0.5) / size - 0.5) * window.side
    x, y = window.to_photo(*np.meshgrid(offsets, offsets))
    covered = (fit.coverage >= 0.5) & (x >= 0) & (x < width) & (y >= 0) & (y < height)
    count = int(covered.sum())
    return 1 - int((covered & (fit.visible >= 0.5)).sum()) / count if count else None


def _straight(explanation: Explanation) -> Camera:
    """Return the camera looking straight at the object, as if the frame were cut from a larger one about it.

    `turned_pose` leads back to the pose before the frame's own.
    """
    camera, pose = explanation.camera, explanation.camera_from_object
    if camera.mount is None:
        return camera
    point = pose[:3, :3] @ [0.0, 0.0, camera.target_height] + pose[:3, 3]
    cx, cy, _ = (camera.K @ point / point[2]).tolist()
    focal = math.sqrt(camera.K[0, 0] * camera.K[1, 1])
    straight = replace(
        camera, focal=focal, focal_y=None, cx=cx, cy=cy, distance=float(point[2]), mount=None, roll=0.0
    )
    level = straight.camera_from_object(explanation.latents)
    roll = turned_pose(straight, level, camera.K)[:3, :3].T @ pose[:3, :3]  # in the object's frame
    roll = level[:3, :3] @ roll @ level[:3, :3].T
    return replace(straight, roll=math.atan2(roll[1, 0], roll[0, 0]))

"""Follows the object from frame to frame: each frame is explained where the object is expected."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace

import numpy as np

from vig.explainer import SURELY_FOUND, Box, Explainer, Photo
from vig.explanation import Explanation
from vig.hints import Hints
from vig.inference import Verdict
from vig.parallel import on_one_core
from vig.photo import Window
from vig.photo.images import MIN_SIDE, coded_photo
from vig.recognition import find
from vig.scene import Camera, latent_layout

MOST_HIDDEN = 0.85
"""Share hidden from which a frame does not tell where the object is."""
AWAY, OTHER_SIZE, OTHER_COLOUR = 0.35, 0.4, 0.5
"""From the predicted box: in its sides, in logs of its side, in logs of albedo. Farther is another object."""
WIDENED, WIDEST = 0.2, 2.0
"""By how much each frame without the object widens these, and to what factor."""
GAIN, SPEED_GAIN, SIZE_GAIN, ROLL_GAIN, COLOUR_GAIN = 0.7, 0.2, 0.4, 0.3, 0.2
"""Of a frame in which all is seen."""
SLOWING = 0.9
"""Of the speed for each frame without the object."""
LEAST_SURE = 0.5
"""Probability of the view in the first frame from which the colour in its box is taken for the object's."""
SOUGHT = 3.0
"""Sides of the square about the predicted place in which a lost object is sought."""
NO_CONFIDENCE = (0.6, 0.2)
"""Probabilities of a view and of its alternatives where the class has no calibration."""


@dataclass(frozen=True)
class Sighting:
    """What is kept of a frame's explanation; angles in radians.

    Attributes:
        window: In which it was fitted.
        camera: Of the whole frame.
        azimuths: (N,) of the fit, and of the alternatives.
        probabilities: (N,) that each is right.
        azimuth_deviation: Standard deviation.
        elevation: Of the fit.
        elevation_deviation: Likewise.
        place: (3,) centre x, y and log of the longer side of the box of the whole object, pixels.
        hidden: Share hidden; None where the object is nowhere in the frame.
        albedo: (3,) linear RGB.
        shape: (K,) coefficients.
        lost: Whether the frame does not tell where the object is.
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

    @staticmethod
    def of(found: Explanation) -> Sighting:
        """What an explanation says."""
        layout = latent_layout(found.object_class.shape_model.modes).split(found.fit.deviation)
        views, hidden = found.alternatives, found.hidden_fraction
        calibrated = not math.isnan(found.confidence)
        shares = [found.confidence, *(view.probability for view in views)]
        return Sighting(
            window=found.window,
            camera=found.camera,
            azimuths=np.radians([found.azimuth_deg, *(view.azimuth_deg for view in views)]),
            probabilities=np.array(
                shares if calibrated else [NO_CONFIDENCE[bool(n)] for n in range(len(shares))]
            ),
            azimuth_deviation=float(layout["azimuth"][0]),
            elevation=math.radians(found.elevation_deg),
            elevation_deviation=float(layout["elevation"][0]),
            place=_place_of(found),
            hidden=hidden,
            albedo=found.latents.albedo[0].numpy(),
            shape=found.latents.shape[0].numpy(),
            lost=found.verdict in (Verdict.FAILED, Verdict.ABSENT) or hidden is None or hidden > MOST_HIDDEN,
        )

    @property
    def seen(self) -> float:
        """Share of the object that is seen."""
        return 0.0 if self.hidden is None else 1 - self.hidden


def window_at(place: np.ndarray, roll: float) -> Window:
    """The window of a `Sighting.place` (3,), turned by radians."""
    side = math.exp(place[2])
    return Window.round_box((place[0] - side / 2, place[1] - side / 2, side, side), roll)


@dataclass
class Follower:
    """Explains frame after frame; see `track` for what is given.

    Attributes:
        place: Where the object is expected, as `Sighting.place`; None before it was seen.
        speed: (2,) of its centre, pixels a frame.
        roll: Of the window, radians.
        albedo: Of the object so far; None before it was seen.
        missed: Number of frames since it was last seen.
    """

    explainer: Explainer
    focal: float | None = None
    hints: Hints | None = None
    place: np.ndarray | None = None
    speed: np.ndarray = field(default_factory=lambda: np.zeros(2))
    roll: float = 0.0
    albedo: np.ndarray | None = None
    missed: int = 0

    def explain(self, frame: Photo, box: Box | None = None) -> tuple[Explanation, Sighting]:
        """Explain the next frame; box: round the object in it, where it was not seen before."""
        if self.place is None:
            found = self.explainer.explain_followed(frame, None, self.focal, self.hints, box=box)
            seen = Sighting.of(found)
            if not seen.lost:
                self.place, self.roll, self.albedo = seen.place, seen.camera.roll, seen.albedo
            if box is not None:  # whatever is seen there: the object may be hidden from the start
                x, y, w, h = box
                self.place = np.array([x + w / 2, y + h / 2, math.log(max(w, h))])
                self.albedo = self.albedo if seen.probabilities[0] > LEAST_SURE else None
            return found, seen
        self.place = self.place + [*self.speed, 0.0]
        found, seen = self._at(frame, window_at(self.place, self.roll))
        if not self._is_object(seen) and (window := self._found_again(frame, self.place)) is not None:
            again = self._at(frame, window)
            if self._is_object(again[1]):
                found, seen = again
        if self._is_object(seen):
            self._update(seen)
            return found, seen
        self.missed += 1
        self.speed = SLOWING * self.speed
        return found, replace(seen, lost=True)

    def _at(self, frame: Photo, window: Window) -> tuple[Explanation, Sighting]:
        found = self.explainer.explain_followed(frame, window, self.focal, self.hints)
        return found, Sighting.of(found)

    def _found_again(self, frame: Photo, place: np.ndarray) -> Window | None:
        """The window of what is found near the predicted place, if surely."""
        photo, half = coded_photo(frame), SOUGHT / 2 * math.exp(place[2])
        left, top, right, bottom = (
            max(0, int(middle + side)) for side in (-half, half) for middle in place[:2]
        )
        part = photo[top:bottom, left:right]
        if min(part.shape[:2]) < MIN_SIDE:
            return None
        best = on_one_core(lambda: find(part, self.explainer.recognizer))
        window = replace(best.window, left=best.window.left + left, top=best.window.top + top)
        return window if best.score >= SURELY_FOUND else None

    def _is_object(self, seen: Sighting) -> bool:
        """Whether what is seen may be the object: near the predicted place, as large, of its colour."""
        off, wider = seen.place - self.place, min(1 + WIDENED * self.missed, WIDEST)
        known = seen.albedo if self.albedo is None else self.albedo
        apart = np.log(seen.albedo + 0.05) - np.log(known + 0.05)  # dark ones are alike
        return (
            not seen.lost
            and math.hypot(*off[:2]) < wider * AWAY * math.exp(self._side)
            and abs(off[2]) < wider * OTHER_SIZE
            and float(np.sqrt(np.square(apart).mean())) < OTHER_COLOUR
        )

    @property
    def _side(self) -> float:
        assert self.place is not None
        return float(self.place[2])

    def _update(self, seen: Sighting) -> None:
        """Go on from a frame, the more the more of the object it shows."""
        assert self.place is not None
        sure, off = seen.seen**2, seen.place - self.place
        self.place = self.place + sure * np.array([GAIN, GAIN, SIZE_GAIN]) * off
        self.speed = self.speed + sure * SPEED_GAIN * off[:2]
        self.roll += sure * ROLL_GAIN * (seen.camera.roll - self.roll)
        known = seen.albedo if self.albedo is None else self.albedo
        self.albedo = known + sure * COLOUR_GAIN * (seen.albedo - known)
        self.missed = 0


def _place_of(found: Explanation) -> np.ndarray:
    """`Sighting.place` of an explanation, by its vertices: beyond the frame, too."""
    pose = found.camera_from_object
    points = (found.vertices @ pose[:3, :3].T + pose[:3, 3]) @ found.camera.K.T
    pixels = points[:, :2] / points[:, 2:]
    least, most = pixels.min(0), pixels.max(0)
    return np.array([*(least + most) / 2, math.log((most - least).max())])

"""The place of a known object in a photo, the picture of it, and the weights of a pose's score in it."""

import math
from dataclasses import astuple, dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from vig.hints import Hints
from vig.inference.hints import PixelLabel
from vig.io.errors import UserError
from vig.known_object.surface import Surface
from vig_native import engine

MIN_COLOUR: float = engine.MIN_COLOUR
"""Added to colours before their logarithm: noise and haze of dark pixels."""
LOG_OTHER = -0.75 - 1.5 * math.log(2 * math.pi)
"""Log density of log colours that neither the object's surface nor the surroundings explain."""


Box = tuple[float, float, float, float]


@dataclass(frozen=True)
class Place:
    """The place of an object in a photo.

    Attributes:
        box: x, y, w, h in pixels round the whole object, as far as it is known.
        seen: (H, W) bool, its visible pixels; None where they are not known.
        hidden: (H, W) bool, pixels in which something else is seen; None where none are known.
        whole: Whether nothing hides any of the object.
        boxed: Whether the box holds the whole object, hidden parts included; else its visible part.
    """

    box: Box
    seen: np.ndarray | None = None
    hidden: np.ndarray | None = None
    whole: bool = False
    boxed: bool = True

    @staticmethod
    def of(box: Box | None, told: Hints) -> "Place":
        """Return the place that a box or hints give: without a box, that of the pixels known as visible.

        Raises:
            UserError: Nothing tells the place.
        """
        boxed = box is not None or told.visible or told.mask is None
        if box is None:
            clues = told.clues()
            if clues is None:
                raise UserError(
                    "expected a box or a mask, as no network finds this object; got neither. Give --box"
                    " x,y,w,h round the whole object, or --mask."
                )
            box = clues.box
        hidden = None if told.marks is None else told.marks == PixelLabel.IN_FRONT
        return Place(box, told.mask, hidden, told.visible, boxed)


@dataclass(frozen=True)
class ScoreWeights:
    """Weights of the parts of a pose's score, `score_pose` in vig_native/pose.h; chosen on HOPE's photos.

    Attributes:
        sigma: Standard deviation of log colours where the surface is seen.
        share: Share of such pixels; the others have a deviation of 1.
        gain_deviation: Deviation of the channels' log gains about their mean.
        slope_deviation: Deviation of the log colours' slope along the normals: light from one side.
        pixels: Independent pixels that the mean log-likelihood is worth against these priors.
        outline: Weight of the log overlap of pose and visible pixels.
        surroundings: Where these are not known, weight of the log-likelihood beyond that of the surroundings'
            colours, over the area of the box.
        unseen: Weight in it of pixels that a pose covers and that do not show the object.
        box_deviation: Deviation of the sides of the object's box, over the longer one.
    """

    sigma: float = 0.2
    share: float = 0.8
    gain_deviation: float = 0.2
    slope_deviation: float = 0.5
    pixels: float = 20.0
    outline: float = 8.0
    surroundings: float = 2.0
    unseen: float = 0.5
    box_deviation: float = 0.02

    def of_box(self, width: float, height: float) -> list[float]:
        """Return all for the native library, with the box's sides in pixels."""
        scaled = replace(
            self,
            surroundings=self.surroundings / (width * height),
            box_deviation=self.box_deviation * max(width, height),
        )
        return list(astuple(scaled))


WEIGHTS = ScoreWeights()
PLAIN_WEIGHTS = ScoreWeights(sigma=0.5, gain_deviation=1.0, outline=12.0)
"""For a mesh of one colour, as the object itself may have print of any: its outline tells more. Chosen on
every third object of HOPE under one light."""


def weights_of(surface: Surface) -> ScoreWeights:
    """Return the weights for a surface."""
    return PLAIN_WEIGHTS if surface.one_colour else WEIGHTS


@dataclass(frozen=True)
class Picture:
    """A part of a photo, as a camera that looks at its middle sees it.

    Attributes:
        colour: (n, n, 3) float32 linear RGB.
        seen: (n, n) float32, how far a pixel shows the object; where that is not known, 1 in the photo.
        outlined: Whether it is known.
        focal: Pixels.
        box: Left, right, top, bottom of the object in pixels; None where unknown, or the window is rolled.
        size: About the object's width and height in pixels where it does not fill the box but is in it.
        most_surroundings: Log density of a colour of the surroundings at most, as what covers the object is
            often seen beside it.
    """

    colour: np.ndarray
    seen: np.ndarray
    outlined: bool
    focal: float
    box: tuple[float, float, float, float] | None
    size: tuple[float, float] | None = None
    most_surroundings: float = math.inf

    @property
    def within(self) -> tuple[slice, slice]:
        """Return the rows and columns of pixels in the box."""
        height, width = self.seen.shape
        left, right, top, bottom = self.box or (0, width, 0, height)
        rows, columns = (slice(max(0, int(a)), max(0, int(b)) + 1) for a, b in ((top, bottom), (left, right)))
        return rows, columns

    @cached_property
    def exposure(self) -> float:
        """Return the factor that makes the content of the box as bright as surfaces usually are.

        Else `MIN_COLOUR` would hide the contrast of dark photos.
        """
        seen, colour = self.seen[self.within], self.colour[self.within]
        mean = float((colour.mean(2) * seen).sum() / max(float(seen.sum()), 1.0))
        return 0.2 / max(mean, 1e-4)

    @cached_property
    def surroundings(self) -> np.ndarray | None:
        """Return the log density (n, n) float32 of each log colour among those beside the box.

        None where the visible pixels are known, or there is no box.
        """
        if self.outlined or self.box is None:
            return None
        beside = self.seen.copy()
        beside[self.within] = 0
        darkest, span = math.log(MIN_COLOUR), math.log(1 + 1 / MIN_COLOUR)
        logs = np.log(self.colour.clip(0, None) * np.float32(self.exposure) + MIN_COLOUR)
        shares = (beside / max(float(beside.sum()), 1e-9))[None].astype(np.float64)
        density = engine.colour_density(((logs - darkest) / span).clip(0, 1).astype(np.float64), shares)[0]
        logs = np.log(0.8 * density / span**3 + 0.2 * math.exp(LOG_OTHER))
        return np.asarray(np.minimum(logs, self.most_surroundings), np.float32)

    @property
    def owned(self) -> np.ndarray:
        """Return how far each pixel (n, n) may show the object: `seen`, or unlike the surroundings."""
        if self.surroundings is None:
            return self.seen
        owned = np.zeros_like(self.seen)
        share = 1 / (0.8 + np.exp(self.surroundings[self.within] - LOG_OTHER))
        owned[self.within] = self.seen[self.within] * share.clip(0, 1)
        return owned

    def native(self, surface: Surface) -> Any:
        """Return it for the native library."""
        # Without a box the object is most of the picture.
        left, right, top, bottom = self.box or (0.0, 0.75 * len(self.colour)) * 2
        width, height = self.size or (right - left, bottom - top)
        middle = self.colour.shape[1] / 2
        camera = self.focal, middle, middle
        per_pixel = surface.diameter / max(width, height) / 1.5
        return engine.pose_photo(
            self.colour * np.float32(self.exposure),
            self.seen,
            camera,
            list(self.box) if self.box and self.size is None else None,
            self.surroundings,
            self.outlined,
            per_pixel,
            weights_of(surface).of_box(width, height),
        )

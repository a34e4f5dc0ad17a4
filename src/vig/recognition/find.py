"""Search of the object in a photo of any size: places of its map, tried as windows."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from vig.io.errors import UserError
from vig.photo import ImagePyramid, Window
from vig.photo.masks import box_of
from vig.photo.window import BOX_BELOW_CENTRE, SMALLEST_BOX, WINDOW_OVER_BOX
from vig.recognition.object_map import PHOTO_SIDES, SIDES_FOR_SEVERAL, box_overlap, places
from vig.recognition.prediction import Prediction
from vig.recognition.recognizer import Recognizer
from vig.scene.functions import log_odds, sigmoid

MOVED_WINDOWS = 2
"""Places that are looked at where one object is sought, and windows moved onto the objects there."""
MOVES = 2
"""Looks at each window, which is moved each time. Windows of 60 real cars overlap the true ones by .79 as
the map has them, by .95 after one move, by .97 after two."""
MIN_ROLL = math.radians(5.0)
"""Roll, as the network sees it, from which a window is turned, radians."""
UNTRAINED = (
    "expected a box or a mask of the object, as its class has no network to find it; got neither. Give --box"
    " x,y,w,h in pixels, such as 120,80,300,240, or --mask FILE; `vig class train` trains a network."
)
UNPLACED = (
    "expected a box or a mask, as the class's network has no map to find objects; got neither. Give --box"
    " x,y,w,h in pixels, such as 120,80,300,240, or --mask FILE, or train it by `vig train --map-alone`."
)
WINDOW_SIZE_DEVIATION, WINDOW_PLACE_DEVIATION = 0.35, 0.2
"""Deviations of the log of an object's size in a window over its usual one, and of its middle, in sides."""
SHOWN = 0.5
"""Predicted probability from which a pixel belongs to the object, hidden or not."""


@dataclass(frozen=True)
class Candidate:
    """A place where the object may be.

    Attributes:
        window: Window round it, turned so that it stands upright.
        present: Estimated probability that an object of the class is there: the highest of the windows that
            were looked at on the way to this one.
    """

    window: Window
    present: float


def find(
    photo: np.ndarray | ImagePyramid, recognizer: Recognizer, clues: LocationHints | None = None
) -> Candidate:
    """Return the best place of the object in a photo (H, W, 3), as `coded_photo` gives it.

    With clues only places that agree count.

    Raises:
        UserError: The recognizer cannot find objects, and no clue is a mask.
    """
    if not recognizer.has_map and clues is not None and clues.mask is not None:
        return Candidate(Window.round_box(clues.box), 1.0)
    nowhere = Candidate(Window.of(photo.shape[1], photo.shape[0]), 0.0)
    tried = _try_places(photo, recognizer, MOVED_WINDOWS, clues)
    best = max(tried, key=lambda each: each.present, default=nowhere)
    if clues is not None and clues.mask is not None:
        return replace(best, window=clues.locate_window(photo, best.window, recognizer))
    return best


def find_several(photo: np.ndarray | ImagePyramid, recognizer: Recognizer, most: int) -> list[Candidate]:
    """Return the best places of several objects in a photo, as `find` takes it: `most` at most, the best
    first.

    Raises:
        UserError: The recognizer cannot find objects.
    """
    # 3: places that are looked at for each of several objects
    return apart(_try_places(photo, recognizer, 3 * most, sides=SIDES_FOR_SEVERAL), most)


def _try_places(
    photo: np.ndarray | ImagePyramid,
    recognizer: Recognizer,
    most: int,
    clues: LocationHints | None = None,
    sides: Sequence[int] = PHOTO_SIDES,
) -> list[Candidate]:
    """Return windows round the likeliest places, `most` of them, and about clues, moved onto their objects.

    UserError for a recognizer that cannot find objects.
    """
    if not recognizer.has_map:
        raise UserError(UNPLACED if recognizer.informed else UNTRAINED)
    photo = photo if isinstance(photo, ImagePyramid) else ImagePyramid(photo)
    starts = [
        Candidate(Window.round_box(each.box), each.probability) for each in places(photo, recognizer, sides)
    ]
    if clues is not None:
        starts = [each for each in starts if clues.within(each.window)]
    # 0.1: probability of a place, over that of the likeliest, from which it is looked at
    starts = [each for each in starts[:most] if each.present >= 0.1 * starts[0].present]
    if clues is not None:
        # 0.5: probability that an object's centre is in the middle of a window about clues, as if by the map
        starts += [Candidate(window, 0.5) for window in clues.windows()]
    windows, present = [each.window for each in starts], [0.0] * len(starts)
    for _ in range(MOVES if starts else 0):
        prediction = predict_windows(photo, windows, recognizer)
        for i, start in enumerate(starts):
            seen = prediction[i : i + 1]
            agreement = 1.0 if clues is None else clues.agreement(windows[i], seen)
            present[i] = max(present[i], agreement * _present(start.present, seen))
        moved = [_move_window(window, prediction[i : i + 1]) for i, window in enumerate(windows)]
        # 0.4: overlap with the window that it began as, from which one that was moved is of the same object
        windows = [
            window
            # Not onto another object; with clues all of them must be shown.
            if (overlap(window, start.window) >= 0.4 if clues is None else clues.within(window))
            else before
            for start, before, window in zip(starts, windows, moved, strict=True)
        ]
    return list(map(Candidate, windows, present))


@dataclass(frozen=True, eq=False)
class LocationHints:
    """Knowledge of the object's place in a photo.

    Attributes:
        mask: (H, W) bool, its visible pixels, or None.
        points: (N, 2) places x, y on it, hidden ones too; N may be 0.
    """

    mask: np.ndarray | None
    points: np.ndarray

    @property
    def box(self) -> tuple[float, float, float, float]:
        """Return x, y, w, h round all known places."""
        corners = [self.points]
        if self.mask is not None and (box := box_of(self.mask)) is not None:
            corners.append(np.array([box[:2], np.add(box[:2], box[2:])], float))
        places = np.concatenate(corners)
        (left, top), (right, bottom) = places.min(0), places.max(0)
        return float(left), float(top), float(right - left), float(bottom - top)

    def windows(self) -> list[Window]:
        """Return windows about the known places, as if these were all of it, and larger ones for hidden
        parts.
        """
        x, y, w, h = self.box
        side = max(w, h, float(SMALLEST_BOX))
        x, y = x + w / 2, y + h / 2
        # (1.0, 1.25, 1.6, 2.2): boxes of the object over those of its known parts
        sides = [side * grown for grown in (1.0, 1.25, 1.6, 2.2)]
        return [Window.round_box((x - s / 2, y - s / 2, s, s)) for s in sides]

    def within(self, window: Window) -> bool:
        """Return whether a window shows all known places."""
        x, y, w, h = self.box
        corners = [window.to_window(x + right * w, y + down * h) for right in (0, 1) for down in (0, 1)]
        return max(max(map(abs, corner)) for corner in corners) <= window.side / 2

    def locate_window(
        self, photo: np.ndarray | ImagePyramid, window: Window, recognizer: Recognizer
    ) -> Window:
        """Return the window of the object's box: that of the known parts, with those the network sees hidden.

        window: One that shows the object.
        """
        x, y, w, h = self.box
        whole = box_in_window(predict_windows(photo, [window], recognizer))
        if whole is not None:
            left, top = whole[0] - 0.5, whole[1] - 0.5
            corners = [
                window.to_photo(window.side * (left + across), window.side * (top + down))
                for across in (0.0, whole[2])
                for down in (0.0, whole[3])
            ]
            low = np.minimum(np.min(corners, axis=0), (x, y))
            high = np.maximum(np.max(corners, axis=0), (x + w, y + h))
            # 1.15: longer side of the object, as the network sees it, over that of a mask, from which the
            # rest is hidden
            if max(high - low) > 1.15 * max(w, h):
                (x, y), (w, h) = low.tolist(), (high - low).tolist()
        return upright(photo, Window.round_box((x, y, w, h)), recognizer)

    def agreement(self, window: Window, prediction: Prediction) -> float:
        """Return the degree, 0 to 1, to which the prediction for a window agrees with the marks."""
        if not self.within(window):
            return 0.0
        if self.mask is None:
            return 1.0
        grey = np.repeat(self.mask[:, :, None].astype(np.float32), 3, axis=2)
        marked = window.crop(grey)[0][..., 0] > 0.5
        predicted_visible = prediction.mask[0, :, :, 0] > SHOWN
        union = int((marked | predicted_visible).sum())
        return int((marked & predicted_visible).sum()) / union if union else 0.0


def apart(candidates: Iterable[Candidate], most: int) -> list[Candidate]:
    """Return the best candidates, `most` of them, no two of the same place."""
    separate: list[Candidate] = []
    for each in sorted(candidates, key=lambda each: -each.present):
        # 0.5: overlap from which windows count as one object's: those of two that hide one another overlap,
        # too
        if len(separate) < most and all(overlap(each.window, other.window) < 0.5 for other in separate):
            separate.append(each)
    return separate


def overlap(one: Window, other: Window) -> float:
    """Return the intersection over union of two windows, taken as level."""
    first, second = ((each.left, each.top, each.side, each.side) for each in (one, other))
    return box_overlap(first, second)


def upright(photo: np.ndarray | ImagePyramid, window: Window, recognizer: Recognizer) -> Window:
    """Turn a window so that the object in it stands upright; as it is where that is nearly so."""
    # 3: turns, at most: the network sees a part of a large roll. Real pots rolled by 30 degrees are 8 off in
    # the median after one turn, 2 after two
    for _ in range(3):
        roll = float(predict_windows(photo, [window], recognizer).roll[0])
        if abs(roll) < MIN_ROLL:
            break
        window = replace(window, roll=window.roll + roll)
    return window


def predict_windows(
    photo: np.ndarray | ImagePyramid, windows: list[Window], recognizer: Recognizer
) -> Prediction:
    """Return the predictions of the network for windows of a photo."""
    return recognizer(np.stack([window.crop(photo)[0] for window in windows]))


def box_in_window(prediction: Prediction) -> tuple[float, float, float, float] | None:
    """Return the box (x, y, w, h) of the object's pixels in the first window, in its sides; None for none."""
    shown = 1 - prediction.mask[0, :, :, 2] > SHOWN
    if (box := box_of(shown)) is None:
        return None
    height, width = shown.shape
    (left, top), size = np.array(box[:2]), np.array(box[2:])
    x, y = left / width, top / height
    return x, y, (left + size[0]) / width - x, (top + size[1]) / height - y


def _move_window(window: Window, prediction: Prediction) -> Window:
    """Return the window of the object in one window's prediction (N = 1)."""
    box = box_in_window(prediction)
    if box is None or max(box[2:]) < 0.05:
        return window
    roll = float(prediction.roll[0])
    x, y = (box[0] + box[2] / 2 - 0.5) * window.side, (box[1] + box[3] / 2 - 0.5) * window.side
    centre = window.to_photo(x, y)
    w, h = box[2] * window.side, box[3] * window.side
    turn = window.roll + (roll if abs(roll) > MIN_ROLL else 0.0)
    return Window.round_box((centre[0] - w / 2, centre[1] - h / 2, w, h), turn)


def presence_features(at_place: float, prediction: Prediction) -> np.ndarray | None:
    """Return features (5,) of a window showing an object, from the probability of its place and from its
    prediction (N = 1); None where nothing is seen.
    """
    box = box_in_window(prediction)
    if box is None:
        return None
    object_share = 1 - prediction.mask[0, :, :, 2]
    # Expected share of the object's pixels that its mask has wrong; 1e-3: the least that counts
    blur = max(float(np.minimum(object_share, 1 - object_share).sum() / object_share.sum()), 1e-3)
    size = math.log(max(box[2:]) * WINDOW_OVER_BOX) / WINDOW_SIZE_DEVIATION
    off = math.hypot(box[0] + box[2] / 2 - 0.5, box[1] + box[3] / 2 - 0.5 - BOX_BELOW_CENTRE)
    framed = max(-0.5 * (size**2 + (off / WINDOW_PLACE_DEVIATION) ** 2), -3.0)  # -3.0: the least that counts
    odds = map(log_odds, (at_place, float(prediction.presence[0])))
    return np.array([1.0, *odds, framed, math.log(blur)])


def _present(at_place: float, prediction: Prediction) -> float:
    """Return the probability that a window shows an object, see `presence_features`."""
    features = presence_features(at_place, prediction)
    # -3.6, 0.5, 0.45, 0.6, -1.0: weights of 1, of the log odds of the map and of the presence head, and of
    # the logs of how well the window is filled and of the blur, in the log odds that it shows an object: a
    # logistic regression (`python -m benchmarks.presence`), rounded, for all classes. Two were chosen on the
    # photos of docs/results.md: the map's weight (1.0 by the regression, which finds fewer decorated mugs)
    # and the bias, .1 below that of the regression with this weight
    return 0.0 if features is None else float(sigmoid(np.dot((-3.6, 0.5, 0.45, 0.6, -1.0), features)))

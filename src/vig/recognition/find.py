"""Where the object is in a photo of any size: windows of many places and sizes, judged by the network."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np
import torch

from vig.io.errors import UserError
from vig.photo import ImagePyramid, Window
from vig.photo.masks import box_of
from vig.photo.window import BOX_BELOW_CENTRE, SMALLEST_BOX, WINDOW_OVER_BOX
from vig.recognition.prediction import Prediction, Recognizer

SIZES = 6
"""Sides of windows, from the photo's down by square roots of 2."""
STEP = 0.4
"""Steps between windows, in their sides."""
LARGE = 3
"""So many of the largest sizes are looked at first."""
SURE = 0.85
"""Score from which the many small windows are not looked at any more."""
MOVED_WINDOWS = 6
"""So many windows are moved onto the object that they show."""
MOVES = 3
"""So often."""
FROM_GRID = 3
"""So many windows are moved for each object that is sought."""
SAME_PLACE = 0.4
"""Overlap of windows from which they are of one object."""
LEAST_ROLL = math.radians(5.0)
"""A window is turned only where the network sees the object turned by more."""
TURNS = 3
"""So often at most: of a large roll the network sees a part. Real pots rolled by 30 degrees are 8 off in the
median after one turn, 2 after two."""
GROWN = (1.0, 1.25, 1.6, 2.2)
"""Boxes of the object over those of what is known of it."""
HIDDEN_PART = 1.15
"""Longer side of the object, as the network sees it, over that of a mask, from which the rest is hidden."""
UNPLACED = (
    "expected a box or a mask of the object, as the class has no network to find it; got neither. Give one,"
    " or train it with `vig class train`."
)
SHOWN = 0.5
"""Predicted probability from which a pixel belongs to the object, hidden or not."""


@dataclass(frozen=True)
class Candidate:
    """A place where the object may be.

    Attributes:
        window: Round it, turned so that it stands upright.
        score: From 0 to 1; how sure the network is that the window shows the object as a window should.
    """

    window: Window
    score: float


def find(
    photo: np.ndarray | ImagePyramid, recognizer: Recognizer, clues: LocationHints | None = None
) -> Candidate:
    """The best place of the object in a photo (H, W, 3), as `coded_photo` gives it.

    A low score means that the photo may not show the object. With clues only places that agree count.

    Raises:
        UserError: The recognizer knows nothing of photos, and no clue is a mask.
    """
    if not recognizer.informed:
        if clues is None or clues.mask is None:
            raise UserError(UNPLACED)
        return Candidate(Window.round_box(clues.box), 1.0)
    tried: list[tuple[float, Window]] = []
    candidates: list[Candidate] = []
    near = [] if clues is None else clues.windows()
    for sizes in (range(LARGE), range(LARGE, SIZES)):
        windows = near + _grid(photo.shape[1], photo.shape[0], sizes)
        near = []
        if clues is not None:
            windows = [window for window in windows if clues.within(window)]
        if not windows:
            continue
        prediction = predict_windows(photo, windows, recognizer, twice=False)
        tried += zip(_scores(prediction), _all_moved(windows, prediction), strict=True)
        tried.sort(key=lambda each: -each[0])
        moved = [window for _, window in tried[:MOVED_WINDOWS]]
        for _ in range(MOVES):
            prediction = predict_windows(photo, moved, recognizer)
            scores = _scores(prediction)
            if clues is not None:
                scores = [score * clues.agreement(window, prediction[i : i + 1])
                          for i, (score, window) in enumerate(zip(scores, moved, strict=True))]  # fmt: skip
            candidates += map(Candidate, moved, scores)
            moved = _all_moved(moved, prediction)
        best = max(candidates, key=lambda each: each.score)
        if best.score >= SURE:
            break
    if clues is not None and clues.mask is not None:
        return replace(best, window=clues.placed(photo, best.window, recognizer))
    return best


@dataclass(frozen=True, eq=False)
class LocationHints:
    """What is known of where the object is in a photo.

    Attributes:
        mask: (H, W) bool, where it is seen, or None.
        points: (N, 2) places x, y on it, hidden ones too; N may be 0.
    """

    mask: np.ndarray | None
    points: np.ndarray

    @property
    def box(self) -> tuple[float, float, float, float]:
        """x, y, w, h round all that is known."""
        corners = [self.points]
        if self.mask is not None and (box := box_of(self.mask)) is not None:
            corners.append(np.array([box[:2], np.add(box[:2], box[2:])], float))
        places = np.concatenate(corners)
        (left, top), (right, bottom) = places.min(0), places.max(0)
        return float(left), float(top), float(right - left), float(bottom - top)

    def windows(self) -> list[Window]:
        """Windows about what is known, as if it were all of the object, and larger ones for hidden parts."""
        x, y, w, h = self.box
        side = max(w, h, float(SMALLEST_BOX))
        x, y = x + w / 2, y + h / 2
        sides = [side * grown for grown in GROWN]
        return [Window.round_box((x - s / 2, y - s / 2, s, s)) for s in sides]

    def within(self, window: Window) -> bool:
        """Whether a window shows all that is known."""
        x, y, w, h = self.box
        corners = [window.to_window(x + right * w, y + down * h) for right in (0, 1) for down in (0, 1)]
        return max(max(map(abs, corner)) for corner in corners) <= window.side / 2

    def placed(self, photo: np.ndarray | ImagePyramid, window: Window, recognizer: Recognizer) -> Window:
        """The window of the object's box: that of what is known, or with what the network sees hidden.

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
            if max(high - low) > HIDDEN_PART * max(w, h):
                (x, y), (w, h) = low.tolist(), (high - low).tolist()
        return upright(photo, Window.round_box((x, y, w, h)), recognizer)

    def agreement(self, window: Window, prediction: Prediction) -> float:
        """From 0 to 1: how well what the network sees in a window is what is marked."""
        if not self.within(window):
            return 0.0
        if self.mask is None:
            return 1.0
        grey = np.repeat(self.mask[:, :, None].astype(np.float32), 3, axis=2)
        marked = window.crop(grey)[0][..., 0] > 0.5
        predicted_visible = prediction.mask[0, :, :, 0].numpy() > SHOWN
        union = int((marked | predicted_visible).sum())
        return int((marked & predicted_visible).sum()) / union if union else 0.0


def find_several(photo: np.ndarray | ImagePyramid, recognizer: Recognizer, most: int) -> list[Candidate]:
    """The best places of several objects in a photo, as `find` takes it: `most` at most, the best first.

    Raises:
        UserError: The recognizer knows nothing of photos.
    """
    if not recognizer.informed:
        raise UserError(UNPLACED)
    windows = _grid(photo.shape[1], photo.shape[0], range(SIZES))
    prediction = predict_windows(photo, windows, recognizer, twice=False)
    moved = map(Candidate, _all_moved(windows, prediction), _scores(prediction))
    windows = [each.window for each in apart(moved, FROM_GRID * most)]
    tried: list[Candidate] = []
    for _ in range(MOVES):
        prediction = predict_windows(photo, windows, recognizer)
        tried += map(Candidate, windows, _scores(prediction))
        windows = _all_moved(windows, prediction)
    return apart(tried, most)


def apart(candidates: Iterable[Candidate], most: int) -> list[Candidate]:
    """The best candidates, `most` of them, no two of the same place."""
    separate: list[Candidate] = []
    for each in sorted(candidates, key=lambda each: -each.score):
        if len(separate) < most and all(
            overlap(each.window, other.window) < SAME_PLACE for other in separate
        ):
            separate.append(each)
    return separate


def overlap(one: Window, other: Window) -> float:
    """Intersection over union of two windows, taken as level."""
    shared = 1.0
    for first, second in ((one.left, other.left), (one.top, other.top)):
        shared *= max(0.0, min(first + one.side, second + other.side) - max(first, second))
    return shared / (one.side**2 + other.side**2 - shared)


def upright(photo: np.ndarray | ImagePyramid, window: Window, recognizer: Recognizer) -> Window:
    """Turn a window so that the object in it stands upright; as it is where that is nearly so."""
    for _ in range(TURNS):
        roll = float(predict_windows(photo, [window], recognizer).roll[0])
        if abs(roll) < LEAST_ROLL:
            break
        window = replace(window, roll=window.roll + roll)
    return window


def predict_windows(
    photo: np.ndarray | ImagePyramid, windows: list[Window], recognizer: Recognizer, twice: bool = True
) -> Prediction:
    """What the network predicts for windows of a photo; for `twice` see `Recognizer.__call__`."""
    cut = torch.from_numpy(np.stack([window.crop(photo)[0] for window in windows]))
    return recognizer(cut, twice=twice)


def _grid(width: int, height: int, sizes: Iterable[int]) -> list[Window]:
    """Windows whose centres lie in the photo."""
    largest, windows = WINDOW_OVER_BOX * max(width, height), []
    for size in sizes:
        side = largest * 2 ** (-size / 2)
        across, down = (
            max(1, math.ceil((length - 0.3 * side) / (STEP * side))) for length in (width, height)
        )
        for x in np.linspace(0, width, 2 * across + 1)[1::2]:
            windows += [
                Window(x - side / 2, y - side / 2, side) for y in np.linspace(0, height, 2 * down + 1)[1::2]
            ]
    return windows


def box_in_window(prediction: Prediction) -> tuple[float, float, float, float] | None:
    """The box (x, y, w, h) of the object's pixels in the first window, in its sides; None for none."""
    shown = 1 - prediction.mask[0, :, :, 2].numpy() > SHOWN
    if (box := box_of(shown)) is None:
        return None
    height, width = shown.shape
    (left, top), size = np.array(box[:2]), np.array(box[2:])
    x, y = left / width, top / height
    return x, y, (left + size[0]) / width - x, (top + size[1]) / height - y


def _moved(window: Window, prediction: Prediction) -> Window:
    """The window of what one window's prediction (N = 1) shows of the object."""
    box = box_in_window(prediction)
    if box is None or max(box[2:]) < 0.05:
        return window
    roll = float(prediction.roll[0])
    x, y = (box[0] + box[2] / 2 - 0.5) * window.side, (box[1] + box[3] / 2 - 0.5) * window.side
    centre = window.to_photo(x, y)
    w, h = box[2] * window.side, box[3] * window.side
    turn = window.roll + (roll if abs(roll) > LEAST_ROLL else 0.0)
    return Window.round_box((centre[0] - w / 2, centre[1] - h / 2, w, h), turn)


def _all_moved(windows: list[Window], prediction: Prediction) -> list[Window]:
    return [_moved(window, prediction[i : i + 1]) for i, window in enumerate(windows)]


def _scores(prediction: Prediction) -> list[float]:
    """How surely each window shows the object, at the middle and of the size that windows have."""
    scores = []
    for index in range(len(prediction)):
        one = prediction[index : index + 1]
        box = box_in_window(one)
        if box is None:
            scores.append(0.0)
            continue
        object_share = 1 - one.mask[0, :, :, 2]
        inside = object_share[object_share > SHOWN].mean()
        visible_share = float(one.mask[0, :, :, 0].sum() / object_share.sum().clamp_min(1.0))
        size = math.exp(-0.5 * (math.log(max(box[2:]) * WINDOW_OVER_BOX) / 0.35) ** 2)
        off = math.hypot(box[0] + box[2] / 2 - 0.5, box[1] + box[3] / 2 - 0.5 - BOX_BELOW_CENTRE)
        place = math.exp(-0.5 * (off / 0.2) ** 2)
        scores.append(float(one.presence[0]) * float(inside) * size * place * (0.3 + 0.7 * visible_share))
    return scores

"""What a user does with one photo: every correction is a state, fitted anew, and can be taken back."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

from vig.explainer import Explainer
from vig.explanation import Explanation
from vig.inference import PixelLabel
from vig.io.errors import UserError
from vig.photo import focal_of
from vig.photo.images import coded_photo
from vig_app.corrections import Mark, State

MOST_UNDO = 200
"""States that can be gone back to, at most."""
Change = Callable[[State], State]
"""What one correction makes of a state."""


class Session:
    """One photo, its explanation, and the states that led there.

    Every method that corrects something fits the photo again and returns the new explanation; where that
    cannot be done it raises UserError and leaves all as it was.
    """

    def __init__(self, explainer: Explainer, photo: str | Path, state: State | None = None) -> None:
        """Open a photo and explain it with the hints of a state.

        Raises:
            UserError: As `Explainer.explain` does.
        """
        self.explainer = explainer
        self.path = Path(photo)
        self.photo = coded_photo(photo)
        self.exif_focal = focal_of(photo)
        self.states = [state or State()]
        self._check(self.state)
        self.explanation = self._explained(self.state)

    @property
    def state(self) -> State:
        """The hints now."""
        return self.states[-1]

    def correct(self, *changes: Change | None) -> Explanation:
        """Make corrections in their order and fit once; None takes the last one back, where there is one.

        Raises:
            UserError: As `Explainer.explain` does; then none of them was made.
        """
        states = [*self.states]
        for change in changes:
            if change is not None:
                changed = change(states[-1])
                self._check(changed)
                states += [changed] if changed != states[-1] else []
            elif len(states) > 1:
                states.pop()
        if states[-1] != self.state:
            self.explanation = self._explained(states[-1])
        self.states = states[-MOST_UNDO:]
        return self.explanation

    def draw_box(self, x: float, y: float, width: float, height: float) -> Explanation:
        """A box round the whole object, cut at the photo's edges, in place of the one that was found."""
        return self.correct(self.boxed(x, y, width, height))

    def boxed(self, x: float, y: float, width: float, height: float) -> Change:
        """The change that `draw_box` makes."""
        photo_height, photo_width = self.photo.shape[:2]
        left, top = max(x, 0.0), max(y, 0.0)
        right, bottom = min(x + width, float(photo_width)), min(y + height, float(photo_height))
        return lambda state: replace(state, box=(left, top, right - left, bottom - top))

    def place(self, name: str, x: float, y: float) -> Explanation:
        """Where a named point of the class is."""
        return self.correct(placed(name, x, y))

    def mark(self, label: PixelLabel, x: float, y: float, radius: float) -> Explanation:
        """What a disc of the photo shows."""
        return self.correct(marked(label, x, y, radius))

    def choose(self, azimuth_deg: float | None) -> Explanation:
        """Which view it is, to some 8 degrees; None leaves it open again."""
        return self.correct(lambda state: replace(state, azimuth_deg=azimuth_deg))

    def hold(self, elevation_deg: float | None, roll_deg: float | None) -> Explanation:
        """Hold the eye's elevation and the photo's roll; None lets them free."""
        return self.correct(lambda state: replace(state, elevation_deg=elevation_deg, roll_deg=roll_deg))

    def say_visible(self, visible: bool) -> Explanation:
        """Whether nothing hides any of the object."""
        return self.correct(lambda state: replace(state, visible=visible))

    def clear(self) -> Explanation:
        """Take all back but the box."""
        return self.correct(cleared)

    def undo(self) -> Explanation:
        """Take the last correction back; nothing happens where there is none."""
        return self.correct(None)

    def save(self, folder: str | Path) -> Path:
        """Write what `vig fit` writes; returns the folder."""
        folder = self.explanation.save(folder, self.path.name)
        self.state.write(folder, self.path, self.explainer.object_class)
        return folder

    def _check(self, state: State) -> None:
        height, width = self.photo.shape[:2]
        state.check(width, height, self.explainer.object_class)

    def _explained(self, state: State) -> Explanation:
        height, width = self.photo.shape[:2]
        given = state.focal is not None or state.camera is not None
        focal = state.focal if given else self.exif_focal
        hints = state.hints(width, height)
        try:
            explanation = self.explainer.explain(
                self.photo, state.box, focal=focal, hints=hints, camera=state.camera
            )
            exif = not given and focal is not None and self.explainer.settings.camera_distance_ratio is None
            return replace(explanation, focal_from="exif") if exif else explanation
        except UserError as error:
            raise UserError(str(error).replace("the photo", self.path.name, 1)) from None


def placed(name: str, x: float, y: float) -> Change:
    """The change that `Session.place` makes."""
    return lambda state: replace(state, points={**state.points, name: (x, y)})


def marked(label: PixelLabel, x: float, y: float, radius: float) -> Change:
    """The change that `Session.mark` makes."""
    return lambda state: replace(state, marks=(*state.marks, Mark(x, y, radius, label)))


def cleared(state: State) -> State:
    """The change that `Session.clear` makes."""
    return State(box=state.box, focal=state.focal, camera=state.camera)

"""A user's corrections of one photo: each is a state, fitted anew, and can be taken back."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from vig.explainer import Explainer
from vig.explanation import Explanation
from vig.hints import Stroke
from vig.inference import PixelLabel
from vig.io.errors import UserError
from vig.parallel import on_one_core
from vig.photo.images import coded_photo
from vig.several import MAX_OBJECTS
from vig.several.explain import find_together
from vig_app.corrections import State, box_of
from vig_app.report.folder import save_explanation

Change = Callable[[State], State]  # a correction's change of a state
Places = Sequence[tuple[float, float]]


class Session:
    """One photo, its explanation, and the states that led there.

    Changes are `Session.set_box`, `set_point`, `add_stroke`, `set_state`, `dismiss` and `clear_corrections`.
    """

    def __init__(
        self,
        explainer: Explainer,
        photo: str | Path,
        state: State | None = None,
        others: np.ndarray | None = None,
    ) -> None:
        """Open a photo and explain it with the hints of a state.

        Args:
            explainer: Explainer of the object's class.
            photo: A file.
            state: Prior knowledge.
            others: (H, W) bool, pixels in which other objects are visible, where these were explained.

        Raises:
            UserError: See `Explainer.explain`.
        """
        self.explainer = explainer
        self.path = Path(photo)
        self.photo = coded_photo(photo)
        self.others = others
        if others is not None and others.shape != self.photo.shape[:2]:
            raise UserError(f"expected '{photo}' as it was explained; got one of another size. Fit it anew.")
        self.saved = state or State()
        self.states = [self.saved]
        self._check(self.state)
        self.explanation = self._explain(self.state)

    @property
    def state(self) -> State:
        """Return the hints now."""
        return self.states[-1]

    @property
    def unsaved(self) -> bool:
        """Return whether there are corrections that were not saved."""
        return self.state != self.saved

    def correct(self, *changes: Change | None) -> Explanation:
        """Make corrections in their order and fit once; None takes the last one back, where there is one.

        Raises:
            UserError: See `Explainer.explain`; then none of them was made.
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
            self.explanation = self._explain(states[-1])
        # 200: states that can be gone back to, at most
        self.states = states[-200:]
        return self.explanation

    def set_box(self, x: float, y: float, width: float, height: float) -> Change:
        """Return the correction to a box round the whole object, cut at the photo's edges, in place of the
        one that was found.
        """
        photo_height, photo_width = self.photo.shape[:2]
        left, top = max(x, 0.0), max(y, 0.0)
        right, bottom = min(x + width, float(photo_width)), min(y + height, float(photo_height))
        return lambda state: replace(state, box=(left, top, right - left, bottom - top), found=None)

    def save(self, folder: str | Path, files: Sequence[str] | None = None) -> Path:
        """Write the files of `vig fit`, see `Explanation.save`; returns the folder."""
        folder = save_explanation(self.explanation, folder, self.path.name, files)
        self.state.write(folder, self.path, self.explainer.object_class, corrected=True)
        self.saved = self.state
        return folder

    def places(self) -> list[tuple[float, float, float, float]]:
        """Return boxes of the places at which objects of the class are found, the surest first.

        Raises:
            UserError: The class's network does not find objects.
        """
        found = on_one_core(partial(find_together, self.photo, [self.explainer], MAX_OBJECTS))
        return [box_of(window) for _, window, _ in found]

    def _check(self, state: State) -> None:
        height, width = self.photo.shape[:2]
        state.check(width, height, self.explainer.object_class)

    def _explain(self, state: State) -> Explanation:
        return state.explain(self.explainer, self.path, self.photo, self.others)


def set_point(name: str, x: float, y: float) -> Change:
    """Return the correction that sets a named point of the class."""
    return lambda state: replace(state, points={**state.points, name: (x, y)}, found=state.found or None)


def add_stroke(label: PixelLabel, x: float, y: float, radius: float, path: Places = ()) -> Change:
    """Return the correction that adds a stroke of a brush, set down at a place and moved along a path."""
    stroke = Stroke(x, y, radius, label, tuple(path))
    return lambda state: replace(state, strokes=(*state.strokes, stroke), found=state.found or None)


def set_state(**values: Any) -> Change:
    """Return the correction of the state: a view, whether nothing hides the object; None leaves one open."""
    return lambda state: replace(state, **values)


def dismiss(state: State) -> State:
    """Return the state in which there is no such object; any later correction brings it back."""
    return replace(clear_corrections(state), found=0.0)


def clear_corrections(state: State) -> State:
    """Return the state without corrections but the box."""
    return State(box=state.box, focal=state.focal, camera=state.camera, found=state.found or None)

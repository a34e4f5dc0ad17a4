"""Explanation of several objects in a photo: by their boxes, or found."""

from collections.abc import Iterable, Sequence
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np

from vig.explainer import Box, Explainer, Lens, Photo, lens_of
from vig.explanation import Explanation
from vig.inference.presence import MIN_PRESENT, judge_presence
from vig.io.errors import UserError
from vig.parallel import on_one_core
from vig.photo import ImagePyramid, Window
from vig.photo.images import coded_photo
from vig.recognition.find import apart, find_several
from vig.recognition.object_map import box_shared
from vig.several.joint import fit_jointly
from vig.several.known import find_known_together, fit_known_jointly
from vig.several.scene import SceneExplanation
from vig_renderer.defaults import with_default_settings

MAX_OBJECTS = 24  # objects of one photo, at most


@with_default_settings
def explain_together(
    photo: Photo,
    explainers: Sequence[Explainer],
    boxes: Sequence[Box],
    focal: float | None = None,
    K: Any = None,
) -> SceneExplanation:
    """Explain several objects of one photo together.

    Args:
        photo: A photo in any form of `Explainer.explain`.
        explainers: One for each object, that of its class; the same one may stand for several.
        boxes: Boxes round each whole object, hidden parts included.
        focal: Focal length in pixels; see `Explainer.explain`.
        K: Intrinsics in place of a focal length; see `Explainer.explain`.

    Raises:
        UserError: See `Explainer.explain`; also for more or fewer boxes than explainers, or too many.
    """
    explainers, boxes = _explainers(explainers), list(boxes) if isinstance(boxes, Iterable) else []
    if not 1 <= len(boxes) <= MAX_OBJECTS or len(boxes) != len(explainers):
        raise UserError(
            f"expected an explainer and a box for each of 1 to {MAX_OBJECTS} objects; got"
            f" {len(explainers)} and {len(boxes)}. Give as many of both."
        )
    picture, lens = coded_photo(photo), lens_of(photo, focal, K)
    alone = [
        _with_source(explainer.explain(picture, box, K=lens and lens[0]), lens)
        for explainer, box in zip(explainers, boxes, strict=True)
    ]
    jointly = partial(fit_known_jointly, boxes=boxes) if _all_known(explainers) else fit_jointly
    return on_one_core(partial(jointly, alone, explainers))


@with_default_settings
def explain_found(
    photo: Photo, explainers: Sequence[Explainer], most: int, focal: float | None = None, K: Any = None
) -> SceneExplanation:
    """Find objects of one or more classes in a photo, and explain them together.

    Less reliable than boxes: each network that is asked knows one class (docs/photographs.md has numbers).

    Args:
        photo: A photo in any form of `Explainer.explain`.
        explainers: One for each class.
        most: Number of objects, at most.
        focal: Focal length in pixels; see `Explainer.explain`.
        K: Intrinsics in place of a focal length; see `Explainer.explain`.

    Raises:
        UserError: See `Explainer.explain`; also if nothing is found.
    """
    explainers = _explainers(explainers)
    if not explainers:
        raise UserError("expected an explainer for each class that is sought; got none. Give one.")
    if not isinstance(most, int) or not 1 <= most <= MAX_OBJECTS:
        raise UserError(f"expected 1 to {MAX_OBJECTS} objects; got {most}. Give a number within.")
    picture, lens = coded_photo(photo), lens_of(photo, focal, K)
    names = " or ".join(each.object_class.name for each in explainers[:5])
    names += f" or one of {len(explainers) - 5} others" if len(explainers) > 5 else ""
    nothing = UserError(f"expected a {names} in the photo; found none. Give boxes.")
    if _all_known(explainers):
        known = on_one_core(partial(find_known_together, picture, explainers, most, lens))
        if known is None:
            raise nothing
        return known
    places = on_one_core(partial(find_together, picture, explainers, most))
    if not places:
        raise nothing
    chosen = [explainer for explainer, _, _ in places]
    alone = [
        _with_source(explainer.explain_frame(picture, window, camera=lens and lens[0]), lens)
        for explainer, window, _ in places
    ]
    scene = on_one_core(partial(fit_jointly, alone, chosen))
    real = [number for number, is_ghost in enumerate(ghosts(scene.objects)) if not is_ghost]
    if len(real) < len(alone):
        alone, chosen = [alone[number] for number in real], [chosen[number] for number in real]
        scene = on_one_core(partial(fit_jointly, alone, chosen))
    objects = [
        replace(each, fit=judge_presence(each.fit, places[number][2], each.object_class.name))
        for each, number in zip(scene.objects, real, strict=True)
    ]
    return replace(scene, objects=tuple(objects))


def ghosts(objects: Sequence[Explanation]) -> list[bool]:
    """Return which finds show a part of another one, or the same object once more: (N,) bool.

    View and mask are improbable once pixels are shared out, and it is hardly visible behind one whose mask
    is likelier, or within its box. The bounds were chosen on photos of one pot or mug, and on collages of two
    and groups of the validation split, whose other objects stay.
    """

    def is_part(each: Explanation, other: Explanation) -> bool:
        if each.box is None or other.box is None or not each.mask_confidence < other.mask_confidence:
            return False
        hidden = each.mask.sum() < 0.1 * each.amodal.sum()
        share = box_shared(each.box, other.box) / (each.box[2] * each.box[3])
        inside = share > 0.95 or (hidden and share > 0)
        return each.mask_confidence < 0.05 and each.confidence < 0.5 and bool(inside)

    return [any(is_part(each, other) for other in objects) for each in objects]


def _all_known(explainers: Sequence[Explainer]) -> bool:
    """Return whether all are of meshes with colours; UserError where some are and others are not."""
    known = [each.known is not None and not each.known.surface.one_colour for each in explainers]
    if any(known) and not all(known):
        names = [
            each.object_class.name for each, of_mesh in zip(explainers, known, strict=True) if not of_mesh
        ]
        raise UserError(
            "expected explainers of meshes with colours alone, or of others alone; got both. Explain"
            f" {', '.join(names)} apart."
        )
    return all(known)


def _explainers(value: Any) -> list[Explainer]:
    explainers = list(value) if isinstance(value, Iterable) else [value]
    for each in explainers:
        if not isinstance(each, Explainer):
            raise UserError(
                f"expected a list of vig.Explainer; got a {type(each).__name__} in it. Make each as"
                ' vig.Explainer("teapot").'
            )
    return explainers


def find_together(
    picture: np.ndarray, explainers: Sequence[Explainer], most: int
) -> list[tuple[Explainer, Window, float]]:
    """Return the windows of objects of one or more classes in a photo, as `coded_photo` gives it, and
    the probability that each is there; the surest first.
    """
    pyramid = ImagePyramid(picture)
    candidates = [
        (candidate, explainer)
        for explainer in explainers
        for candidate in find_several(pyramid, explainer.recognizer, most)
        if candidate.present >= MIN_PRESENT
    ]
    separate = apart([candidate for candidate, _ in candidates], most)
    return [
        (explainer, one.window, one.present)
        for one in separate
        for candidate, explainer in candidates
        if candidate is one
    ]


def _with_source(explanation: Explanation, lens: Lens | None) -> Explanation:
    """Return the explanation with the source of its focal length, where a lens is known."""
    return explanation if lens is None else replace(explanation, focal_from=lens[1])

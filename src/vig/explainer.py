"""The library's entry point: a photo of any size in, an explanation out."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator
from dataclasses import replace
from functools import partial
from itertools import zip_longest
from pathlib import Path
from typing import Any

import numpy as np

from vig.explanation import Explanation
from vig.hints import Hints, check_hints
from vig.inference import (
    ExpectedStart,
    ExplainSettings,
    explain,
    resolve,
    without_network,
)
from vig.inference.calibration import FILE as CALIBRATION_FILE
from vig.inference.presence import judge_presence
from vig.inference.settings import for_tracking
from vig.io.checks import number_of
from vig.io.errors import UserError
from vig.known_object import KnownObject, Place, WholePhoto, assumed_lens
from vig.known_object import find as find_known
from vig.known_object.packs import pack_of_mesh
from vig.parallel import map_in_processes, on_one_core
from vig.photo import ImagePyramid, Intrinsics, Window, focal_of
from vig.photo.images import Photo as Photo
from vig.photo.images import coded_photo
from vig.photo.lens import camera_as_shown
from vig.photo.window import DISTANCE_RATIO_BOUNDS
from vig.recognition import WEIGHTS_FILE, Recognizer, UninformedRecognizer, find, upright
from vig.scene import ObjectClass
from vig.scene.functions import numpy_of_tensor
from vig_renderer.defaults import with_default_settings

Box = tuple[float, float, float, float]
Lens = tuple[Any, str]
"""A photo's intrinsics, as `Intrinsics.of` takes them, and `Explanation.focal_from`."""
Item = tuple[Photo, Box | None, Lens | None, Hints | None]
TOO_WIDE = "; the camera is so close to it that a weaker perspective than its lens's was fitted"


@with_default_settings
class Explainer:
    """Estimator of pose, shape, colours, light and masks of objects of one class in photos.

    Example:
        ```python
        explainer = vig.Explainer("teapot")
        explanation = explainer.explain("photo.jpg", box=(120, 80, 300, 240))
        ```
    """

    def __init__(
        self,
        object_class: str | Path | ObjectClass = "teapot",
        settings: ExplainSettings = ExplainSettings(),  # noqa: B008, it is frozen
        recognizer: Recognizer | None = None,
    ):
        """Load a class and its recognition network.

        Args:
            object_class: A packaged class's name, the folder of a class pack, or a class that was loaded.
            settings: How to fit. Fields left None take the defaults for photographs or, with a window, those
                for images of the standard camera; `camera_distance_ratio` follows from the photo's focal
                length if that is known.
            recognizer: A network in place of the class's own. A pack that has none is fitted from starting
                views all around the object, at a box or mask, without a calibrated confidence.

        Raises:
            UserError: There is no such class, or a part of the class's pack is missing or damaged.
        """
        if not isinstance(settings, ExplainSettings):
            raise UserError(f"expected ExplainSettings; got a {type(settings).__name__}. Pass them by name.")
        if not isinstance(object_class, ObjectClass):
            object_class = on_one_core(partial(ObjectClass.load, object_class))
        self.object_class = object_class
        self.settings = settings
        known = KnownObject.of(object_class) if recognizer is None else None
        self.recognizer = recognizer or on_one_core(partial(recognizer_of, object_class))
        self.known = None if self.recognizer.informed else known

    @staticmethod
    def of_mesh(
        mesh: str | Path,
        length: float | None = None,
        up: str | None = None,
        say: Callable[[str], None] = lambda line: None,
    ) -> Explainer:
        """Return an explainer of the object of a mesh file, in any rotation.

        This takes some 15 seconds, the first time: the user's cache keeps it. Without a box or hints the
        object is found by keypoints of its texture (`pip install "vig[match]"`). A mesh of one colour needs a
        box or a mask; without a mask it is fitted standing, and so is every mesh where hints state a roll.

        Args:
            mesh: The file: .glb .gltf .obj .ply .off .stl.
            length: The object's longest side, metres, where the file is not in metres.
            up: The file's axis that points up, from which azimuth and elevation are counted, such as "z" or
                "-x"; by default it is estimated.
            say: Called with a line for each assumption, and before what takes time.

        Raises:
            UserError: It is no mesh that can be used.
        """
        return Explainer(pack_of_mesh(mesh, length, say, up))

    def explain(
        self,
        photo: Photo,
        box: Box | None = None,
        window: Window | None = None,
        focal: float | None = None,
        hints: Hints | None = None,
        K: Any = None,
        mask: np.ndarray | None = None,
    ) -> Explanation:
        """Explain one photo.

        Args:
            photo: A file, a PIL image, or an array or tensor (H, W, 3) or (H, W): uint8 is sRGB, floating
                point is linear RGB in [0, 1].
            box: x, y, width, height in pixels of the whole object, hidden parts included; without it the
                object is searched for in the whole photo.
            window: In place of a box, the square to fit as it is, such as `Window.of` a whole picture.
            focal: Focal length in pixels of the photo, its principal point in the middle; by default that of
                a file's EXIF data, else that of a telephoto lens, and with a window that of the standard
                camera.
            hints: Prior knowledge of the object in this photo.
            K: The whole intrinsics of the photo, without distortion, in place of a focal length: fx, fy, cx
                and cy in pixels, a matrix (3, 3), or a mapping that has them, such as BOP's {"cam_K": ...}.
                The answer's `camera` is then this one, and its pose exact wherever the object is.
            mask: (H, W) bool, the object's visible pixels, or a file of them; in place of `Hints.mask`.

        Raises:
            UserError: The photo, the box, the window, the focal length, the camera or a hint cannot be used.
        """
        hints = check_hints(hints, mask)
        if window is not None and isinstance(hints, Hints) and hints.roll_deg is not None:
            raise UserError("expected a window or a roll among the hints; got both. Turn the window by it.")
        if window is not None and (box is not None or not isinstance(window, Window)):
            raise UserError(f"expected a box or a vig.photo.Window; got {box!r} and {window!r}. Give one.")
        lens = lens_of(photo, focal, K)
        return on_one_core(partial(self._explain, photo, box, window, lens, hints))

    def explain_frame(
        self,
        photo: Photo,
        window: Window | None,
        focal: float | None = None,
        hints: Hints | None = None,
        camera: Any = None,
        box: Box | None = None,
        expected: ExpectedStart | None = None,
    ) -> Explanation:
        """Explain a video frame whose object is expected in the middle of a window.

        Like `explain` with a box of that window, which may exceed the photo and be turned; or with a box.
        With a focal length alone the answer's camera looks straight at the object all the same. With an
        `expected` start few others are tried, which takes a third of the time.
        """
        lens = lens_of(photo, focal, camera)
        follow = partial(self._explain, photo, box, window, lens, hints, standard_camera=False)
        return on_one_core(partial(follow, aim=camera is not None, expected=expected))

    def _explain(
        self,
        photo: Photo,
        box: Box | None,
        window: Window | None,
        lens: Lens | None,
        hints: Hints | None,
        standard_camera: bool = True,
        aim: bool = True,
        expected: ExpectedStart | None = None,
    ) -> Explanation:
        """Explain one photo. `standard_camera`: whether a given window is the picture of that camera; `aim`:
        whether the camera of a known lens is turned towards the object.
        """
        hints, coded = check_hints(hints), coded_photo(photo)
        pyramid, (height, width) = ImagePyramid(coded), coded.shape[:2]
        settings = resolve(self.settings, self.object_class, photo=window is None or not standard_camera)
        hints = hints.check(width, height, self.object_class) if hints else None
        box = None if box is None else check_box(box)
        if not self.recognizer.informed:
            settings, expected = without_network(settings), None
        elif expected is not None:
            settings = for_tracking(settings)
        if self.known is not None and window is None:
            if explanation := self._explain_in_any_rotation(self.known, coded, pyramid, box, lens, hints):
                return explanation
        present = 1.0
        if window is None:
            window, present = self._locate(coded, pyramid, box, hints)
        focal_from, too_wide = "assumed", False
        if self.settings.camera_distance_ratio is not None:
            focal_from = "given"
        elif lens is not None:
            intrinsics, focal_from = Intrinsics.of(lens[0], width, height), lens[1]
            window = replace(window, lens=intrinsics) if aim else window
            pixels = window.focal or intrinsics.fx
            settings = replace(settings, camera_distance_ratio=window.camera_distance_ratio(pixels))
            too_wide = window.ratio(pixels) < DISTANCE_RATIO_BOUNDS[0]
        crop, inside_photo = window.crop(pyramid)
        # A network sees where in a box the object is; fits without one are held to the box.
        held_box = None if self.recognizer.informed else box
        window_hints = None
        if hints is not None or held_box is not None:
            window_hints = (hints or Hints()).in_window(window, self.object_class, held_box)
        images, valid = crop[None], inside_photo[None]
        with_class = self.object_class, self.recognizer, settings
        fit = next(explain(images, *with_class, valid, window_hints, expected))
        if too_wide:
            fit = replace(fit, reason=fit.reason + TOO_WIDE)
        if present < 1.0:
            fit = judge_presence(fit, present, self.object_class.name)
        ratio = settings.camera_distance_ratio
        return Explanation(coded, window, fit, self.object_class, ratio, focal_from, hints)

    def _explain_in_any_rotation(
        self,
        known: KnownObject,
        coded: np.ndarray,
        pyramid: ImagePyramid,
        box: Box | None,
        lens: Lens | None,
        hints: Hints | None,
    ) -> Explanation | None:
        """Explain a photo of a known object; None where it stands at a given place, as a class's object does.

        Without a box and hints it is found by keypoints. Raises UserError where it is not found.
        """
        given, (height, width) = hints or Hints(), coded.shape[:2]
        any_rotation = known.is_sought(given)
        if not any_rotation and (box is not None or given.clues() is not None):
            return None
        if any_rotation and box is None and hints is None:
            if found := self.find_and_explain(WholePhoto(coded), lens, 1):
                return found[0]
            name = self.object_class.name
            raise UserError(f"expected a {name} in the photo; found none. Give a box or a mask.")
        intrinsics = None if lens is None else Intrinsics.of(lens[0], width, height)
        window, fit, ratio = known.explain(pyramid, Place.of(box, given), intrinsics, given)
        focal_from = "assumed" if lens is None else lens[1]
        return Explanation(coded, window, fit, self.object_class, ratio, focal_from, hints)

    def _locate(
        self, coded: np.ndarray, pyramid: ImagePyramid, box: Box | None, hints: Hints | None
    ) -> tuple[Window, float]:
        """Return the window of a box, or of where hints or the network find the object; and its presence.

        Presence is a probability, 1 where a box or a hint gives the place.
        """
        clues, roll = (None, None) if hints is None else (hints.clues(), hints.views()[2])
        if box is None:
            best = find(pyramid, self.recognizer, clues)
            window, present = best.window, best.present if clues is None else 1.0
            return window if roll is None else replace(window, roll=roll), present
        window = Window.of(coded.shape[1], coded.shape[0], box)
        return upright(pyramid, window, self.recognizer) if roll is None else replace(window, roll=roll), 1.0

    def find_and_explain(self, photo: WholePhoto, lens: Lens | None, most: int) -> list[Explanation]:
        """Return up to `most` explanations of a known object that keypoints find, the likeliest first.

        Raises:
            UserError: The class is not of a mesh with its surface, or OpenCV is missing.
        """
        if self.known is None:
            raise UserError("expected an explainer of a mesh, which keypoints find; got one of a class.")
        height, width = photo.picture.shape[:2]
        intrinsics = assumed_lens(width, height) if lens is None else Intrinsics.of(lens[0], width, height)
        found = find_known(self.known, photo, intrinsics, most)
        return [
            Explanation(
                photo.picture, each.window, judge_presence(each.fit, each.present, self.object_class.name),
                self.object_class, each.ratio, "assumed" if lens is None else lens[1],
            )
            for each in found
        ]  # fmt: skip

    def explain_many(
        self,
        photos: Iterable[Photo],
        boxes: Iterable[Box | None] | None = None,
        workers: int = 1,
        skip: Callable[[int, UserError], None] | None = None,
        focal: float | None = None,
        hints: Iterable[Hints | None] | None = None,
        cameras: Iterable[Any] | None = None,
    ) -> Iterator[Explanation]:
        """Explain photos in their order; see `explain`.

        Args:
            photos: Any number of them; they are taken as they are needed.
            boxes: One for each photo, None where the object is to be found.
            workers: Worker processes; 1 runs in this process.
            skip: Called with the number of an unusable photo and the reason; the others continue. Without
                it the first such photo raises.
            focal: Focal length of all photos, pixels; see `explain`.
            hints: One for each photo, None where nothing is known.
            cameras: One for each photo, None where it is not known; see `explain`.

        Raises:
            UserError: See `explain`; also for workers below 1, for more or fewer boxes than photos, or when a
                worker process was killed.
        """
        number = number_of(workers)
        if number is None or number != int(number) or number < 1:
            raise UserError(f"expected 1 or more workers; got {workers}. Give a whole number.")
        if isinstance(numpy_of_tensor(photos), Photo) or not isinstance(photos, Iterable):
            raise UserError(f"expected several photos; got a {type(photos).__name__}. Put it in a list.")
        if cameras is not None and focal is not None:
            raise UserError("expected cameras or a focal length; got both. Cameras have their own.")
        items = (
            (photo, box, lens_of(photo, focal, camera), hint)
            for photo, box, hint, camera in zip_photos(photos, box=boxes, hint=hints, camera=cameras)
        )
        if number == 1:
            explanations: Iterator[Explanation | UserError] = (self._try_item(item) for item in items)
        else:
            if (folder := self.object_class.folder) is None:
                raise UserError(
                    "expected a class from a pack, for worker processes; got one from memory. Save it first."
                )
            sent = ((_sendable(photo), *others) for photo, *others in items)
            shared = folder, self.settings
            answers = map_in_processes(_prepare, shared, sent, int(number))
            explanations = map(self._receive, answers)
        for place, result in enumerate(explanations):
            if not isinstance(result, UserError):
                yield result
            elif skip is None:
                raise result
            else:
                skip(place, result)

    @with_default_settings
    def _try_item(self, item: Item) -> Explanation | UserError:
        photo, box, lens, hints = item
        try:
            return on_one_core(partial(self._explain, photo, box, None, lens, hints))
        except UserError as error:
            return error

    def _receive(self, answer: Any) -> Explanation | UserError:
        if isinstance(answer, UserError):
            return answer
        return Explanation(object_class=self.object_class, **answer)


@with_default_settings
def recognizer_of(object_class: ObjectClass) -> Recognizer:
    """Return the class's network, or the uninformed recognizer of a pack for which none was trained.

    Raises:
        UserError: The weights are damaged or of another class, or lost: their calibration is there.
    """
    folder = object_class.folder
    if folder is None or not any((folder / name).exists() for name in (WEIGHTS_FILE, CALIBRATION_FILE)):
        return UninformedRecognizer(object_class)
    return Recognizer.of_class(object_class)


def check_box(box: Any) -> Box:
    """Return a given box as four finite numbers; UserError when it is something else."""
    try:
        numbers = [float(number) if isinstance(number, str) else number_of(number) for number in box]
        x, y, w, h = (math.nan if number is None else number for number in numbers)
        if not all(map(math.isfinite, (x, y, w, h))):
            raise ValueError
    except (TypeError, ValueError):
        raise UserError(
            f"expected a box of four numbers x, y, w, h in pixels; got {str(box)[:60]}. Pass all four."
        ) from None
    return x, y, w, h


def check_focal(focal: float) -> float:
    """Return a focal length in pixels; UserError when it is not positive and finite."""
    number = number_of(focal)
    if number is None or not 0 < number < math.inf:
        raise UserError(f"expected a focal length in pixels, above 0; got {focal!r}. Leave it out.")
    return number


def lens_of(photo: Photo, focal: float | None = None, camera: Any = None) -> Lens | None:
    """Return the given lens of a photo, or else the one in its EXIF data; None where none is
    known.

    UserError where a camera and a focal length are given, or a focal length is none.
    """
    if camera is not None:
        if focal is not None:
            raise UserError("expected K or a focal length; got both. K has its own.")
        return camera_as_shown(photo, camera), "given"
    if focal is not None:
        return check_focal(focal), "given"
    of_file = focal_of(photo)
    return None if of_file is None else (of_file, "exif")


def zip_photos(photos: Iterable[Photo], **others: Iterable[Any] | None) -> Iterator[tuple[Any, ...]]:
    """Yield each photo with its item of each of the others, None where these are not given.

    UserError where their numbers differ.
    """
    by_name = {name: each for name, each in others.items() if each is not None}
    missing = object()
    for number, row in enumerate(zip_longest(photos, *by_name.values(), fillvalue=missing)):
        photo, of_photo = row[0], dict(zip(by_name, row[1:], strict=True))
        for name, each in of_photo.items():
            if (photo is missing) != (each is missing):
                few, many = (number, "more") if each is missing else ("more", number)
                raise UserError(
                    f"expected a {name} (or None) for each photo; got {few} of them for {many} photos."
                    " Give as many."
                )
        yield photo, *(of_photo.get(name) for name in others)


def _sendable(photo: Photo) -> str | np.ndarray:
    """Return a photo in the form that is sent to another process."""
    return str(photo) if isinstance(photo, str | Path) else coded_photo(photo)


def _prepare(shared: tuple[Path, ExplainSettings]) -> Callable[[Any], Any]:
    """Return the work of a process of `Explainer.explain_many`."""
    explainer = Explainer(*shared)

    def work(item: Item) -> Any:
        explanation = explainer._try_item(item)
        if isinstance(explanation, UserError):
            return explanation
        return {name: value for name, value in vars(explanation).items() if name != "object_class"}

    return work

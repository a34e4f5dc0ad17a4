"""Fits of validation photos, and of photos out of distribution: samples for a calibration, and errors."""

import math
import zlib
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from scipy.ndimage import rotate

from vig.inference import ExplainSettings, FitCalibration, resolve
from vig.inference.settings import MASK_RIGHT
from vig.recognition import Recognizer
from vig.recognition.network import latents_of
from vig.scene import Latents, ObjectClass, Symmetry, angle_difference, layout_of_width, linear_from_srgb
from vig_train.calibration.learning import FOLDS, CalibrationSamples, learn
from vig_train.evaluation.fits import FitRun, Fits, fit_settings, frame_images
from vig_train.evaluation.metrics import segmentation_iou
from vig_train.training.drawing import examples_of
from vig_train.training.examples import Examples
from vig_world.dataset import Dataset
from vig_world.dataset.spec import Split
from vig_world.studio.studio import Studio, StudioSettings

MAX_ROLLED_ELEVATION = math.radians(50.0)
"""Radians. A photo from below this elevation is out of distribution when rolled; one from above it looks like
a photo of another azimuth."""
AS_USERS_TAKE_THEM = StudioSettings(
    boxed=1.0,
    small=0.0,
    occluded=0.4,
    most_hidden=0.6,
    source=1.0,
    own_colours=0.7,
    decorated=0.3,
    metal=0.03,
    glass=0.01,
    continued=0.1,
    roll=0.03,
    rolled=0.0,
    absent=0.25,
)
"""Photos of a studio to calibrate and to test on: nearer to users' photos than those of the training, which
are as wide as they can be. `absent` is the share that show something else."""
MIN_ROLL_DEG = 20.0  # least roll, degrees, of a photo out of distribution


@dataclass(frozen=True)
class StudioPhotos:
    """Photos of a studio, for cases that a dataset lacks.

    Attributes:
        images: (N, H, W, 3) uint8 sRGB, which show the object.
        latents: (N, P) latents of these.
        visible: (N, H, W) bool, where the object is seen.
        others: (M, H, W, 3) uint8, which do not.
        model: (N,) int, the mesh or design that each shows.
    """

    images: np.ndarray
    latents: np.ndarray
    visible: np.ndarray
    others: np.ndarray
    model: np.ndarray

    @staticmethod
    def draw(
        object_class: ObjectClass,
        split: Split,
        count: int,
        seed: int,
        fold: tuple[int, int] | None = None,
        props: str = "",
        things: Split | None = None,
    ) -> "tuple[StudioPhotos, Examples]":
        """Return images of a seed, level ones of a split's designs, or of a fold's alone (see `Studio`),
        refused meshes left out; and those with the object. Each fold has `count` of its own.

        things: The split of grounds and other things, the same by default; props: see `StudioSettings`.
        """
        settings = replace(AS_USERS_TAKE_THEM, props=props)
        studio = Studio(object_class, settings, split, fold, refused=False, things=things)
        first = 0 if fold is None else fold[0] * count
        drawn = [studio.draw(seed, index) for index in range(first, first + count)]
        examples = examples_of(drawn)
        model = np.array([image.model for image in drawn]) if studio.models else np.arange(count)
        shows_object = examples.present() > 0
        latents = latents_of(examples.numbers, examples.azimuth).to_vector().numpy()
        images, visible = examples.images.numpy(), examples.visible.numpy() > 127
        photos = StudioPhotos(
            images[shows_object],
            latents[shows_object],
            visible[shows_object],
            images[~shows_object],
            model[shows_object.numpy()],
        )
        return photos, examples[shows_object]

    def __len__(self) -> int:
        return len(self.images)


def calibrate_fits(
    datasets: Sequence[Dataset | StudioPhotos],
    recognizer: Recognizer | Sequence[Recognizer],
    run: FitRun,
    settings: ExplainSettings | None = None,
    pooled: bool = False,
) -> tuple[FitCalibration, CalibrationSamples]:
    """Fit all photos of datasets, and learn a calibration on the fits; datasets weigh the same at any size.

    Args:
        datasets: Datasets of the validation split; and photos of a studio.
        recognizer: The class's network, calibrated; or one for each dataset, which has not seen its photos.
        run: How fits are made.
        settings: Settings of the fits, which are made without calibration; by default those for photos.
        pooled: See `learn`.

    Returns:
        The calibration, and the samples that it was learned on.
    """
    uncalibrated = replace(settings or ExplainSettings(free_framing=True), calibrated=False, widened=False)
    object_class, parts = run.object_class, []
    recognizers = [recognizer] * len(datasets) if isinstance(recognizer, Recognizer) else recognizer
    for dataset, own_recognizer in zip(datasets, recognizers, strict=True):
        name = f"{len(dataset)}_{zlib.crc32(dataset.latents.tobytes()):08x}"
        if isinstance(dataset, StudioPhotos):
            images, visible = dataset.images, dataset.visible
            photo_settings = resolve(uncalibrated, object_class, photo=True)
            photos, origin = dataset.others, np.arange(len(dataset.others))
        else:
            images, visible = frame_images(dataset, own_recognizer)
            photo_settings = fit_settings(uncalibrated, object_class, dataset)
            origin = photos_to_roll(dataset)
            photos = roll_photos(images[origin], roll_angles(len(origin)))
        fits = run.fit(images, own_recognizer, photo_settings, name)
        rolled_features = fits.confidence_features[:0]
        if len(origin):
            outside = run.fit(photos, own_recognizer, photo_settings, name + "_outside")
            rolled_features = outside.confidence_features
        symmetry = object_class.symmetry
        parts.append(samples_of(fits, dataset, visible, origin, rolled_features, symmetry))
    samples = CalibrationSamples(
        *(np.concatenate(c) for c in zip(*[tuple(vars(p).values()) for p in parts], strict=True))
    )
    samples = replace(samples, fold=_by_mesh(samples.model, samples.fold))
    return replace(learn(samples, pooled), density=uncalibrated.likelihood.density), samples


def _by_mesh(model: np.ndarray, fold: np.ndarray) -> np.ndarray:
    """Return folds (N,) with all fits of a mesh, numbered from 0 on, in one, where there are enough meshes:
    the calibration is then tested on other meshes. Others keep theirs.
    """
    meshes, of_mesh = np.unique(model, return_inverse=True)
    # Up to four meshes folds of the cross-validation are by photo.
    return np.where(model >= 0, of_mesh % FOLDS, fold) if (meshes >= 0).sum() > 4 else fold


def low_views(dataset: Dataset | StudioPhotos) -> np.ndarray:
    """Return indices of the photos of a dataset from below `MAX_ROLLED_ELEVATION`."""
    elevation = dataset.latents[:, layout_of_width(dataset.latents.shape[1]).at("elevation")]
    return np.flatnonzero(elevation < MAX_ROLLED_ELEVATION)


def photos_to_roll(dataset: Dataset | StudioPhotos) -> np.ndarray:
    """Return indices (M,) of the photos of a dataset that are rolled as well."""
    # Every other photo from a low elevation is also rolled, as a photo out of distribution.
    return low_views(dataset)[::2]


def roll_angles(count: int) -> np.ndarray:
    """Return degrees (count,) of `MIN_ROLL_DEG` or more either way, each subsequence spread evenly."""
    golden = (math.sqrt(5) - 1) / 2  # its multiples modulo one spread evenly (a Weyl sequence)
    return MIN_ROLL_DEG + (np.arange(count) * golden) % 1 * (360 - 2 * MIN_ROLL_DEG)


def roll_photos(images: np.ndarray, degrees: np.ndarray) -> np.ndarray:
    """Return photos (M, H, W, 3) uint8, each rolled about its centre; corners are filled by reflection."""
    rolled = [
        rotate(image, angle, (0, 1), reshape=False, order=1, mode="mirror")
        for image, angle in zip(images, degrees, strict=True)
    ]
    return np.stack(rolled) if rolled else images


def fit_count(dataset: Dataset | StudioPhotos) -> int:
    """Return how many fits `calibrate_fits` makes of a dataset."""
    if isinstance(dataset, StudioPhotos):
        return len(dataset) + len(dataset.others)
    return len(dataset) + len(photos_to_roll(dataset))


def samples_of(
    fits: Fits,
    dataset: Dataset | StudioPhotos,
    visible: np.ndarray,
    origin: np.ndarray,
    rolled_features: np.ndarray,
    symmetry: Symmetry = Symmetry.NONE,
) -> CalibrationSamples:
    """Return the samples of fits of a whole dataset, made without calibration.

    Args:
        fits: Fits of the photos of the dataset.
        dataset: Holds the true latents.
        visible: (N, H, W) bool, where the object is truly seen in the photos as they were fitted.
        origin: (M,) indices of the photos that were rolled, or of those without the object.
        rolled_features: (M, C) confidence features of the fits of these.
        symmetry: Symmetry of the class. Where any turn looks the same, a view is right by its elevation.
    """
    layout = layout_of_width(dataset.latents.shape[1])
    azimuth = layout.at("azimuth")
    true = symmetry.nearest(Latents.from_vector(dataset.latents), fits.latents[:, azimuth])
    error = fits.latents.astype(np.float64) - true.to_vector()
    error[:, azimuth] = angle_difference(error[:, azimuth], np.zeros(1))
    # A view is right within 15 degrees of azimuth.
    right = np.abs(error[:, azimuth if symmetry.fold else layout.at("elevation")]) < math.radians(15.0)
    weight, deviation = np.full(len(right), 1 / len(right)), fits.deviation.astype(np.float64)
    features, mask_right = fits.confidence_features, segmentation_iou(fits.masks, visible) >= MASK_RIGHT
    # Photos of a dataset, whose objects differ, count each by itself; below 0, where no number of a mesh is.
    number = np.arange(len(right))
    model, fold = dataset.model if isinstance(dataset, StudioPhotos) else -1 - number, number % FOLDS
    return CalibrationSamples(
        features, right, mask_right, error, deviation, weight, fold, model, rolled_features, origin % FOLDS
    )


def studio_errors(
    parts: Sequence[tuple[StudioPhotos, Recognizer]], run: FitRun, settings: ExplainSettings
) -> dict[str, Any]:
    """Return errors on photos that show the object, and the precision of the verdict "trusted".

    Args:
        parts: Photos, each with a network that has not seen their meshes.
        run: How fits are made.
        settings: Settings of the fits.

    Returns:
        `photos`, `trusted`, `trusted_right` (None where none is trusted), and in `methods` for "network" and
        "fit" medians of errors, degrees, shares of views within 15 and 30 degrees and turned by more than
        150, and the mean IoU of the visible pixels. Where any turn looks the same there is no azimuth, and a
        view is right by its elevation.
    """
    chosen, symmetry = resolve(settings, run.object_class, photo=True), run.object_class.symmetry
    columns: dict[str, list[np.ndarray]] = {"network": [], "fit": []}  # turn, tilt and IoU (3, N) each
    verdicts: list[str] = []
    for number, (photos, recognizer) in enumerate(parts):
        predicted = recognizer(linear_from_srgb(photos.images.astype(np.float32) / 255))
        fits = run.fit(photos.images, recognizer, chosen, str(number), predicted)
        verdicts += fits.verdicts
        true = Latents.from_vector(photos.latents)
        network = predicted.best(), predicted.mask.argmax(3) == 0
        for name, (found, mask) in {
            "network": network,
            "fit": (Latents.from_vector(fits.latents), fits.masks),
        }.items():
            turn = np.degrees(np.abs(symmetry.difference(found.azimuth, true.azimuth)))
            tilt = np.degrees(np.abs(found.elevation - true.elevation))
            columns[name].append(np.stack([turn, tilt, segmentation_iou(mask, photos.visible)]))
    methods = {}
    for name, values in columns.items():
        turn, tilt, iou = np.concatenate(values, axis=1)
        row = {"elevation_deg": float(np.median(tilt)), "visible_iou": float(iou.mean())}
        if symmetry.fold:
            row["azimuth_deg"] = float(np.median(turn))
            row |= {f"within_{most}": float((turn <= most).mean()) for most in (15, 30)}
            row["turned"] = float((turn > 150).mean())
        methods[name] = row
    trusted = np.array(verdicts) == "trusted"
    right = (turn if symmetry.fold else tilt)[trusted] <= 15  # by the fits, which come last
    return {
        "photos": len(trusted),
        "methods": methods,
        "trusted": float(trusted.mean()),
        "trusted_right": float(right.mean()) if trusted.any() else None,
    }

"""Fits of many photos, kept on disk in chunks, so that a run that was killed continues."""

import hashlib
import itertools
import json
import os
from collections.abc import Callable, Generator
from contextlib import closing
from dataclasses import dataclass, fields, replace
from pathlib import Path

import numpy as np
from safetensors import SafetensorError

from vig import __version__
from vig.inference import CONFIDENCE_FEATURES, ExplainSettings, Fit, explain_one, resolve
from vig.io.checks import check_arrays, decode, parse_json, read_tensors
from vig.io.errors import UserError
from vig.io.files import write_arrays
from vig.parallel.cluster import map_on_cluster
from vig.parallel.processes import Lost, map_in_processes
from vig.parallel.threads import map_on_threads, thread_limit
from vig.photo import Window
from vig.photo.masks import box_of
from vig.recognition import Prediction, Recognizer
from vig.recognition.find import upright
from vig.scene import ObjectClass, linear_from_srgb, srgb_from_linear
from vig_world.dataset import Dataset

CHUNK_PHOTOS = 50  # photos per file of the cache
MASKS = ("masks", "masks_by_pixel")
MIN_PHOTOS_FOR_PROCESSES = 150  # fewest photos for which processes are used: starting them takes seconds


@dataclass(frozen=True)
class Fits:
    """Fits of N photos.

    Attributes:
        latents: (N, P) float32.
        deviation: (N, P) float32, of each latent.
        masks: (N, H, W) bool, the visible pixels; the whole silhouette under a likelihood without outliers,
            as in the paper.
        masks_by_pixel: (N, H, W) bool, the same with each pixel decided independently.
        confidence_features: (N, C), see `vig.inference.Fit`.
        confidence: (N,), see there.
        verdicts: N names.
    """

    latents: np.ndarray
    deviation: np.ndarray
    masks: np.ndarray
    masks_by_pixel: np.ndarray
    confidence_features: np.ndarray
    confidence: np.ndarray
    verdicts: tuple[str, ...]

    @staticmethod
    def of(fits: list[Fit], silhouette_masks: bool) -> "Fits":
        """Stack single fits; `silhouette_masks`: masks are the whole silhouettes."""
        return Fits(
            np.concatenate([fit.latents.to_vector().astype(np.float32) for fit in fits]),
            np.stack([fit.deviation.astype(np.float32) for fit in fits]),
            np.stack([fit.amodal if silhouette_masks else fit.mask for fit in fits]),
            np.stack([fit.amodal if silhouette_masks else fit.mask_by_pixel for fit in fits]),
            np.stack([fit.confidence_features for fit in fits]),
            np.array([fit.confidence for fit in fits]),
            tuple(fit.verdict.name.lower() for fit in fits),
        )

    @staticmethod
    def concatenate(parts: "list[Fits]") -> "Fits":
        """Concatenate."""
        names = [field.name for field in fields(Fits) if field.name != "verdicts"]
        arrays = {name: np.concatenate([getattr(part, name) for part in parts]) for name in names}
        return Fits(**arrays, verdicts=tuple(itertools.chain(*(part.verdicts for part in parts))))


@dataclass(frozen=True)
class FitRun:
    """Settings that all fits of a run share.

    Attributes:
        object_class: Class of the objects.
        workers: Fits at a time; one per CPU by default.
        advance: Called with the number of fits made, or read, since its last call.
        cache: Keeps fits, chunk by chunk, in a folder for each name. A chunk is read from there when all that
            it depends on but the code is the same, and fitted again otherwise.
        processes: Workers may be processes, see `map_in_processes`: faster than threads for many photos, with
            the same fits; a script must then guard its main code by `if __name__ == "__main__"`.
        cluster: Address of a Ray cluster in place of workers, `auto` for the one of this machine.
    """

    object_class: ObjectClass
    workers: int | None = None
    advance: Callable[[int], None] = lambda done: None
    cache: Path | None = None
    processes: bool = False
    cluster: str | None = None

    def fit(
        self,
        images: np.ndarray,
        recognizer: Recognizer,
        settings: ExplainSettings,
        name: str,
        prediction: Prediction | None = None,
    ) -> Fits:
        """Fit photos from their prediction. After Ctrl-C, fits that were not begun are not waited for.

        Args:
            images: The photos as uint8 sRGB (N, H, W, 3).
            recognizer: Predicts where fits start.
            settings: Settings of the fits.
            name: Name of the photos, in the cache.
            prediction: The recognizer's, where it was made before.

        Raises:
            UserError: There is no such cluster, or too many of its processes died of one photo.
        """
        photos = linear_from_srgb(images.astype(np.float32) / 255)
        prediction = recognizer(photos) if prediction is None else prediction
        workers, folder = self.workers or os.cpu_count() or 1, self.cache and self.cache / name
        key = cache_key(recognizer, self.object_class, settings)
        chunks = [
            range(start, min(start + CHUNK_PHOTOS, len(images)))
            for start in range(0, len(images), CHUNK_PHOTOS)
        ]
        keys = [hashlib.sha256(key.encode() + images[chunk].tobytes()).hexdigest() for chunk in chunks]
        paths = [None if folder is None else folder / f"{chunk.start:06d}.safetensors" for chunk in chunks]
        parts = [
            None if path is None else _read(path, chunk_key)
            for path, chunk_key in zip(paths, keys, strict=True)
        ]
        missing = [chunk_number for chunk_number, part in enumerate(parts) if part is None]
        todo = [index for chunk_number in missing for index in chunks[chunk_number]]
        self.advance(len(images) - len(todo))
        fit_stream = self._fit_photos(
            [(photos[i], *prediction[i : i + 1].arrays) for i in todo], settings, workers
        )
        done: dict[int, dict[int, Fits]] = {chunk_number: {} for chunk_number in missing}
        with closing(fit_stream):
            for position, fit in fit_stream:
                index = todo[position]
                chunk_number = index // CHUNK_PHOTOS
                done[chunk_number][index] = fit
                self.advance(1)
                if len(done[chunk_number]) < len(chunks[chunk_number]):
                    continue
                fits_of_chunk = done.pop(chunk_number)
                part = parts[chunk_number] = Fits.concatenate(
                    [fits_of_chunk[photo] for photo in chunks[chunk_number]]
                )
                path = paths[chunk_number]
                if path is not None:
                    _write(path, part, keys[chunk_number])
        return Fits.concatenate([part for part in parts if part is not None])

    def _fit_photos(
        self, photos: "list[PhotoArrays]", settings: ExplainSettings, workers: int
    ) -> Generator[tuple[int, Fits]]:
        """Yield numbers of photos and their fits, as they are done."""
        shared = self.object_class, settings
        if self.cluster is not None and photos:
            for number, fit in map_on_cluster(_photo_fitter, shared, photos, self.cluster):
                if isinstance(fit, Lost):
                    raise UserError(
                        f"processes of the cluster were killed {fit.attempts} times at the same photo,"
                        " possibly out of memory; what is done stays. Give each task more memory and run it"
                        " again."
                    )
                yield number, fit
        elif self.processes and workers > 1 and len(photos) >= MIN_PHOTOS_FOR_PROCESSES:
            yield from enumerate(map_in_processes(_photo_fitter, shared, photos, workers))
        else:
            with thread_limit(workers):
                yield from enumerate(map_on_threads(_photo_fitter(shared), photos))


PhotoArrays = tuple[np.ndarray, ...]  # a photo (H, W, 3), linear RGB, then the arrays of its prediction


def _photo_fitter(shared: tuple[ObjectClass, ExplainSettings]) -> Callable[[PhotoArrays], Fits]:
    """Return the function that fits one photo from its prediction, in any process."""
    object_class, settings = shared

    def fit_one(arrays: PhotoArrays) -> Fits:
        photo, *parts = map(np.array, arrays)  # copies: arrays from a cluster are read-only
        prediction = Prediction(*parts, symmetry=object_class.symmetry)
        fit = explain_one(photo, prediction, object_class, settings)
        return Fits.of([fit], settings.likelihood.alpha == 1)

    return fit_one


def cache_key(recognizer: Recognizer, object_class: ObjectClass, settings: ExplainSettings) -> str:
    """Return a hash of everything that a fit depends on, but for its photo and the code."""
    uncalibrated = replace(settings, calibration=None)
    digest = hashlib.sha256(
        f"{__version__} {object_class.fingerprint} {uncalibrated!r} {CONFIDENCE_FEATURES}".encode()
    )
    calibration = settings.calibration_for(object_class)
    if calibration is not None:
        digest.update(calibration.to_json().encode())
    for name, array in sorted(recognizer.arrays().items()):
        digest.update(name.encode() + np.ascontiguousarray(array).tobytes())
    arrays = [object_class.light_prior_mean, object_class.light_prior_covariance]
    for array in arrays + ([] if object_class.transfer is None else [object_class.transfer]):
        digest.update(np.ascontiguousarray(array).tobytes())
    return digest.hexdigest()


def _read(path: Path, key: str) -> Fits | None:
    """Read a chunk; None when it is missing, unreadable or of another key."""
    try:
        tensors, metadata = read_tensors(path, finite=False)
        if metadata["key"] != key:
            return None
        size = decode(tuple[int, int, int], parse_json(metadata["size"]))
        row = -(-size[1] * size[2] // 8)
        bits, floats = ("uint8", (size[0], row)), "float32 float64"
        count = (floats, (size[0],))
        latents: tuple[str, tuple[int | str, ...]] = (floats, (size[0], "P"))
        rows = {"latents": latents, "deviation": latents, "masks": bits, "masks_by_pixel": bits}
        check_arrays(tensors, rows | {"confidence_features": (floats, (size[0], "C")), "confidence": count})
        for name in MASKS:
            flat = np.unpackbits(tensors[name], axis=1, count=size[1] * size[2])
            tensors[name] = flat.astype(bool).reshape(size)
        return Fits(**tensors, verdicts=decode(tuple[str, ...], parse_json(metadata["verdicts"])))
    except (OSError, KeyError, TypeError, ValueError, SafetensorError):
        return None


def _write(path: Path, fits: Fits, key: str) -> None:
    tensors = {name: value for name, value in vars(fits).items() if name != "verdicts"}
    for name in MASKS:
        tensors[name] = np.packbits(tensors[name].reshape(len(fits.masks), -1), axis=1)
    metadata = {"key": key, "size": json.dumps(fits.masks.shape), "verdicts": json.dumps(fits.verdicts)}
    write_arrays(path, tensors, metadata)


def frame_images(dataset: Dataset, recognizer: Recognizer) -> tuple[np.ndarray, np.ndarray]:
    """Return images (N, H, W, 3) uint8 sRGB as fits take them, and visible pixels (N, H, W) bool.

    Those of the paper's world are unchanged. For photographs the box of the object's whole silhouette is
    given, as to `vig fit --boxes`, and the window is turned as the network sees the object rolled.
    """
    dataset = dataset.at_network_size()
    if dataset.world == "paper":
        return dataset.images, dataset.visible
    images, visible = np.empty_like(dataset.images), np.empty_like(dataset.visible)
    for number, (image, silhouette) in enumerate(zip(dataset.images, dataset.amodal, strict=True)):
        linear = linear_from_srgb(image.astype(np.float32) / 255)
        height, width = silhouette.shape
        window = upright(linear, Window.of(width, height, box_of_silhouette(silhouette)), recognizer)
        cropped, _ = window.crop(linear)
        images[number] = (srgb_from_linear(cropped) * 255).round()
        visible_channels = np.repeat(dataset.visible[number][..., None].astype(np.float32), 3, axis=2)
        mask, inside = window.crop(visible_channels)
        visible[number] = (mask[..., 0] > 0.5) & inside
    return images, visible


def fit_settings(settings: ExplainSettings, object_class: ObjectClass, dataset: Dataset) -> ExplainSettings:
    """Return settings of the fits of such images."""
    return resolve(settings, object_class, photo=dataset.world != "paper")


def box_of_silhouette(silhouette: np.ndarray) -> tuple[float, float, float, float] | None:
    """Return the box of a silhouette (H, W) bool; None where a side is under 8 pixels."""
    box = box_of(silhouette)
    return None if box is None or min(box[2:]) < 8 else box

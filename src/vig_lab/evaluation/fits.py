"""Fits of many photos, kept on disk in chunks, so that what was fitted stays fitted when a run is killed."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Generator
from contextlib import closing
from dataclasses import dataclass, replace
from itertools import islice
from pathlib import Path

import numpy as np
import torch
from safetensors import SafetensorError
from safetensors.numpy import save_file

from vig import __version__
from vig.checks import check_arrays, decode, parse_json, read_tensors
from vig.files import atomic_write
from vig.inference import CONFIDENCE_FEATURES, ExplainSettings, Fit, calibration_of, explain_one
from vig.likelihood import load_kernels
from vig.parallel.processes import map_in_processes
from vig.parallel.threads import map_on_threads
from vig.recognition import Prediction, Recognizer
from vig.scene import ObjectClass
from vig_world.generation.describe import class_fingerprint

CHUNK = 50
"""Photos to a file."""
LEAST_APART = 150
"""Photos that are worth processes of their own, which take seconds to start."""


@dataclass(frozen=True)
class Fits:
    """N photos explained.

    latents, deviation (N, P) float32. masks, masks_by_pixel (N, H, W) bool: the visible pixels, and what each
    by itself would say; under a pixel model without outliers the whole silhouette, as in the paper. clues
    (N, C), confidence (N,): see `vig.inference.Fit`. verdicts: N names.
    """

    latents: np.ndarray
    deviation: np.ndarray
    masks: np.ndarray
    masks_by_pixel: np.ndarray
    confidence_features: np.ndarray
    confidence: np.ndarray
    verdicts: tuple[str, ...]

    @staticmethod
    def of(fits: list[Fit], whole: bool) -> Fits:
        """The same of explanations; whole: the silhouette is the mask."""
        return Fits(
            np.concatenate([fit.latents.to_vector().float().numpy() for fit in fits]),
            np.stack([fit.deviation.float().numpy() for fit in fits]),
            np.stack([(fit.amodal if whole else fit.mask).numpy() for fit in fits]),
            np.stack([(fit.amodal if whole else fit.mask_by_pixel).numpy() for fit in fits]),
            np.stack([fit.confidence_features.numpy() for fit in fits]),
            np.array([fit.confidence for fit in fits]),
            tuple(fit.verdict.name.lower() for fit in fits),
        )

    @staticmethod
    def joined(parts: list[Fits]) -> Fits:
        """One after another."""
        return Fits(
            np.concatenate([part.latents for part in parts]),
            np.concatenate([part.deviation for part in parts]),
            np.concatenate([part.masks for part in parts]),
            np.concatenate([part.masks_by_pixel for part in parts]),
            np.concatenate([part.confidence_features for part in parts]),
            np.concatenate([part.confidence for part in parts]),
            tuple(verdict for part in parts for verdict in part.verdicts),
        )


def fit_all(
    images: np.ndarray,
    photos: torch.Tensor,
    prediction: Prediction,
    object_class: ObjectClass,
    settings: ExplainSettings,
    workers: int,
    advance: Callable[[int], None] = lambda done: None,
    folder: Path | None = None,
    key: str = "",
    processes: bool = False,
) -> Fits:
    """Fit photos (N, H, W, 3) linear RGB from their prediction, `workers` at a time.

    images: the same, uint8 sRGB. folder: keeps fits, chunk by chunk; a chunk is taken from there when its
    `key` (see `key_of`) and its images are the same, and fitted again otherwise. After Ctrl-C nobody waits
    for fits that were not begun. processes: workers may be processes, see `map_in_processes`, which are
    quicker than threads where there are photos enough, and give the same fits.
    """
    load_kernels(torch.float32, object_class.shape_model.modes)
    chunks = [range(start, min(start + CHUNK, len(images))) for start in range(0, len(images), CHUNK)]
    keys = [hashlib.sha256(key.encode() + images[chunk].tobytes()).hexdigest() for chunk in chunks]
    paths = [None if folder is None else folder / f"{chunk.start:06d}.safetensors" for chunk in chunks]
    parts = [None if path is None else _read(path, own) for path, own in zip(paths, keys, strict=True)]
    missing = [number for number, part in enumerate(parts) if part is None]
    todo = [index for number in missing for index in chunks[number]]
    advance(len(images) - len(todo))
    apart = processes and workers > 1 and len(todo) >= LEAST_APART
    fitted = (_fitted_apart if apart else _fitted_here)(
        [(photos[i], prediction[i : i + 1]) for i in todo], object_class, settings, workers
    )
    with closing(fitted):
        for number in missing:
            single = []
            for fit in islice(fitted, len(chunks[number])):
                single.append(fit)
                advance(1)
            part = parts[number] = Fits.joined(single)
            path = paths[number]
            if path is not None:
                _write(path, part, keys[number])
    return Fits.joined([part for part in parts if part is not None])


Photo = tuple[torch.Tensor, Prediction]
Arrays = tuple[np.ndarray, ...]
"""A photo and the parts of its prediction."""
Shared = tuple[ObjectClass, ExplainSettings]


def _fitting(shared: Shared) -> Callable[[Photo], Fits]:
    """The function that fits one photo, from its prediction, in any process."""
    object_class, settings = shared
    load_kernels(torch.float32, object_class.shape_model.modes)

    def one(photo: Photo) -> Fits:
        return Fits.of([explain_one(*photo, object_class, settings)], settings.likelihood.alpha == 1)

    return one


def _fitted_here(
    photos: list[Photo], object_class: ObjectClass, settings: ExplainSettings, workers: int
) -> Generator[Fits]:
    before = torch.get_num_threads()
    torch.set_num_threads(workers)
    try:
        yield from map_on_threads(_fitting((object_class, settings)), photos)
    finally:
        torch.set_num_threads(before)


def _fitted_apart(
    photos: list[Photo], object_class: ObjectClass, settings: ExplainSettings, workers: int
) -> Generator[Fits]:
    arrays = (_arrays(photo, prediction) for photo, prediction in photos)
    yield from map_in_processes(_fitting_arrays, (object_class, settings), arrays, workers)


def _arrays(photo: torch.Tensor, prediction: Prediction) -> Arrays:
    return photo.numpy(), *(tensor.numpy() for tensor in vars(prediction).values())


def _fitting_arrays(shared: Shared) -> Callable[[Arrays], Fits]:
    """`_fitting` of what can be sent to another process."""
    fitted = _fitting(shared)

    def one(arrays: Arrays) -> Fits:
        photo, *parts = map(torch.from_numpy, arrays)
        return fitted((photo, Prediction(*parts)))

    return one


def key_of(recognizer: Recognizer, object_class: ObjectClass, settings: ExplainSettings) -> str:
    """A hash of all that a fit depends on but its photo and the code: weights, class, settings, version."""
    plain = replace(settings, calibration=None)
    digest = hashlib.sha256(
        f"{__version__} {class_fingerprint(object_class)} {plain!r} {CONFIDENCE_FEATURES}".encode()
    )
    own = {name: value for name, value in vars(recognizer).items() if isinstance(value, torch.Tensor)}
    own |= recognizer.calibration.tensors()
    calibration = (settings.calibration or calibration_of(object_class)) if settings.calibrated else None
    if calibration is not None:
        digest.update(calibration.to_json().encode())
    for name, tensor in sorted((recognizer.network.state_dict() | own).items()):
        digest.update(name.encode())
        digest.update(tensor.contiguous().reshape(-1).view(torch.uint8).numpy().tobytes())
    arrays = [object_class.light_prior_mean, object_class.light_prior_covariance]
    for array in arrays + ([] if object_class.transfer is None else [object_class.transfer]):
        digest.update(np.ascontiguousarray(array).tobytes())
    return digest.hexdigest()


def _read(path: Path, key: str) -> Fits | None:
    """A chunk of that key; None when there is none, or one of another key or unreadable."""
    try:
        held, told = read_tensors(path, finite=False)
        if told["key"] != key:
            return None
        size = decode(tuple[int, int, int], parse_json(told["size"]))
        row = -(-size[1] * size[2] // 8)
        bits, floats = ("uint8", (size[0], row)), "float32 float64"
        rows: dict[str, tuple[str, tuple[int | str, ...]]]
        rows = {"latents": (floats, (size[0], "P")), "deviation": (floats, (size[0], "P"))}
        rows |= {"confidence_features": (floats, (size[0], "C")), "confidence": (floats, (size[0],))}
        check_arrays(held, rows | {"masks": bits, "masks_by_pixel": bits})
        masks, by_pixel = (
            np.unpackbits(held[name], axis=1, count=size[1] * size[2]).astype(bool).reshape(size)
            for name in ("masks", "masks_by_pixel")
        )
        return Fits(
            held["latents"],
            held["deviation"],
            masks,
            by_pixel,
            held["confidence_features"],
            held["confidence"],
            decode(tuple[str, ...], parse_json(told["verdicts"])),
        )
    except (OSError, KeyError, TypeError, ValueError, SafetensorError):
        return None


def _write(path: Path, fits: Fits, key: str) -> None:
    tensors = {
        "latents": fits.latents,
        "deviation": fits.deviation,
        "masks": np.packbits(fits.masks.reshape(len(fits.masks), -1), axis=1),
        "masks_by_pixel": np.packbits(fits.masks_by_pixel.reshape(len(fits.masks), -1), axis=1),
        "confidence_features": fits.confidence_features,
        "confidence": fits.confidence,
    }
    told = {"key": key, "size": json.dumps(fits.masks.shape), "verdicts": json.dumps(fits.verdicts)}
    with atomic_write(path) as temporary:
        save_file(tensors, temporary, told)

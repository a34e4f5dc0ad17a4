"""Fits of many photos, kept on disk in chunks, so that what was fitted stays fitted when a run is killed."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import torch
from safetensors import SafetensorError, safe_open
from safetensors.numpy import save_file

from vig import __version__
from vig.dataset.format import class_fingerprint
from vig.files import atomic_write
from vig.inference import ExplainSettings, Explanation, calibration_of, explain_one
from vig.likelihood import load_kernels
from vig.recognition import Prediction, Recognizer
from vig.render import map_on_threads
from vig.scene import ObjectClass

CHUNK = 50
"""Photos to a file."""


@dataclass(frozen=True)
class Fits:
    """N photos explained.

    latents, deviation (N, P) float32. masks (N, H, W) bool: the visible pixels, under a pixel model without
    outliers the whole silhouette, as in the paper. clues (N, C), confidence (N,): see
    `vig.inference.Explanation`. verdicts: N names.
    """

    latents: np.ndarray
    deviation: np.ndarray
    masks: np.ndarray
    clues: np.ndarray
    confidence: np.ndarray
    verdicts: tuple[str, ...]

    @staticmethod
    def of(fits: list[Explanation], whole: bool) -> Fits:
        """The same of explanations; whole: the silhouette is the mask."""
        return Fits(
            np.concatenate([fit.latents.to_vector().float().numpy() for fit in fits]),
            np.stack([fit.deviation.float().numpy() for fit in fits]),
            np.stack([(fit.amodal if whole else fit.mask).numpy() for fit in fits]),
            np.stack([fit.clues.numpy() for fit in fits]),
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
            np.concatenate([part.clues for part in parts]),
            np.concatenate([part.confidence for part in parts]),
            tuple(verdict for part in parts for verdict in part.verdicts),
        )


def fit_all(
    images: np.ndarray,
    photos: torch.Tensor,
    prediction: Prediction,
    object_class: ObjectClass,
    settings: ExplainSettings,
    threads: int,
    advance: Callable[[int], None] = lambda done: None,
    folder: Path | None = None,
    key: str = "",
) -> Fits:
    """Fit photos (N, H, W, 3) linear RGB from their prediction, `threads` at a time.

    images: the same, uint8 sRGB. folder: keeps fits, chunk by chunk; a chunk is taken from there when its
    `key` (see `key_of`) and its images are the same, and fitted again otherwise. After Ctrl-C nobody waits
    for fits that were not begun.
    """
    load_kernels(torch.float32, object_class.shape_model.modes)

    def one(index: int) -> Explanation:
        fit = explain_one(photos[index], prediction[index : index + 1], object_class, settings)
        advance(1)
        return fit

    parts = []
    before = torch.get_num_threads()
    torch.set_num_threads(threads)
    try:
        for start in range(0, len(images), CHUNK):
            chosen = range(start, min(start + CHUNK, len(images)))
            path = None if folder is None else folder / f"{start:06d}.safetensors"
            chunk_key = hashlib.sha256(key.encode() + images[chosen].tobytes()).hexdigest()
            part = None if path is None else _read(path, chunk_key)
            if part is None:
                part = Fits.of(list(map_on_threads(one, chosen)), settings.likelihood.alpha == 1)
                if path is not None:
                    _write(path, part, chunk_key)
            else:
                advance(len(chosen))
            parts.append(part)
    finally:
        torch.set_num_threads(before)
    return Fits.joined(parts)


def key_of(recognizer: Recognizer, object_class: ObjectClass, settings: ExplainSettings) -> str:
    """A hash of all that a fit depends on but its photo and the code: weights, class, settings, version."""
    plain = replace(settings, calibration=None)
    digest = hashlib.sha256(f"{__version__} {class_fingerprint(object_class)} {plain!r}".encode())
    own = {name: value for name, value in vars(recognizer).items() if isinstance(value, torch.Tensor)}
    if settings.visible_prior is not None:
        own["visible_prior"] = settings.visible_prior  # whose repr leaves numbers out
    own |= recognizer.calibration.tensors()
    calibration = settings.calibration or calibration_of(object_class)
    if calibration is not None and settings.calibrated:
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
        with safe_open(path, framework="np") as file:
            told = file.metadata()
            if told["key"] != key:
                return None
            size = tuple(json.loads(told["size"]))
            bits = np.unpackbits(file.get_tensor("masks"), axis=1, count=size[1] * size[2])
            return Fits(
                file.get_tensor("latents"),
                file.get_tensor("deviation"),
                bits.astype(bool).reshape(size),
                file.get_tensor("clues"),
                file.get_tensor("confidence"),
                tuple(json.loads(told["verdicts"])),
            )
    except (OSError, KeyError, TypeError, ValueError, SafetensorError):
        return None


def _write(path: Path, fits: Fits, key: str) -> None:
    tensors = {
        "latents": fits.latents,
        "deviation": fits.deviation,
        "masks": np.packbits(fits.masks.reshape(len(fits.masks), -1), axis=1),
        "clues": fits.clues,
        "confidence": fits.confidence,
    }
    told = {"key": key, "size": json.dumps(fits.masks.shape), "verdicts": json.dumps(fits.verdicts)}
    with atomic_write(path) as temporary:
        save_file(tensors, temporary, told)

"""Images of a dataset as fits take them: of photographs the window of the object's box, turned upright."""

from __future__ import annotations

import numpy as np

from vig.inference import ExplainSettings, FitSettings, resolve
from vig.photo import Window
from vig.photo.masks import box_of
from vig.recognition import Recognizer
from vig.recognition.find import upright
from vig.scene import ObjectClass, linear_from_srgb, srgb_from_linear
from vig_world.dataset import Dataset

MIN_BOX_SIDE = 8
"""Least side of a box, pixels; where the object's is smaller the whole image is taken."""


def frame_images(dataset: Dataset, recognizer: Recognizer) -> tuple[np.ndarray, np.ndarray]:
    """Images (N, H, W, 3) uint8 sRGB, and the object's visible pixels in them (N, H, W) bool.

    Those of the paper's world are as they are. Of photographs the box of the object's whole silhouette is
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


def fit_settings(settings: ExplainSettings, object_class: ObjectClass, dataset: Dataset) -> FitSettings:
    """Settings of the fits of such images."""
    return resolve(settings, object_class, photo=dataset.world == "photo")


def box_of_silhouette(silhouette: np.ndarray) -> tuple[float, float, float, float] | None:
    """The box of a silhouette (H, W) bool."""
    box = box_of(silhouette)
    return None if box is None or min(box[2:]) < MIN_BOX_SIDE else box

"""What the library answers for a photo."""

from __future__ import annotations

import io
import math
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import torch
from PIL import Image

from vig.errors import UserError
from vig.inference import Fit, Verdict, family_of
from vig.photo import Window
from vig.photo.images import linear_photo
from vig.renderer import render_latents
from vig.report import describe, overlay, write_explanation
from vig.scene import Camera, Latents, ObjectClass, srgb8_from_linear


@dataclass(frozen=True, eq=False)
class Explanation:
    """What explains the object in one photo of H x W pixels.

    Attributes:
        picture: (H, W, 3) uint8 sRGB or float32 linear RGB; `photo` is linear in any case.
        window: The square of the photo that was fitted.
        fit: The fit in that window: latents, deviations, masks of the window, evidence.
        object_class: What the photo was explained as.
        farther: Distance of the eye and focal length of the fit, of the standard camera's.
    """

    picture: np.ndarray
    window: Window
    fit: Fit
    object_class: ObjectClass
    farther: float = 1.0

    @property
    def photo(self) -> np.ndarray:
        """The photo (H, W, 3) float32, linear RGB."""
        return linear_photo(self.picture)

    @property
    def verdict(self) -> Verdict:
        """How far the explanation can be believed."""
        return self.fit.verdict

    @property
    def reason(self) -> str:
        """One sentence on the verdict."""
        return self.fit.reason

    @property
    def confidence(self) -> float:
        """Probability that the view is right, NaN for a class without calibration."""
        return self.fit.confidence

    @property
    def latents(self) -> Latents:
        """All numbers of the explanation (B = 1)."""
        return self.fit.latents

    @property
    def alternatives(self) -> tuple[Latents, ...]:
        """Other explanations within reach, none unless the verdict is `AMBIGUOUS`."""
        return () if self.fit.alternative is None else (self.fit.alternative,)

    @property
    def azimuth_deg(self) -> float:
        """The eye's azimuth about the object's vertical axis, degrees in [0, 360).

        Of views that look the same the first: in [0, 180) where half a turn shows the same, 0 where any does.
        """
        return math.degrees(float(self.latents.azimuth)) % 360

    @property
    def elevation_deg(self) -> float:
        """The eye's elevation above the object's horizon, degrees."""
        return math.degrees(float(self.latents.elevation))

    @property
    def roll_deg(self) -> float:
        """By how far the photo is turned clockwise about the object, degrees."""
        return math.degrees(self.camera.roll)

    @cached_property
    def camera(self) -> Camera:
        """The camera of the whole photo; `camera.K` is its intrinsic matrix.

        A focal length that the photo does not tell is a guess, see `Explainer.explain`; distance follows from
        it, as an object's size and distance are only known as their ratio.
        """
        height, width = self.picture.shape[:2]
        window = self.object_class.camera(farther=self.farther)
        return self.window.camera(window.framed(*self.fit.framing.tolist()), width, height)

    @cached_property
    def camera_from_object(self) -> np.ndarray:
        """Pose (4, 4) float64, metres: OpenCV camera axes from the object's frame (Z up, +X `front`)."""
        return self.camera.camera_from_world(float(self.latents.azimuth), float(self.latents.elevation))

    @cached_property
    def amodal(self) -> np.ndarray:
        """All pixels (H, W) bool that the object covers, hidden ones included."""
        return self.window.back(self.fit.amodal.float().numpy(), *self.picture.shape[1::-1]) > 0.5

    @cached_property
    def mask(self) -> np.ndarray:
        """The pixels (H, W) bool in which the object is seen."""
        seen = self.window.back(self.fit.mask.float().numpy(), *self.picture.shape[1::-1]) > 0.5
        visible: np.ndarray = seen & self.amodal
        return visible

    @cached_property
    def box(self) -> tuple[int, int, int, int] | None:
        """x, y, width, height in pixels round what the object covers of the photo; None for nothing."""
        rows, columns = (np.flatnonzero(self.amodal.any(axis)) for axis in (1, 0))
        if not len(rows):
            return None
        x, y = int(columns[0]), int(rows[0])
        return x, y, int(columns[-1]) + 1 - x, int(rows[-1]) + 1 - y

    @property
    def hidden_fraction(self) -> float | None:
        """Share of the object's pixels within the photo that something hides; None when there are none."""
        covered = int(self.amodal.sum())
        return 1 - int(self.mask.sum()) / covered if covered else None

    @property
    def vertices(self) -> np.ndarray:
        """The object's vertices (V, 3) float32, metres, in its own frame; faces are the class's."""
        return self.object_class.shape_model.vertices(self.latents.shape)[0].numpy()

    def render(
        self,
        light: np.ndarray | None = None,
        albedo: np.ndarray | None = None,
        camera: Camera | None = None,
        azimuth_deg: float | None = None,
        elevation_deg: float | None = None,
    ) -> np.ndarray:
        """Draw the explained object in front of nothing: as it was seen, or relit, repainted, turned.

        Args:
            light: (9,) SH coefficients of incident radiance in the world frame.
            albedo: (3,) linear RGB in [0, 1].
            camera: In place of the photo's; its width and height are those of the picture.
            azimuth_deg: In place of the explained azimuth.
            elevation_deg: In place of the explained elevation.

        Returns:
            (H, W, 4) float32: linear RGB, and the share of each pixel that the object covers.

        Raises:
            UserError: An argument has another shape or is not finite, or the albedo is not in [0, 1].
        """
        if camera is not None and not isinstance(camera, Camera):
            raise UserError(f"camera must be a vig.Camera; got a {type(camera).__name__}. Pass a Camera.")
        changed: dict[str, torch.Tensor] = {}
        for name, size, given in (("light", 9, light), ("albedo", 3, albedo)):
            if given is not None:
                changed[name] = _numbers(name, size, given, 1.0 if name == "albedo" else math.inf)
        for name, angle in (("azimuth", azimuth_deg), ("elevation", elevation_deg)):
            if angle is not None:
                changed[name] = torch.deg2rad(_numbers(f"{name}_deg", 1, [angle], math.inf)[0])
        drawn = render_latents(
            replace(self.latents, **changed), self.object_class, camera or self.camera, samples=2
        )
        return torch.cat([drawn.rgb[0], drawn.coverage[0, :, :, None]], dim=-1).numpy()

    def overlay(self) -> np.ndarray:
        """The photo (H, W, 3) uint8 with the object's outline in yellow, its hidden pixels tinted pink."""
        coded = self.picture if self.picture.dtype == np.uint8 else srgb8_from_linear(self.picture)
        return overlay(coded, self.amodal, self.mask)

    def to_dict(self) -> dict[str, Any]:
        """What `explanation.json` holds."""
        whole = describe(self.fit, self.object_class, self.window, self.camera, self.hidden_fraction)
        family = family_of(self.latents.shape[0], self.object_class)
        return whole | {"family": family, "box": self.box and list(self.box)}

    def save(self, folder: str | Path) -> Path:
        """Write explanation.json, overlay.png, mask.png and object.glb, as `vig fit`; returns the folder.

        Raises:
            UserError: The folder cannot be written.
        """
        if not isinstance(folder, str | Path):
            raise UserError(f"expected a folder's path; got a {type(folder).__name__}. Pass its name.")
        folder = Path(folder)
        described, latents = self.to_dict(), self.latents
        write_explanation(
            folder, described, self.overlay(), self.amodal, self.mask, latents, self.object_class
        )
        return folder

    def __repr__(self) -> str:
        height, width = self.picture.shape[:2]
        hidden = "" if self.hidden_fraction is None else f", {self.hidden_fraction:.0%} hidden"
        return (
            f"Explanation({self.object_class.name} in {width} x {height}: {self.verdict.name.lower()},"
            f" azimuth {self.azimuth_deg:.1f}, elevation {self.elevation_deg:.1f} degrees{hidden})"
        )

    def _repr_png_(self) -> bytes:
        """The overlay, for notebooks."""
        data = io.BytesIO()
        Image.fromarray(self.overlay()).save(data, format="PNG")
        return data.getvalue()


def _numbers(name: str, size: int, given: Any, most: float) -> torch.Tensor:
    """(1, size) float32 from an argument of `Explanation.render`."""
    try:
        array: np.ndarray = np.asarray(given, np.float32)
        came = f"shape {array.shape}, {str(given)[:60]}"
    except (TypeError, ValueError):
        array, came = np.empty(0), str(given)[:60]
    if array.shape != (size,) or not np.isfinite(array).all():
        numbers = f"{size} finite number{'s' * (size > 1)}"
        raise UserError(f"{name} must be {numbers}; got {came}. Pass {'an array' if size > 1 else 'one'}.")
    if most < math.inf and not ((array >= 0) & (array <= most)).all():
        remedy = "Are these 8-bit values? Divide by 255." if array.max() > most else "Clip it."
        came = f"{array.min():g} to {array.max():g}"
        raise UserError(f"{name} must be linear RGB in [0, 1]; got {came}. {remedy}")
    return torch.from_numpy(array)[None]

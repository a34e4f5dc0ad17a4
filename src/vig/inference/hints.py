"""Prior knowledge of the object in a window, and its use in a fit."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from enum import IntEnum

import numpy as np

from vig.recognition import Prediction, box_in_window
from vig.recognition.prediction import bin_centres
from vig.scene import Camera, LatentLayout, ObjectClass, ShapeModel

POINT_NOISE = 0.02
"""Standard deviation of a named point, in sides of the window, both of clicks and of the class's points."""
POINT_WEIGHT = 100.0
"""Exponent of the points' Gaussian: evidence counts pixels as independent, which they are not."""
COARSE_NOISE = 0.08
"""Standard deviation of a point where views are compared before the shape is fitted."""
MIN_VIEW = 0.002
"""Probability added to each bin of azimuth: the network may rule out the user's view."""
VIEW_SPREAD = math.radians(8.0)
"""Standard deviation about an azimuth that a user gives."""
ELEVATION_SPREAD = math.radians(4.0)
"""Standard deviation about an elevation that a user gives, radians."""

EXCLUDED_LABEL_NATS = 8.0
"""Nats against labels that a user excludes for a pixel: finite, as strokes are imprecise."""


COMPLEX_STEP = 1e-30
"""Imaginary step by which derivatives of places are found, see `ReprojectionTerm`."""


class PixelLabel(IntEnum):
    """A user's label of a pixel."""

    UNKNOWN = 0
    SEEN = 1
    """The object is visible."""
    IN_FRONT = 2
    """It is not: something is in front of it, or it is not there."""
    BACKGROUND = 3
    """It is not there, not even hidden."""


@dataclass(frozen=True, eq=False)
class WindowHints:
    """Hints in a window of S x S pixels, for its fit.

    Attributes:
        labels: (S, S) uint8, `PixelLabel`.
        visible: Nothing hides any of the object.
        vertices: (J,) of the class's named points.
        places: (J, 2) of these points, in sides of the window.
        azimuth: Radians, as `elevation`; None where unknown.
        elevation: Known to `ELEVATION_SPREAD`.
        held: Single latents of a fit that are held, radians: "elevation", "roll".
        box: x, y, w, h of the whole object, in sides of the window; None where it is not known, or turned.
    """

    labels: np.ndarray
    visible: bool
    vertices: np.ndarray
    places: np.ndarray
    azimuth: float | None
    elevation: float | None
    held: Mapping[str, float]
    box: tuple[float, float, float, float] | None = None

    def terms(
        self, object_class: ObjectClass, camera: Camera, layout: LatentLayout
    ) -> list[ReprojectionTerm]:
        """Return the terms that the hints add to the objective of a camera."""
        projection = Projection(object_class.shape_model, camera, layout)
        terms: list[ReprojectionTerm] = []
        if len(self.vertices):
            terms.append(PointTerm(self.vertices, self.places, projection))
        if self.box is not None:
            terms.append(BoxTerm(self.box, projection))
        return terms

    def correct_prediction(
        self, prediction: Prediction, object_class: ObjectClass, camera: Camera
    ) -> Prediction:
        """Return the prediction (N = 1) of a network that knew the hints.

        Labelled pixels have that class; elevation and azimuth are about those given; each
        bin of azimuth is weighted by its agreement with the points, framed by the mask's box.
        """
        numbers, deviation = prediction.numbers.copy(), prediction.deviation.copy()
        azimuth = prediction.azimuth
        visible, hidden, background = np.moveaxis(prediction.mask[0], -1, 0)
        if self.visible:
            visible, hidden = visible + hidden, np.zeros_like(hidden)
        # A pixel that does not show the object is hidden or background, in the ratio that was predicted.
        hidden_share = hidden / np.maximum(hidden + background, 1e-6)
        away = np.stack([np.zeros_like(visible), hidden_share, 1 - hidden_share], axis=-1)
        classes = np.stack([visible, hidden, background], axis=-1)
        for kind, share in ((PixelLabel.SEEN, np.array([1, 0, 0], np.float32)), (PixelLabel.IN_FRONT, away),
                            (PixelLabel.BACKGROUND, np.array([0, 0, 1], np.float32))):  # fmt: skip
            classes = np.where((self.labels == kind)[..., None], share, classes)
        if self.elevation is not None:
            place = prediction.layout["elevation"]
            numbers[:, place], deviation[:, place] = self.elevation, ELEVATION_SPREAD
        changed = replace(prediction, mask=classes[None], numbers=numbers, deviation=deviation)
        if prediction.symmetry.fold and (self.azimuth is not None or len(self.vertices)):
            bins = azimuth.shape[1]
            # Bins of a symmetric class share the circle's 1 / fold part.
            centres = bin_centres(bins, prediction.symmetry.fold)
            weight = azimuth[0].astype(np.float64) + MIN_VIEW
            if self.azimuth is not None:
                off = prediction.symmetry.difference(centres, np.float32(self.azimuth))
                weight = np.exp(-0.5 * (off.astype(np.float64) / VIEW_SPREAD) ** 2)
            if len(self.vertices):
                weight = weight * self._point_likelihood(changed, centres, object_class, camera)
            changed = replace(changed, azimuth=(weight / weight.sum()).astype(azimuth.dtype)[None])
        return changed

    def exclude(self, log_prior: np.ndarray) -> None:
        """Lower a log prior (S, S, 3) of visible, hidden, background where labels rule these out."""
        log_prior[self.labels == PixelLabel.SEEN, 1:] -= EXCLUDED_LABEL_NATS
        log_prior[self.labels == PixelLabel.IN_FRONT, 0] -= EXCLUDED_LABEL_NATS
        log_prior[self.labels == PixelLabel.BACKGROUND, :2] -= EXCLUDED_LABEL_NATS
        if self.visible:
            log_prior[..., 1] -= EXCLUDED_LABEL_NATS

    def _point_likelihood(
        self, prediction: Prediction, azimuths: np.ndarray, object_class: ObjectClass, camera: Camera
    ) -> np.ndarray:
        """Return each azimuth's agreement (A,) with the points, exp(-r^2 / 2): float64, at most 1."""
        best, box = prediction.best(), box_in_window(prediction)
        vertices = object_class.shape_model.vertices(best.shape)
        places = project(camera, vertices, azimuths, np.repeat(best.elevation, len(azimuths)))
        # A guess of the framing: the projected box has the size and place of the predicted one.
        framing = np.zeros((len(azimuths), 3), np.float32) if box is None else frame_box(places, box)
        shift, scale = framing[:, None, :2] + 0.5, np.exp(framing[:, None, 2:])
        off = np.square(scale * places[:, self.vertices] + shift - self.places).sum((1, 2)).astype(np.float64)
        # Relative to the best azimuth: only differences weigh the bins.
        off = off / COARSE_NOISE**2
        agreement: np.ndarray = np.exp(-0.5 * (off - off.min()))
        return agreement


def project(camera: Camera, vertices: np.ndarray, azimuth: np.ndarray, elevation: np.ndarray) -> np.ndarray:
    """Return places (B, V, 2) of vertices (B or 1, V, 3), in sides of the window from its middle."""
    rotation, translation = camera.pose(azimuth, elevation)
    seen = vertices @ rotation.swapaxes(1, 2) + translation[:, None]
    places: np.ndarray = camera.focal / camera.width * seen[..., :2] / seen[..., 2:]
    return places


def frame_box(places: np.ndarray, box: tuple[float, float, float, float]) -> np.ndarray:
    """Return shift and log magnification (B, 3) by which places (B, V, 2) fill a box, in sides of the window.

    Magnification is the geometric mean of the boxes' widths and heights.
    """
    target, least, most = np.array(box, np.float32), places.min(1), places.max(1)
    log_scale = 0.5 * (np.log(target[2:]).sum() - np.log(most - least).sum(1, keepdims=True))
    shift = target[:2] + target[2:] / 2 - 0.5 - np.exp(log_scale) * (least + most) / 2
    return np.concatenate([shift, log_scale], axis=1)


@dataclass(frozen=True)
class Projection:
    """Places of a shape model's vertices in a window, as the objective's points place them."""

    model: ShapeModel
    camera: Camera
    layout: LatentLayout

    def of(self, chosen: np.ndarray) -> Callable[[np.ndarray], np.ndarray]:
        """Return places (B, N, 2) of the chosen vertices (N,), in sides of the window, from points (B, P').

        An analytic function of points, real or complex.
        """
        mean = self.model.mean[chosen].astype(np.float64)
        basis = self.model.basis[:, chosen].astype(np.float64)
        at, camera = self.layout, self.camera

        def places(points: np.ndarray) -> np.ndarray:
            vertices = mean + np.einsum("bk,kjc->bjc", points[:, at["shape"]], basis)
            # See `eye_of` and `project` in vig_native/likelihood.cc.
            rotation, translation = camera.pose(points[:, at.at("azimuth")], points[:, at.at("elevation")])
            x, y, z = np.moveaxis(vertices @ rotation.swapaxes(1, 2) + translation[:, None], 2, 0)
            framing = points[:, at["framing"]] if "framing" in at else np.zeros((len(points), 4))
            shift_x, shift_y, log_scale, roll = (number[:, None] for number in framing.T)
            cos, sin = np.cos(roll), np.sin(roll)
            scale = camera.focal / camera.width * np.exp(log_scale)
            across, down = scale * (cos * x - sin * y) / z, scale * (sin * x + cos * y) / z
            return np.stack([across + 0.5 + shift_x, down + 0.5 + shift_y], 2)

        return places


class ReprojectionTerm(ABC):
    """Gaussian of places in the window, a term of the objective: log p, gradient and Gauss-Newton matrix."""

    @abstractmethod
    def residuals(self, points: np.ndarray) -> np.ndarray:
        """Return (B, R) in deviations, of points (B, P') of the objective: analytic, real or complex."""

    def value(self, points: np.ndarray) -> np.ndarray:
        """Return log p of points (B, P') up to a constant: (B,) float64."""
        log_p: np.ndarray = -0.5 * np.square(self.residuals(points.astype(np.float64))).sum(1)
        return log_p

    def add_to(self, points: np.ndarray, value: np.ndarray, gradient: np.ndarray, normal: np.ndarray) -> None:
        """Add log p to values (B,), its gradient to (B, P'), -log p's matrix to (B, P', P')."""
        off, slopes = self._linearise(points.astype(np.float64))
        value += -0.5 * np.square(off).sum(1)
        gradient -= np.einsum("bj,bjp->bp", off, slopes)
        normal += np.einsum("bjp,bjq->bpq", slopes, slopes)

    def _linearise(self, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return residuals (B, R) and derivatives (B, R, P'), exact: the imaginary part of a tiny step."""
        count, size = points.shape
        moved = points[:, None] + 1j * COMPLEX_STEP * np.eye(size)
        found = self.residuals(moved.reshape(-1, size)).reshape(count, size, -1)
        return found[:, 0].real, found.imag.swapaxes(1, 2) / COMPLEX_STEP


class PointTerm(ReprojectionTerm):
    """Term of named points: vertices (J,) are at places (J, 2)."""

    def __init__(self, vertices: np.ndarray, places: np.ndarray, projection: Projection):
        self.given, self.places = places.astype(np.float64), projection.of(vertices)

    def residuals(self, points: np.ndarray) -> np.ndarray:
        """Return both coordinates of each point, (B, 2 J)."""
        off = (self.places(points) - self.given) / POINT_NOISE * math.sqrt(POINT_WEIGHT)
        return off.reshape(len(points), -1)


def outermost_vertices(vertices: np.ndarray, directions: int = 2000) -> np.ndarray:
    """Find the vertices of (V, 3) that are outermost in directions 2.5 degrees apart: indices (N,)."""
    height = 1 - (2 * np.arange(directions) + 1) / directions
    turn = np.arange(directions) * math.pi * (3 - math.sqrt(5))
    radius = np.sqrt(1 - height**2)
    towards = np.stack([radius * np.cos(turn), radius * np.sin(turn), height], 1)
    return np.unique((towards @ vertices.T).argmax(1))


class BoxTerm(ReprojectionTerm):
    """Term of the whole object's box (x, y, w, h), by the mean shape's outermost vertices."""

    def __init__(self, box: tuple[float, float, float, float], projection: Projection):
        x, y, w, h = box
        self.given = np.array([x, y, x + w, y + h], np.float64)
        self.places = projection.of(outermost_vertices(projection.model.mean))

    def residuals(self, points: np.ndarray) -> np.ndarray:
        """Return left, top, right and bottom, (B, 4)."""
        places = self.places(points)
        ends = [places.real.argmin(1), places.real.argmax(1)]
        sides = np.concatenate([np.take_along_axis(places, end[:, None], 1)[:, 0] for end in ends], axis=1)
        # 0.02: standard deviation of the sides of a box drawn by hand, in sides of the window
        return (sides - self.given) / 0.02 * math.sqrt(POINT_WEIGHT)

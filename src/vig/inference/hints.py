"""What is known of the object in a window beforehand, and how a fit takes it."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from enum import IntEnum

import numpy as np
import scipy  # which loads `spatial` where that is first used
import torch

from vig.recognition import Prediction, box_in_window
from vig.scene import Camera, LatentLayout, ObjectClass, ShapeModel

POINT_NOISE = 0.02
"""Standard deviation of a named point, in sides of the window: of clicks, and of the class's own points."""
POINT_WEIGHT = 100.0
"""Power of the points' Gaussian: evidence counts pixels as independent, which they are not."""
BOX_NOISE = 0.02
"""The same of the sides of a box drawn by hand."""
COARSE_NOISE = 0.08
"""The same deviation where views are compared before the shape is fitted."""
LEAST_VIEW = 0.002
"""Probability added to each bin of azimuth: the network may rule out what a user sees."""
VIEW_SPREAD = math.radians(8.0)
"""Standard deviation about an azimuth that a user gives."""
ELEVATION_SPREAD = math.radians(4.0)
"""And about an elevation, radians."""

SURE = 8.0
"""Nats against what a user excludes of a pixel: hands slip."""


class PixelLabel(IntEnum):
    """What a user says of a pixel."""

    UNKNOWN = 0
    SEEN = 1
    """The object is seen."""
    IN_FRONT = 2
    """It is not: something is in front of it, or it is not there."""
    NOTHING = 3
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

    labels: torch.Tensor
    visible: bool
    vertices: torch.Tensor
    places: torch.Tensor
    azimuth: float | None
    elevation: float | None
    held: Mapping[str, float]
    box: tuple[float, float, float, float] | None = None

    def terms(self, object_class: ObjectClass, camera: Camera, layout: LatentLayout) -> list[PlaceTerm]:
        """What the hints add to the objective of a camera."""
        projection = Projection(object_class.shape_model, camera, layout)
        terms: list[PlaceTerm] = []
        if len(self.vertices):
            terms.append(PointTerm(self.vertices, self.places, projection))
        if self.box is not None:
            terms.append(BoxTerm(self.box, projection))
        return terms

    def corrected(self, prediction: Prediction, object_class: ObjectClass, camera: Camera) -> Prediction:
        """What the network would predict (N = 1) if it knew of the hints.

        Pixels of which something is said have that class; elevation and azimuth are about those given; each
        bin of azimuth is weighted by how well it puts the points where they are, framed by the mask's box.
        """
        numbers, deviation = prediction.numbers.clone(), prediction.deviation.clone()
        azimuth = prediction.azimuth
        visible, hidden, beside = prediction.mask[0].unbind(-1)
        if self.visible:
            visible, hidden = visible + hidden, torch.zeros_like(hidden)
        # A pixel that does not show the object is hidden or beside it, in the ratio that was predicted.
        behind = hidden / (hidden + beside).clamp_min(1e-6)
        away = torch.stack([torch.zeros_like(visible), behind, 1 - behind], dim=-1)
        classes = torch.stack([visible, hidden, beside], dim=-1)
        for kind, share in ((PixelLabel.SEEN, torch.Tensor([1, 0, 0])), (PixelLabel.IN_FRONT, away),
                            (PixelLabel.NOTHING, torch.Tensor([0, 0, 1]))):  # fmt: skip
            classes = torch.where((self.labels == kind)[..., None], share, classes)
        if self.elevation is not None:
            place = prediction.layout["elevation"]
            numbers[:, place], deviation[:, place] = self.elevation, ELEVATION_SPREAD
        changed = replace(prediction, mask=classes[None], numbers=numbers, deviation=deviation)
        if prediction.symmetry.fold and (self.azimuth is not None or len(self.vertices)):
            bins = azimuth.shape[1]
            # Bins of a symmetric class share the circle's 1 / fold part.
            centres = (torch.arange(bins) + 0.5) * (2 * math.pi / (bins * prediction.symmetry.fold))
            weight = azimuth[0].double() + LEAST_VIEW
            if self.azimuth is not None:
                off = prediction.symmetry.difference(centres, torch.tensor(self.azimuth))
                weight = torch.exp(-0.5 * (off.double() / VIEW_SPREAD) ** 2)
            if len(self.vertices):
                weight = weight * self._agreement(changed, centres, object_class, camera)
            changed = replace(changed, azimuth=(weight / weight.sum()).to(azimuth)[None])
        return changed

    def exclude(self, log_prior: torch.Tensor) -> None:
        """Take `SURE` nats from what is excluded: log prior (S, S, 3) of visible, hidden, background."""
        log_prior[self.labels == PixelLabel.SEEN, 1:] -= SURE
        log_prior[self.labels == PixelLabel.IN_FRONT, 0] -= SURE
        log_prior[self.labels == PixelLabel.NOTHING, :2] -= SURE
        if self.visible:
            log_prior[..., 1] -= SURE

    def _agreement(
        self, prediction: Prediction, azimuths: torch.Tensor, object_class: ObjectClass, camera: Camera
    ) -> torch.Tensor:
        """How well each azimuth (A,) puts the points, as exp(-r^2 / 2): (A,) float64, at most 1."""
        best = prediction.best()
        count = len(azimuths)
        vertices = object_class.shape_model.vertices(best.shape)
        rotation, translation = camera.pose(azimuths.float(), best.elevation.expand(count).float())
        x, y, z = (vertices @ rotation.mT + translation[:, None]).unbind(2)
        places_in_window = camera.focal / camera.width * torch.stack([x / z, y / z], 2)
        least, most = places_in_window.amin(1), places_in_window.amax(1)
        box = box_in_window(prediction)
        shown = places_in_window[:, self.vertices]
        if box is None:
            scale, shift = places_in_window.new_ones(count, 1), places_in_window.new_full((count, 2), 0.5)
        else:
            there = torch.tensor(box)
            # A guess of the framing: the projected box has the size and place of the predicted one.
            scale = (0.5 * (there[2:].log() - (most - least).log()).sum(1, keepdim=True)).exp()
            shift = there[:2] + there[2:] / 2 - scale * (least + most) / 2
        off = (scale[:, None] * shown + shift[:, None] - self.places).square().sum((1, 2)).double()
        # Relative to the best azimuth: only differences weigh the bins.
        off = off / COARSE_NOISE**2
        return torch.exp(-0.5 * (off - off.min()))


@dataclass(frozen=True)
class Projection:
    """Where a shape model's vertices are in a window, as the objective's points place them."""

    model: ShapeModel
    camera: Camera
    layout: LatentLayout

    def of(self, chosen: np.ndarray) -> Callable[[torch.Tensor], torch.Tensor]:
        """Places (N, 2) of the chosen vertices (N,), in sides of the window, from one point (P') float64."""
        mean = torch.from_numpy(self.model.mean[chosen]).double()
        basis = torch.from_numpy(self.model.basis[:, chosen]).double()
        at, camera = self.layout, self.camera

        def places(point: torch.Tensor) -> torch.Tensor:
            vertices = mean + torch.einsum("k,kjc->jc", point[at["shape"]], basis)
            # As `eye_of` and `project` in vig_native/likelihood.cc.
            rotation, translation = camera.pose(point[at["azimuth"]], point[at["elevation"]])
            x, y, z = (vertices @ rotation[0].T + translation[0]).unbind(1)
            framing = point[at["framing"]] if "framing" in at else point.new_zeros(4)
            shift_x, shift_y, log_scale, roll = framing.unbind(0)
            cos, sin = torch.cos(roll), torch.sin(roll)
            scale = camera.focal / camera.width * torch.exp(log_scale)
            across, down = scale * (cos * x - sin * y) / z, scale * (sin * x + cos * y) / z
            return torch.stack([across + 0.5 + shift_x, down + 0.5 + shift_y], 1)

        return places


class PlaceTerm(ABC):
    """A Gaussian in the objective of where things are in the window: log p, its gradient and Gauss-Newton
    matrix.
    """

    @abstractmethod
    def residuals(self, point: torch.Tensor) -> torch.Tensor:
        """(R,) in deviations, of one point (P') of the objective, float64."""

    def value(self, points: torch.Tensor) -> torch.Tensor:
        """log p of points (B, P') up to a constant: (B,) float64."""
        residuals_of_points = torch.func.vmap(self.residuals)(points.double())
        return -0.5 * residuals_of_points.square().sum(1)

    def add_to(
        self, points: torch.Tensor, value: torch.Tensor, gradient: torch.Tensor, normal: torch.Tensor
    ) -> None:
        """Add log p to values (B,), its gradient to (B, P'), -log p's matrix to (B, P', P')."""
        host = points.double()
        off = torch.func.vmap(self.residuals)(host)
        slopes = torch.func.vmap(torch.func.jacfwd(self.residuals))(host)
        value += (-0.5 * off.square().sum(1)).to(value)
        gradient -= torch.einsum("bj,bjp->bp", off, slopes).to(gradient)
        normal += torch.einsum("bjp,bjq->bpq", slopes, slopes).to(normal)


class PointTerm(PlaceTerm):
    """Of named points: vertices (J,) are at places (J, 2)."""

    def __init__(self, vertices: torch.Tensor, places: torch.Tensor, projection: Projection):
        self.given, self.places = places.double(), projection.of(vertices.numpy())

    def residuals(self, point: torch.Tensor) -> torch.Tensor:
        """Both coordinates of each point, (2 J,)."""
        return ((self.places(point) - self.given) / POINT_NOISE).flatten() * math.sqrt(POINT_WEIGHT)


class BoxTerm(PlaceTerm):
    """Of the whole object's box (x, y, w, h); its vertices are those of the mean shape's convex hull."""

    def __init__(self, box: tuple[float, float, float, float], projection: Projection):
        x, y, w, h = box
        self.given = torch.tensor([x, y, x + w, y + h], dtype=torch.float64)
        self.places = projection.of(scipy.spatial.ConvexHull(projection.model.mean).vertices)

    def residuals(self, point: torch.Tensor) -> torch.Tensor:
        """Left, top, right and bottom, (4,)."""
        places = self.places(point)
        sides = torch.cat([places.amin(0), places.amax(0)])
        return (sides - self.given) / BOX_NOISE * math.sqrt(POINT_WEIGHT)

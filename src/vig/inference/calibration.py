"""What was learned on validation photos about when fits are right, and how far they are off.

A fit leaves clues: how far other views lie behind, what the recognition model thinks of the view, how much
is seen. A logistic regression turns them into the probability that the view is right; another, which knows
photos rolled about their centre, into the probability that the photo is of the known kind, without which the
first means nothing. The curvature at the fit states deviations as if the model were exact and
pixels independent; for each latent they are widened to `r sqrt((scale d)^2 + floor^2)`, r the residual's root
mean square, apart for fits that are trusted and for others, so that 90 % intervals hold.
"""

from __future__ import annotations

import functools
import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import torch

from vig.checks import check_number, decode, read_json, reading
from vig.errors import UserError
from vig.files import atomic_write
from vig.scene import ObjectClass

FILE = "calibration.json"
FORMAT = 3
"""2 knew fewer clues."""
CLUES = (
    "lead",
    "support",
    "agreement",
    "hidden",
    "seen",
    "misfit",
    "height",
    "accord",
    "spread",
    "elevation_doubt",
    "shape_doubt",
    "roll",
)
"""lead: log nats to the best fit of another view; support: log probability of the view; agreement: 1 when the
recognition model's best guess is of the same view; hidden: share of the object; seen: log pixels; misfit: log
of the residual's root mean square where the object is seen; height: sine of the elevation; accord: mean log
probability that the recognition model gives to what the fit says of the object's pixels; spread: log entropy
of its azimuth; elevation_doubt, shape_doubt: log of its deviation of elevation, mean of those of shape;
roll: nats a pixel that the fit would gain if it were rolled a little in the image."""

KIND = ("accord", "spread", "elevation_doubt", "shape_doubt", "roll")
"""Clues to a photo's being of the known kind."""


LEAST_DEVIATION = 1e-3
"""Of any latent: what never varies, as L00 at a set exposure, is not known infinitely well."""


def residual(clues: torch.Tensor) -> torch.Tensor:
    """Root mean square (...) of the residual where the object is seen, from clues (..., C)."""
    return clues[..., CLUES.index("misfit")].exp()


@dataclass(frozen=True)
class Calibration:
    """What to make of clues and curvature; K modes, P = K + 14 latents.

    weights (C,), bias: of the logistic regression on the clues for the view; kind_weights (C,), kind_bias:
    for the kind of photo. threshold: confidence from which a fit is trusted. scale, floor (2, P): of
    deviations, row 0 for fits that are trusted, 1 for others.
    """

    weights: torch.Tensor
    bias: float
    kind_weights: torch.Tensor
    kind_bias: float
    threshold: float
    scale: torch.Tensor
    floor: torch.Tensor

    def confidence(self, clues: torch.Tensor) -> float:
        """Probability that the view of a fit with clues (C,) is right.

        Where the photo is as likely of another kind as of the known one, or likelier, it fades to zero.
        """
        return float(faded(_logistic(self.weights, self.bias, clues), self._known(clues)))

    def known(self, clues: torch.Tensor) -> float:
        """Probability that a photo with clues (C,) is of the kind this was learned on, 1 / 2 a priori."""
        return float(self._known(clues))

    def _known(self, clues: torch.Tensor) -> torch.Tensor:
        return _logistic(self.kind_weights, self.kind_bias, clues)

    def widened(self, deviation: torch.Tensor, clues: torch.Tensor, trusted: bool) -> torch.Tensor:
        """Standard deviations (P,) from those of the curvature, for a fit with clues (C,)."""
        row = 0 if trusted else 1
        wide = torch.sqrt((self.scale[row] * deviation) ** 2 + self.floor[row] ** 2)
        return (residual(clues) * wide).clamp_min(LEAST_DEVIATION)

    def to_json(self) -> str:
        """As it is written."""
        told = {k: v.tolist() if isinstance(v, torch.Tensor) else v for k, v in vars(self).items()}
        return json.dumps({"format": FORMAT, "clues": CLUES} | told, indent=1) + "\n"

    def save(self, path: Path) -> None:
        """Write as JSON."""
        with atomic_write(path) as temporary:
            Path(temporary).write_text(self.to_json())

    @staticmethod
    def load(path: Path) -> Calibration:
        """Read what `save` wrote. Raises UserError when there is none or it is of no use."""
        with reading(path, "a calibration", "Make it again with `vig calibrate`."):
            told = decode(dict[str, Any], read_json(path))
            if told["format"] != FORMAT or decode(tuple[str, ...], told["clues"]) != CLUES:
                raise ValueError(f"it is of format {told['format']!s:.20}, where this vig reads {FORMAT}")
            row, rows = tuple[float, ...], tuple[tuple[float, ...], ...]
            kinds = {"weights": row, "kind_weights": row, "scale": rows, "floor": rows}
            tensors = {
                name: torch.tensor(decode(kind, told[name]), dtype=torch.float64)
                for name, kind in kinds.items()
            }
            shapes = {tuple(tensors[name].shape) for name in ("weights", "kind_weights")}
            size = tensors["scale"].shape
            if shapes != {(len(CLUES),)} or size != tensors["floor"].shape or size[0] != 2:
                raise ValueError("its sizes do not fit")
            if (tensors["scale"] < 0).any() or (tensors["floor"] < 0).any():
                raise ValueError("scale and floor must not be negative")
            made = Calibration(
                bias=check_number("bias", told["bias"], -1e6, 1e6),
                kind_bias=check_number("kind_bias", told["kind_bias"], -1e6, 1e6),
                threshold=check_number("threshold", told["threshold"], -1.0, 2.0),
                **tensors,
            )
        return made


def faded(view: torch.Tensor, known: torch.Tensor) -> torch.Tensor:
    """Confidence from the probabilities that the view is right and that the photo is of the known kind."""
    return view * (2 * known).clamp_max(1)


def _logistic(weights: torch.Tensor, bias: float, clues: torch.Tensor) -> torch.Tensor:
    return torch.sigmoid(clues.double() @ weights + bias)


@functools.lru_cache(maxsize=8)
def calibration_of(object_class: ObjectClass) -> Calibration | None:
    """A class's own calibration; None when it has none."""
    path = (object_class.folder or Path()) / FILE
    if not object_class.folder or not path.exists():
        return None
    calibration, count = Calibration.load(path), object_class.shape_model.modes + 14
    if calibration.scale.shape[1] != count:
        raise UserError(
            f"expected a calibration of the {count} latents of class '{object_class.name}';"
            f" '{path}' has {calibration.scale.shape[1]}. Make it again with `vig calibrate`."
        )
    return calibration

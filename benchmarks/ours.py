"""Our side of the comparison."""

from __future__ import annotations

import torch

from benchmarks.case import Case
from vig.likelihood import ROBUST, Evaluation, Likelihood, Photos
from vig.likelihood.kernels.geometry import Geometry


def set_threads(count: int) -> None:
    """How many threads we use from now on."""
    torch.set_num_threads(count)


class Ours:
    """Eq. 4 of one photo on the CPU in float32: the value alone, or with gradient and normal matrix."""

    def __init__(self, case: Case):
        height, width = case.photo.shape[:2]
        photos = Photos(torch.from_numpy(case.photo)[None], ROBUST.log_prior(height, width)[None])
        self.case, self.likelihood = case, Likelihood(Geometry(case.model), case.camera, photos)
        self._rest = (torch.zeros(1, 3), torch.zeros(1, dtype=torch.int32), torch.tensor([ROBUST.sigma]))

    def forward(self, index: int) -> Evaluation:
        """The objective at a guess."""
        return self._evaluate(index, derivatives=False)

    def gradient(self, index: int) -> Evaluation:
        """Objective and gradient of the 24 latents and 3 numbers of framing."""
        return self._evaluate(index, derivatives=True, curvature=False)

    def full(self, index: int) -> Evaluation:
        """Objective, gradient and normal matrix of the 24 latents and 3 numbers of framing."""
        return self._evaluate(index, derivatives=True)

    def covered(self) -> int:
        """Area of the first guess's silhouette, in pixels, rounded."""
        coverage = self.images().coverage
        assert coverage is not None
        return round(float(coverage.sum()))

    def images(self) -> Evaluation:
        """The first guess with its posterior, coverage and irradiance."""
        return self.likelihood(self.case.guesses[0], *self._rest, derivatives=False)

    def _evaluate(self, index: int, derivatives: bool, curvature: bool = True) -> Evaluation:
        guess = self.case.guesses[index % len(self.case.guesses)]
        return self.likelihood(guess, *self._rest, derivatives=derivatives, images=False, curvature=curvature)

"""Networks that compute each picture once for all tests of a process."""

import hashlib
from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np
import pytest

from vig.recognition import Recognizer

Outputs = list[np.ndarray]
REMEMBERED: dict[tuple[Any, ...], Outputs] = {}
"""Outputs by weights, model and picture."""
DIGESTS: dict[int, tuple[Mapping[str, np.ndarray], bytes]] = {}
"""Digests of weights by the identity of their mapping, which is kept."""


def digest_of(weights: Mapping[str, np.ndarray]) -> bytes:
    if id(weights) not in DIGESTS:
        digest = hashlib.sha1()
        for name, array in weights.items():
            digest.update(name.encode() + np.ascontiguousarray(array).tobytes())
        DIGESTS[id(weights)] = weights, digest.digest()
    return DIGESTS[id(weights)][1]


@pytest.fixture(scope="module")
def remembered_networks() -> Iterator[None]:
    """For tests of what becomes of an explanation: the network takes most of the time of one."""
    run = Recognizer._run

    def run_once(
        self: Recognizer, which: str, image: np.ndarray, shapes: Mapping[str, tuple[int, ...]]
    ) -> Outputs:
        picture = image.shape, image.dtype.str, hashlib.sha1(image.tobytes()).digest()
        key = digest_of(self.weights), repr(self.settings), which, *picture, tuple(shapes.items())
        if key not in REMEMBERED:
            REMEMBERED[key] = run(self, which, image, shapes)
        return [output.copy() for output in REMEMBERED[key]]

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(Recognizer, "_run", run_once)
        yield
    REMEMBERED.clear()
    DIGESTS.clear()

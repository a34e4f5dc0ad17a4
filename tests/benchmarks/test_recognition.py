"""The benchmark of recognition: rates of the threads asked for, and torch left as it was."""

from __future__ import annotations

import torch

from benchmarks.recognition import rates
from vig.recognition import Recognizer
from vig.scene import ObjectClass


def test_rates_are_of_each_run_and_threads_stay_as_they_were() -> None:
    before = torch.get_num_threads()
    recognizer = Recognizer.of_class(ObjectClass.load("teapot"))
    found = rates(recognizer, torch.zeros(4, 150, 150, 3), threads=1, repeats=3)
    assert len(found) == 3 and all(rate > 0 for rate in found)
    assert torch.get_num_threads() == before

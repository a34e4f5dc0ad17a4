"""The benchmark of recognition: rates of the threads asked for, which stay as they were."""

import numpy as np

from benchmarks.recognition import rates
from vig.parallel import thread_count
from vig.recognition import Recognizer
from vig.scene import ObjectClass


def test_rates_are_of_each_run_and_threads_stay_as_they_were() -> None:
    before = thread_count()
    recognizer = Recognizer.of_class(ObjectClass.load("teapot"))
    found = rates(recognizer, np.zeros((4, 150, 150, 3), np.float32), threads=1, repeats=3)
    assert len(found) == 3 and all(rate > 0 for rate in found)
    assert thread_count() == before

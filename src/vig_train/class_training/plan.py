"""Plan of a training within its minutes."""

import time
from dataclasses import dataclass

from vig.parallel import thread_limit
from vig_train.training.class_heads import EPOCHS
from vig_train.training.class_network import ClassImages, DecoderTraining, new_network
from vig_train.training.collages import PICTURES

QUICK = 0.0  # minutes of a training that stands for the quick recognizer of `vig class build`
QUICK_CHUNKS = 16  # files of images of the quick recognizer: 2,048 images, a minute of two cores
QUICK_DECODER_STEPS = 60  # steps of its mask's decoder, half a minute
QUICK_PICTURES = 480  # pictures for its map of objects, a quarter of a minute of two cores
IMAGE_SHARE = 0.5  # share of the time for drawing images
DECODER_SHARE = 0.15
"""Share of time for the mask's decoder. The rest is for the map of objects, heads, calibration and test."""


@dataclass(frozen=True)
class Plan:
    """Amounts of work, fixed in advance, so that a resumed run gives the same result.

    Attributes:
        chunks: Files of images.
        decoder_steps: Steps of the mask's decoder.
        pictures: Pictures for the map of objects.
        epochs: Epochs of the heads.
    """

    chunks: int
    decoder_steps: int
    pictures: int
    epochs: int = EPOCHS


def measured_plan(images: ClassImages, minutes: float) -> Plan:
    """Return the plan for so many minutes, measured on the first images, which count, as those there do."""
    budget, workers = 60 * minutes, images.workers
    there = 0
    while images.path(there).exists():
        there += 1
    # The first file of each process takes longer: it starts, and nothing is in its caches.
    warm, timed = there + workers, there + 3 * workers
    images.draw(range(warm))
    begin = time.perf_counter()
    images.draw(range(warm, timed))
    per_chunk = (time.perf_counter() - begin) / (timed - warm)
    with thread_limit(workers):
        network, examples = new_network(images.object_class), images.examples(range(1))
        per_step = DecoderTraining(network, examples, True, images.seed).seconds_per_step()
    # At most 480 files, 61,440 images: their features take 2.7 GB of memory.
    chunks = max(timed, min(480, there + round(IMAGE_SHARE * budget / per_chunk)))
    # 48 pictures for each minute of the training: each takes .09 s of one core, 7 % of the time in all.
    # 8,000 pictures take 1.1 GB of memory.
    pictures = PICTURES * max(1, round(min(8000, 48 * minutes) / PICTURES))
    return Plan(chunks, max(1, round(DECODER_SHARE * budget / per_step)), pictures)

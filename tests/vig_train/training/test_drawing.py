"""Images that a training draws are used again within their epoch."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import torch

from vig_train.training.drawing import Drawing, add_earlier_examples
from vig_train.training.examples import Examples

COUNT = 2


def steps(first: int, last: int) -> Iterator[tuple[Examples, int]]:
    """Of each step one image of a dataset, -1, and two of the studio, the number of each its azimuth."""
    for step in range(first, last):
        azimuth = torch.tensor([-1.0, COUNT * step, COUNT * step + 1])
        column = azimuth[:, None]
        images = torch.zeros(3, 2, 2, 3, dtype=torch.uint8)
        masks = torch.zeros(3, 2, 2, dtype=torch.uint8)
        yield Examples(images, azimuth, column, azimuth, masks, masks), step


def shown(first: int, last: int) -> list[list[int]]:
    drawing = Drawing(Path("pack"), COUNT, again=3)
    with_earlier = add_earlier_examples(steps(first, last), drawing, seed=5, epoch_steps=4)
    return [examples.azimuth.int().tolist() for examples, _ in with_earlier]


def test_a_step_takes_images_of_the_epochs_earlier_steps_too() -> None:
    found = shown(0, 8)
    assert [len(step) for step in found] == [3, 5, 6, 6, 3, 5, 6, 6], "an epoch begins with none"
    for number, step in enumerate(found):
        assert step[:3] == [-1, COUNT * number, COUNT * number + 1]
        epoch, again = number // 4 * 4, step[3:]
        assert set(again) <= set(range(COUNT * epoch, COUNT * number)) and len(set(again)) == len(again)
    assert {*found[6][3:], *found[7][3:]} > {*found[6][3:]}, "not always the same ones"


def test_a_run_that_resumes_takes_the_same_images() -> None:
    assert shown(4, 8) == shown(0, 8)[4:]

"""The mask's decoder that sees the whole image."""

import pytest
import torch

from vig.recognition import NetworkSettings
from vig_train.network.network import RecognitionNetwork

SMALL = NetworkSettings(
    modes=2, channels=(4, 4, 6, 8, 8, 8), blocks=(1, 1, 1, 1, 1), squeezed=4, features=8, context=(8, 6, 6, 4)
)


def test_a_cell_depends_on_the_whole_image() -> None:
    """A change in one corner reaches the opposite one, and the mask is as large as the plain decoder's."""
    torch.manual_seed(0)
    network = RecognitionNetwork(SMALL).eval()
    remembered = network.context.recall[4]
    remembered.weight.data.zero_()  # attention alone
    image = torch.rand(1, 3, 150, 150)
    changed = image.clone()
    changed[..., :20, :20] = 1 - changed[..., :20, :20]
    with torch.inference_mode():
        before, after = network(image).mask, network(changed).mask
    assert before.shape == (1, 3, 75, 75)
    assert not torch.equal(before[..., -5:, -5:], after[..., -5:, -5:])


def test_heads_do_not_depend_on_it() -> None:
    """The mask can be trained alone."""
    network = RecognitionNetwork(SMALL).eval()
    network(torch.rand(1, 3, 150, 150)).mask.sum().backward()
    heads = network.dense, network.azimuth, network.numbers, network.others
    assert all(value.grad is None for part in heads for value in part.parameters())


@pytest.mark.parametrize("context", [(8, 6, 6), (9, 6, 6, 4), (0, 6, 6, 4)])
def test_sizes_that_cannot_be_are_refused(context: tuple[int, ...]) -> None:
    with pytest.raises(ValueError, match="context"):
        NetworkSettings(context=context)

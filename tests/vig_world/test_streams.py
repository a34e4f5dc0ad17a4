import numpy as np

from vig_world.streams import asset_rng, stream


def drawn(rng: np.random.Generator) -> int:
    return int(rng.integers(2**63))


def test_random_numbers_differ_with_everything_they_are_for() -> None:
    """Else splits would share scenes, and samples their noise."""
    others = [(2, 1, "train", 0), (1, 2, "train", 0), (1, 1, "test", 0), (1, 1, "train", 1)]
    first = drawn(stream(1, 1, "train", 0))
    assert drawn(stream(1, 1, "train", 0)) == first
    assert len({first} | {drawn(stream(*other)) for other in others}) == 5
    assets = [
        ("train", "prop/mug", 0),
        ("test", "prop/mug", 0),
        ("train", "prop/jug", 0),
        ("train", "prop/mug", 1),
    ]
    assert len({drawn(asset_rng(*each)) for each in assets}) == 4

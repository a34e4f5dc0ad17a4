"""What many tests take: a small class pack with known numbers, and a network that is quick to train."""

from pathlib import Path

from vig.recognition import NetworkSettings

TEAPOT = Path(__file__).parent / "packs" / "teapot"
"""A pack without weights: the teapots of 0.1, with 10 components, of which many tests state numbers."""

SMALL = NetworkSettings(
    channels=(4, 4, 4, 8, 8, 8), blocks=(1, 1, 1, 1, 1), expansion=2, decoder=8, squeezed=4, features=16
)

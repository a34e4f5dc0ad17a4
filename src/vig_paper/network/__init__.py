"""The paper's recognition networks and their training."""

from vig_paper.network.training import PaperTrainingSettings, train_paper

__all__ = [
    "PaperTrainingSettings",
    "train_paper",
]

"""The paper's recognition networks and their training."""

from vig_lab.paper_network.training import PaperTrainingSettings, train_paper

__all__ = [
    "PaperTrainingSettings",
    "train_paper",
]

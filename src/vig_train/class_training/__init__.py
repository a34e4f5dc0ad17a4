"""A class's recognition network within a budget of minutes, from images of the studio to the card."""

from vig_train.class_training.plan import QUICK
from vig_train.class_training.steps import ClassTraining

__all__ = ["QUICK", "ClassTraining"]

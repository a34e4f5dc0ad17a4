"""A class's recognition network within a budget of minutes, from images of the studio to the card."""

from vig_train.class_training.plan import QUICK as QUICK
from vig_train.class_training.steps import ClassTraining as ClassTraining

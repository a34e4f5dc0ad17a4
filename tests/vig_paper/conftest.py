"""The small dataset, network and results of the tests of training."""

from tests.vig_train.conftest import dataset, made, quick, results, untrained, weights

__all__ = ["dataset", "made", "quick", "results", "untrained", "weights"]

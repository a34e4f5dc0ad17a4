"""A small dataset, an untrained network, and the results of the methods on them."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest
import torch

from tests.support import SMALL
from vig.inference import ExplainSettings
from vig.inference.settings import Stage
from vig.recognition import Recognizer
from vig.scene import EXPOSURE_L00, ObjectClass
from vig_train.evaluation.fits import FitRun
from vig_train.evaluation.protocol import evaluate
from vig_train.evaluation.results import MethodResult
from vig_train.network.network import RecognitionNetwork
from vig_train.training.checkpoint import save_weights
from vig_world.dataset import Dataset, read_dataset
from vig_world.generation.write import make_dataset

Results = dict[str, MethodResult]


@pytest.fixture(scope="session")
def quick() -> ExplainSettings:
    """A fit of few iterations."""
    return ExplainSettings(stages=(Stage(2, 2),))


@pytest.fixture(scope="session")
def made(tmp_path_factory: pytest.TempPathFactory, teapot: ObjectClass) -> Path:
    """A dataset's folder: four images of the test split."""
    out = tmp_path_factory.mktemp("evaluated") / "d"
    return make_dataset(
        out, 4, 3, split="test", workers=1, progress=False, object_class=teapot, world="paper"
    )


@pytest.fixture(scope="session")
def dataset(made: Path) -> Dataset:
    return read_dataset(made, "test")


@pytest.fixture(scope="session")
def untrained() -> Callable[..., Path]:
    """Writes weights of a small network that predicts about the same for every photo."""

    def write(path: Path, modes: int = 10, seed: int = 0) -> Path:
        torch.manual_seed(seed)
        network = RecognitionNetwork(replace(SMALL, modes=modes))
        mean = torch.tensor([0.8, *[0.0] * modes, 0.5, 0.5, 0.5, EXPOSURE_L00, *[0.0] * 8])
        save_weights(network, {"mean": mean, "deviation": torch.full_like(mean, 0.1)}, path)
        return path

    return write


@pytest.fixture(scope="session")
def weights(tmp_path_factory: pytest.TempPathFactory, untrained: Callable[..., Path]) -> Path:
    return untrained(tmp_path_factory.mktemp("weights") / "recognition.safetensors")


@pytest.fixture(scope="session")
def results(dataset: Dataset, weights: Path, teapot: ObjectClass, quick: ExplainSettings) -> Results:
    """Results of every method on the dataset."""
    fitted: list[int] = []
    run = FitRun(teapot, advance=fitted.append)
    found = evaluate(dataset, Recognizer(weights), run, settings=quick)
    assert sum(fitted) == 2 * len(dataset)  # gaussian, and robust and spatial at once
    return found

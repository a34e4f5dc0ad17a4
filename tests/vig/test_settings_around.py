"""Settings of torch and numpy by a program, under which the library's answers stay the same."""

import shutil
import threading
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from importlib.resources import files
from pathlib import Path

import numpy as np
import pytest
import torch
from PIL import Image

import vig
from vig.scene.object_class import PACKAGED
from vig_renderer import MeshObject, Pinhole, Scene, Topology, jacobian, render
from vig_renderer.defaults import default_settings

SETTINGS = ("bfloat16", "meta", "autocast", "inference", "errstate")


@contextmanager
def around(name: str) -> Iterator[None]:
    with ExitStack() as stack:
        if name in ("float64", "bfloat16"):
            stack.callback(torch.set_default_dtype, torch.get_default_dtype())
            torch.set_default_dtype(getattr(torch, name))
        elif name == "meta":
            stack.callback(torch.set_default_device, None)
            torch.set_default_device("meta")
        elif name == "autocast":
            stack.enter_context(torch.autocast("cpu", torch.bfloat16))
        elif name == "inference":
            stack.enter_context(torch.inference_mode())
        else:
            stack.enter_context(np.errstate(all="raise"))
        yield


@pytest.fixture(scope="module")
def photo() -> np.ndarray:
    return np.asarray(Image.open(str(files("vig_app") / "examples" / "01_open.png")).convert("RGB"))


@pytest.fixture(scope="module")
def usual(photo: np.ndarray) -> vig.Explanation:
    return vig.Explainer("teapot").explain(photo)


@pytest.mark.parametrize("name", SETTINGS)
def test_explanations_and_their_files_are_the_same(
    name: str, photo: np.ndarray, usual: vig.Explanation, tmp_path: Path
) -> None:
    with around(name):
        explainer = vig.Explainer("teapot")
        explanation = explainer.explain(photo)
        explanation.save(tmp_path)
        explanation.export(tmp_path, ["bop", "coco"])
        drawn = explanation.render(azimuth_deg=20.0)
        dtype = torch.get_default_dtype()
        assert dtype == (torch.bfloat16 if name == "bfloat16" else torch.float32)
    assert explanation.verdict == usual.verdict
    assert abs(explanation.azimuth_deg - usual.azimuth_deg) < 2
    np.testing.assert_allclose(explanation.pinhole_pose()[1], usual.pinhole_pose()[1], atol=0.03)
    assert drawn.dtype == np.float32 and abs(drawn.mean() - usual.render(azimuth_deg=20.0).mean()) < 0.01
    assert explainer.explain(photo[:, ::-1]).verdict  # what was made inside is of use outside


@pytest.mark.parametrize("name", ("meta", "autocast", "float64"))
def test_the_renderer_draws_the_same(name: str) -> None:
    given = {"dtype": torch.float32, "device": "cpu"}
    corners = torch.tensor([[0.0, 0, 1], [0.5, 0, 1], [0, 0.5, 1]], **given)
    topology = Topology.of([[0, 1, 2]], corners)
    focal, centre = torch.full((2,), 20.0, **given), torch.full((2,), 4.0, **given)
    camera = Pinhole(16, 16, focal, centre, torch.eye(3, **given), torch.zeros(3, **given))

    def covered(shift: torch.Tensor) -> torch.Tensor:
        mesh = MeshObject(corners + shift, topology, torch.ones(3, **given))
        return render(Scene([mesh], camera)).coverage.sum()

    shift = torch.zeros(3, **given)
    expected = covered(shift), *jacobian(covered, shift)
    with around(name):
        torch.testing.assert_close((covered(shift), *jacobian(covered, shift)), expected)


def test_a_default_dtype_returns_when_the_last_thread_leaves() -> None:
    entered, leave = threading.Event(), threading.Event()

    def stay() -> None:
        with default_settings():
            entered.set()
            leave.wait(10)

    with around("float64"):
        thread = threading.Thread(target=stay)
        with default_settings():
            thread.start()
            entered.wait(10)
        assert torch.get_default_dtype() == torch.float32  # the other one needs it still
        leave.set()
        thread.join()
        assert torch.get_default_dtype() == torch.float64


def test_a_pack_named_from_a_folder_is_of_use_in_another(
    photo: np.ndarray, usual: vig.Explanation, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Its calibration is read at the first fit."""
    shutil.copytree(PACKAGED / "teapot", tmp_path / "pot")
    (tmp_path / "other").mkdir()
    monkeypatch.chdir(tmp_path)
    explainer = vig.Explainer("pot")
    monkeypatch.chdir(tmp_path / "other")
    assert explainer.explain(photo).confidence == pytest.approx(usual.confidence, abs=0.02)

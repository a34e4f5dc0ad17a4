"""Fits on a GPU that is pretended, and all kernels compiled for real ones; `test_gpu.py` runs on one."""

from __future__ import annotations

import math
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
import warp as wp

import vig
import vig_renderer
from tests.pretend import NAME, MixedDevicesError, is_there, pretended
from tests.support import points_of
from vig.inference import ExplainSettings, explain_one
from vig.inference.posterior import geometry_of
from vig.inference.prior_kernel import prior_kernel
from vig.likelihood import Likelihood, Photos
from vig.likelihood.geometry import Geometry
from vig.likelihood.kernels.load import likelihood_kernels
from vig.photo import Window
from vig.recognition import Recognizer
from vig.renderer import MeshObject, Pinhole, Scene, Topology, render
from vig.search.damped_step import search_kernels
from vig_app.examples import FOLDER
from vig_paper.optimizers import OPTIMIZERS
from vig_renderer.primitives import crossings, texture, visibility

SOURCE, RENDERER = Path(vig.__file__).parent, Path(vig_renderer.__file__).parent
PHOTO = FOLDER / "01_open.png"
WHOLE = Window.of(150, 150)


@pytest.fixture(autouse=True)
def _forget_geometries() -> Iterator[None]:
    yield
    geometry_of.cache_clear()


@pytest.fixture(scope="module")
def on_cpu(packaged: vig.ObjectClass) -> vig.Explanation:
    return vig.Explainer(packaged).explain(PHOTO, window=WHOLE)


def test_an_explanation_is_that_of_the_cpu(
    packaged: vig.ObjectClass, on_cpu: vig.Explanation, monkeypatch: pytest.MonkeyPatch
) -> None:
    with pretended(monkeypatch):
        found = vig.Explainer(packaged, device="cuda").explain(PHOTO, window=WHOLE)
    assert found.verdict is on_cpu.verdict
    # A network in float32 in place of bfloat16, and rows added in another order.
    assert found.azimuth_deg == pytest.approx(on_cpu.azimuth_deg, abs=2.0)
    assert found.elevation_deg == pytest.approx(on_cpu.elevation_deg, abs=2.0)
    assert (found.mask != on_cpu.mask).mean() < 0.005
    assert not any(map(is_there, (*vars(found.fit).values(), *vars(found.latents).values())))


@pytest.mark.parametrize("name", sorted(OPTIMIZERS))
def test_a_fit_keeps_to_its_device(
    name: str, packaged: vig.ObjectClass, on_cpu: vig.Explanation, monkeypatch: pytest.MonkeyPatch
) -> None:
    photo = torch.from_numpy(on_cpu.photo)
    prediction = Recognizer.of_class(packaged)(photo[None])
    settings = ExplainSettings(optimizer=OPTIMIZERS[name])
    host = explain_one(photo, prediction, packaged, settings)
    with pretended(monkeypatch):
        found = explain_one(photo, prediction, packaged, settings, device=NAME)
    # Descents end before they have converged: changing the photo by 1e-7 moves them as far.
    assert found.evidence == pytest.approx(host.evidence, rel=0.02)
    turned = float(found.latents.azimuth - host.latents.azimuth)
    assert abs(turned) < math.radians(3) and found.verdict is host.verdict


def test_mixed_devices_are_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    with pretended(monkeypatch):
        there, here = torch.ones(3, device=NAME), torch.ones(3)
        assert str((there + 1).device) == NAME and str(here.device) == "cpu"
        for mixed in (
            lambda: there + here,
            lambda: there[torch.arange(2)],
            lambda: torch.stack([there, here]),
            lambda: here @ there,
            lambda: there.numpy(),
            lambda: wp.from_torch(here),
        ):
            with pytest.raises(MixedDevicesError):
                mixed()
        assert torch.equal((there + here.to(NAME)).cpu(), here + 1)


def test_an_evaluation_waits_for_nothing(studio: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    """Else no graph of it could be captured. Rows in segments make the CPU's normal matrix."""
    rng = np.random.default_rng(3)
    latents = studio.latents(rng, 2)
    log_prior = torch.from_numpy(np.log(rng.dirichlet((5, 2, 3), (1, 150, 150))))
    photos = Photos(studio.photo(rng, latents[:1]), log_prior)
    host = points_of(latents).double()

    def evaluated(at: str) -> tuple[torch.Tensor, ...]:
        likelihood = Likelihood(Geometry(studio.geometry.model, torch.float64, at), studio.camera, photos)
        photo, sigma = torch.zeros(2, dtype=torch.int32, device=at), torch.full((2,), 0.03, device=at)
        points = host.to(at)
        with likelihood._pass(2) as run:
            before = mode.reads if at == NAME else 0
            run(points, photo, sigma, 2, False)
            assert at != NAME or mode.reads == before
            return tuple(result.cpu().clone() for result in (run.value, run.gradient, run.normal))

    expected = evaluated("cpu")
    with pretended(monkeypatch) as mode:
        found = evaluated(NAME)
    for there, here in zip(found, expected, strict=True):
        torch.testing.assert_close(there, here, rtol=1e-9, atol=1e-9 * float(here.abs().max()))


def test_a_mesh_is_drawn_on_its_own_device(
    packaged: vig.ObjectClass, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Native code would read a table of another device at an address of the host."""
    model = packaged.shape_model

    def drawn(at: str, topology: Topology) -> torch.Tensor:
        def moved(numbers: Any) -> torch.Tensor:
            return torch.from_numpy(np.array(numbers, np.float64)).to(at)

        turn, place = [[1, 0, 0], [0, 0, -1], [0, 1, 0]], [0.0, 0.1, 0.5]
        camera = Pinhole(60, 40, *map(moved, ([80.0, 80.0], [30.0, 20.0], turn, place)))
        item = MeshObject(moved(model.mean), topology, moved([0.2, 0.4, 0.6]), light=moved([1.0] + 8 * [0.1]))
        return render(Scene([item], camera)).rgb.cpu().clone()

    here = Topology.of(model.faces, model.mean)
    expected = drawn("cpu", here)
    with pretended(monkeypatch):
        there = Topology.of(model.faces, model.mean, device=NAME)
        torch.testing.assert_close(drawn(NAME, there), expected, rtol=1e-9, atol=1e-12)
        for at, topology, where in (("cpu", there, NAME), (NAME, here, "cpu")):
            with pytest.raises(
                ValueError, match=f"topology of object 0 .* must be on {at}.* it is on {where}"
            ):
                drawn(at, topology)


@pytest.mark.slow
def test_all_kernels_compile_for_gpus(packaged: vig.ObjectClass, tmp_path: Path) -> None:
    """To machine code of sm_80 (A100) and sm_90 (H100); native snippets are C++ that Warp hands on unread."""
    if wp.get_cuda_toolkit_version() is None:
        pytest.skip("this build of Warp has no CUDA compiler")
    real = torch.float32
    search_kernels(real)
    modules = [
        likelihood_kernels(real, packaged.shape_model.modes, "gaussian").place.module,
        prior_kernel(real).module,
        visibility._draw_layers(real).module,
        crossings._kernels(real).find_silhouette.module,
        texture._kernels(real).backward.module,
    ]
    kernels = [kernel for module in modules for kernel in module.kernels.values()]
    files = {Path(kernel.func.__code__.co_filename) for kernel in kernels}
    processor_only = {RENDERER / "native.py", SOURCE / "likelihood" / "image_kernels.py"}
    sources = [*SOURCE.rglob("*.py"), *RENDERER.rglob("*.py")]
    kept = {path for path in sources if "wp.kernel(" in path.read_text()} - processor_only
    assert files == kept
    for module in modules:
        made = wp.compile_aot_module(module, arch=[80, 90], module_dir=tmp_path / module.name, use_ptx=False)
        assert len(list((tmp_path / module.name).glob("*.cubin"))) == 2, made


def test_a_device_that_is_missing_is_refused() -> None:
    with pytest.raises(vig.UserError, match=r"expected device 'cpu'.*; got 'cuda:9'\. Leave it out"):
        vig.Explainer("teapot", device="cuda:9")

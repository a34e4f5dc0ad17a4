"""No sample ends a run: what cannot be made is drawn anew, counted, and, where it is a fault, named."""

import json
import runpy
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from tests.support import TEAPOT
from vig.io.errors import UserError
from vig.scene import ObjectClass
from vig_world.composition.sampling import MAX_OCCLUSION, CompositionError, sample
from vig_world.dataset.format import image_paths, read_info
from vig_world.dataset.spec import SceneSpec
from vig_world.generation import job
from vig_world.generation.check import check_dataset
from vig_world.generation.write import make_dataset
from vig_world.library import Library

COUNT, SEED = 6, 5  # as the fixture `made`, which has ten
FAILING = f"""
import os, signal, sys
from vig.scene import ObjectClass
from vig_world.composition.sampling import CompositionError
from vig_world.generation import job
from vig_world.generation.write import make_dataset

whole = job.sample

def failing(library, object_class, seed, index, world, draw=0):
    if index == 1 and draw < 2:
        raise CompositionError("no room")
    if index == 3 and draw == 0:
        raise FloatingPointError("a fault")
    if index == 4 and draw == 0:
        if __name__ != "__main__":
            os.kill(os.getpid(), signal.SIGKILL)
        raise MemoryError
    return whole(library, object_class, seed, index, world, draw=draw)

job.sample = failing
if __name__ == "__main__":
    teapot = ObjectClass.load({str(TEAPOT)!r})
    make_dataset(sys.argv[1], {COUNT}, {SEED}, workers=int(sys.argv[2]), progress=False, object_class=teapot)
"""


@pytest.mark.slow
def test_what_cannot_be_made_is_drawn_anew_the_same_for_any_number_of_workers(
    made: Path,
    teapot: ObjectClass,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    """Two draws of sample 1 have no room, a fault in one of sample 3; one of sample 4 kills its process."""
    script, manifests = tmp_path / "failing.py", []
    script.write_text(FAILING)
    for workers in ("1", "2"):
        out = tmp_path / workers
        arguments = [str(script), str(out), workers]
        if workers == "1":
            with monkeypatch.context() as patch:
                patch.setattr(sys, "argv", arguments)
                patch.setattr(job, "sample", job.sample)  # which the script replaces
                runpy.run_path(str(script), run_name="__main__")
            errors = capsys.readouterr().err
        else:
            done = subprocess.run([sys.executable, *arguments], capture_output=True, text=True)
            errors = done.stderr
            assert done.returncode == 0, errors
        lines = sorted(errors.splitlines())
        assert lines[0] == "sample 3: FloatingPointError: a fault; another scene takes its place"
        assert lines[1].startswith(
            "sample 4: MemoryError" if workers == "1" else "sample 4: its worker process was killed 3 times"
        )
        assert len(lines) == 2
        info = read_info(out)["splits"]["train"]
        assert info["redrawn"] == 3 and info["rejections"]["scene"] == 2 + 1 + 1
        manifests.append(info["manifest_sha256"])
    assert manifests[0] == manifests[1]
    specs = [SceneSpec.from_json(line) for line in (out / "train" / "specs.jsonl").read_text().splitlines()]
    assert [spec.rejected.get("scene", 0) for spec in specs] == [0, 2, 0, 1, 1, 0]
    for index in (0, 2, 5):
        for path in image_paths(Path("train"), index).values():
            assert (out / path).read_bytes() == (made / path).read_bytes()
    assert check_dataset(out, render=COUNT, object_class=teapot).problems == ()


@pytest.mark.parametrize("count", [1, 3, 40])
@pytest.mark.parametrize("error", [CompositionError("no room"), ZeroDivisionError("no room")])
def test_a_run_whose_every_sample_fails_ends_with_one_line(
    count: int, error: Exception, teapot: ObjectClass, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def failing(*given: Any, **named: Any) -> SceneSpec:
        raise error

    monkeypatch.setattr(job, "sample", failing)
    with pytest.raises(UserError, match=r"16 failed and 0 were made\. The last failure: .*no room") as raised:
        make_dataset(tmp_path, count, SEED, workers=1, progress=False, object_class=teapot)
    assert "\n" not in str(raised.value)


def test_a_further_draw_is_another_scene_and_a_pure_function(teapot: ObjectClass) -> None:
    first, second, third = (sample(Library("train"), teapot, 11, 3, draw=draw) for draw in range(3))
    assert sample(Library("train"), teapot, 11, 3, draw=1) == second
    assert len({spec.azimuth for spec in (first, second, third)}) == 3
    assert len({spec.target for spec in (first, second, third)}) == 3
    assert max(second.target, third.target) < MAX_OCCLUSION
    assert "scene" not in first.rejected and third.rejected["scene"] == 2
    assert json.loads(second.to_json())["rejected"]["scene"] == 1

"""`vig doctor`: data of a bug report, a check of the native code, and causes of slowness."""

import json
import shutil
import time
from contextlib import suppress
from dataclasses import asdict
from typing import Any

import numpy as np

from vig.io.files import cache_folder
from vig.io.machine import machine
from vig.io.printing import note
from vig_app.cli import speed
from vig_app.cli.common import Doctor
from vig_native import ISA


def doctor() -> dict[str, Any]:
    """Collect versions, and draw one triangle with the renderer.

    Returns the fields of `machine` and `{"instruction_set": str, "classes": {name: "ok" or the defect of its
    pack}, "renderer": {"ok", "detail"}, "speed": [{"what", "state", "do"}], "extras": {name: {"missing":
    [modules], "brings", "install"}}, "ok"}`, ready for JSON. Nothing is raised: a failure is a line in the
    place of its result.
    """
    described = machine()
    findings = [asdict(find(described["cpus"])) for find in (speed.threads, speed.load, speed.memory)]
    findings.append(asdict(speed.cache_state()))
    renderer = check_renderer()
    classes = check_classes()
    ok = renderer["ok"] and set(classes.values()) == {"ok"}
    report = {"instruction_set": ISA, "classes": classes, "renderer": renderer, "speed": findings}
    return described | report | {"extras": speed.extras(), "ok": ok}


def check_classes() -> dict[str, str]:
    """Return each packaged class's name with "ok", or with the missing or damaged part of its pack."""
    from vig.inference import calibration_of
    from vig.recognition import Recognizer
    from vig.scene import ObjectClass
    from vig.scene.object_class import PACKAGED

    states = {}
    for path in sorted(PACKAGED.glob("*/class.json")):
        try:
            object_class = ObjectClass.load(path.parent)
            Recognizer.of_class(object_class)
            state = "ok" if calibration_of(object_class) else "no calibration"
        except Exception as error:  # whatever is wrong with a file, saying so is what doctor is for
            state = f"failed: {_line(error)}"
        states[path.parent.name] = state
    return states or {"none": "no class is packaged with this installation"}


def check_renderer() -> dict[str, Any]:
    """Draw one triangle on the CPU and count its pixels: {"ok": bool, "detail": one line}."""
    # Corners at the pixels (0, 0), (18.5, 0), (0, 18.5) of a 20 x 20 image, 1 m away. The centre of pixel
    # (i, j) is inside when i + j + 1 < 18.5: 1 + 2 + ... + 18 pixels.
    expected = 171
    corners = np.array([[0, 0], [18.5, 0], [0, 18.5]])
    vertices = np.column_stack([(corners - 10) / 20, np.ones(3)]).astype(np.float32)
    start = time.perf_counter()
    try:
        from vig.renderer.drawing import draw_mesh, mesh_of

        mesh, white = mesh_of(np.array([[0, 1, 2]]), vertices), np.ones(3)
        eye = np.eye(3), np.zeros(3), (20.0, 20.0), (10.0, 10.0)
        rendering = draw_mesh(mesh, vertices, None, white, eye, 20, 20)
        drawn = rendering.triangle_id == 0
        count = int(drawn.sum())
        ok = count == expected and bool(np.allclose(rendering.depth[drawn], 1, atol=1e-5))
    except Exception as error:  # a broken installation may raise anything; saying so is what doctor is for
        return {"ok": False, "detail": f"failed: {_line(error)}"}
    seconds = time.perf_counter() - start
    return {"ok": ok, "detail": f"{count} of {expected} pixels of a triangle drawn in {seconds:.2f} s"}


def run_doctor(settings: Doctor) -> int:
    """Print the report, for people or as JSON; returns 0, or 1 when a class or the renderer does not work."""
    if settings.clean:
        note(f"removing the cache: {speed.cache_state().state}")
        with suppress(RuntimeError):  # no home folder
            shutil.rmtree(cache_folder(), ignore_errors=True)
    report = doctor()
    print(json.dumps(report, indent=2) if settings.json else report_lines(report))
    return 0 if report["ok"] else 1


def report_lines(report: dict[str, Any]) -> str:
    """Return the report as aligned plain text."""
    rows = [
        ("vig", report["vig"]),
        ("python", report["python"]),
        ("platform", report["platform"]),
        ("architecture", report["architecture"]),
        ("processor", f"{report['cpus']} x {report['processor']}"),
        *((name, version or "not installed") for name, version in report["packages"].items()),
        ("native code", f"for {report['instruction_set']}"),
        *((f"class {name}", state) for name, state in report["classes"].items()),
        ("renderer", ("ok: " if report["renderer"]["ok"] else "NOT OK: ") + report["renderer"]["detail"]),
        *speed.rows(report["speed"], report["extras"]),
    ]
    width = max(len(name) for name, _ in rows) + 2
    return "\n".join(f"{name:<{width}}{value}" for name, value in rows)


def _line(error: Exception) -> str:
    return " ".join(f"{type(error).__name__}: {error}".split())

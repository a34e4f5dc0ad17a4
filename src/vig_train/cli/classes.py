"""`vig class VERB`: the work of each verb."""

import itertools
import re
import time
from math import inf

from vig.io.errors import UserError
from vig.io.printing import end, in_one_line
from vig.scene.object_class import BUILD_COMMAND
from vig_train.cli.common import check_ranges, command_line
from vig_train.cli.settings import Build


def build(settings: Build) -> int:
    """Run `vig class build`."""
    from vig.recognition import WEIGHTS_FILE
    from vig_train.building import BuildSettings, build_class
    from vig_train.building.build import STEPS, is_step

    try:
        from vig_train import class_training
    except ModuleNotFoundError as error:
        if error.name != "torch":
            raise
        class_training = None  # type: ignore[assignment]
    check_ranges(settings, workers=(1, inf))

    turns = [_turn(turn) for turn in settings.turn]
    if len(dict(turns)) < len(turns):
        raise UserError("expected one --turn for each mesh; got two for one.")
    build_settings = BuildSettings(
        settings.name or settings.out.resolve().name,
        settings.up,
        settings.front,
        settings.shows,
        settings.symmetry,
        settings.length,
        dict(turns),
        settings.drop,
        settings.vertices,
        dict.fromkeys(settings.places, 1.0),
        settings.materials,
    )
    command = command_line("vig class build", settings, positional=("meshes",))
    trains = settings.recognizer and class_training is not None
    began, stage = time.monotonic(), itertools.count(1)

    def say(line: str) -> None:
        step = re.sub(r"^\d/\d ", "", line)  # the quick recognizer has three steps of its own
        if is_step(line) or step != line:
            minutes = (time.monotonic() - began) / 60
            line = f"stage {next(stage)} of {STEPS + 3 * trains}, {minutes:.0f} min so far: {step}"
        if not settings.json:
            print(in_one_line(line), flush=True)

    result = build_class(
        settings.meshes, settings.out, build_settings, say, not settings.json, command, not trains
    )
    if trains and not (settings.out / WEIGHTS_FILE).exists():
        quick = class_training.QUICK
        class_training.ClassTraining(settings.out, quick, workers=settings.workers, say=say).run()
    (settings.out / BUILD_COMMAND).unlink(missing_ok=True)
    is_trained = (settings.out / WEIGHTS_FILE).exists()
    errors, components = result.components.errors, len(result.components.basis)
    described = {
        "meshes": len(result.scans),
        "taken": {result.scans[number].name: split for number, split in result.splits.items()},
        "refused": result.refused,
        "symmetry": result.upright.symmetries.symmetry,
        "components": components,
        "leave_one_out": errors[components] if errors else None,
    }
    upright = settings.out / "build" / "2-upright.png"
    look = f"look at {settings.out / 'card.md'}; where {upright} is wrong: --up, --front, --turn, --drop"
    train = f"vig class train {settings.out} gives it a good recognizer"
    if class_training is None:
        train = f"pip install 'vig[train]', then {train}"
    taken, refused = len(result.splits), len(result.refused)
    of = f" of {taken} of {taken + refused} meshes, {refused} refused (see {settings.out / 'card.md'})"
    made = "made a class" + (of if refused else "")
    without = "" if is_trained else ", without a recognizer"
    use = f"vig fit photo.jpg --class {settings.out} takes it; " if is_trained else ""
    end(settings.out, f"{made}{without}: {use}{train}", described if settings.json else None, [look])
    return 0


def _turn(text: str) -> tuple[int, float]:
    """Return the number and the degrees of NUMBER:DEGREES."""
    match = re.fullmatch(r"(\d{1,6}):([-+]?\d{1,4}(?:\.\d+)?)", text)
    if match is None:
        raise UserError(f"expected --turn NUMBER:DEGREES, such as 7:90; got '{text}'.")
    return int(match[1]), float(match[2])

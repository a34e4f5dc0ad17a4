"""A class pack from a folder of meshes, stage by stage; each stage's result is cached for the next run."""

import shlex
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

from vig.io.errors import UserError
from vig.io.files import atomic_write
from vig.io.progress import Meter
from vig.scene.object_class import BUILD_COMMAND
from vig_train.building import pictures
from vig_train.building.materials import dark_part
from vig_train.building.object_class import ClassShapes, object_class_of
from vig_train.building.pack import save_shape_sheets, save_source_meshes, source_meshes, write_pack
from vig_train.building.reading import folder_of, read_scans
from vig_train.building.result import BuildResult
from vig_train.building.settings import BuildSettings
from vig_train.building.stages import BuildRun, StandingMesh, register, surface_of, template_of
from vig_train.building.upright import upright_poses
from vig_world.assets.own.catalogue import read_sources
from vig_world.threads import one_linear_algebra_thread


@one_linear_algebra_thread()
def build_class(
    meshes: str | Path,
    out: Path,
    settings: BuildSettings,
    say: Callable[[str], None] = print,
    progress: bool = False,
    command: str = "",
    whole: bool = True,
) -> BuildResult:
    """Build a class pack from a folder of meshes or from furniture catalogues.

    Args:
        meshes: A folder of them; any argument of `mesh_folder`, such as `catalogue.sh3f:car`; or a file,
            whose shape is exact.
        out: The pack's folder, made where it is missing.
        settings: The user's statements about the class.
        say: Called with a line for each step.
        progress: Whether to report progress on standard error.
        command: Command that an error about an unfinished pack advises; by default the shortest for these.
        whole: Whether the pack is whole when this ends; else it is when it gets its recognizer.

    Returns:
        The class as written.

    Raises:
        UserError: The folder holds no usable mesh, settings do not fit it, or `out` holds other things.
    """
    settings.check()
    check_folder(out)
    sheets, run = out / "build", BuildRun(out / "build" / "kept", say, progress)

    say(f"reading meshes of {meshes} ...")
    scans, unreadable = read_scans(meshes, settings.materials, progress)
    most_named = 8  # files that are named in one line
    for reason in dict.fromkeys(unreadable.values()):
        names = [name for name, other in unreadable.items() if other == reason]
        more = f" and {len(names) - most_named} more" if len(names) > most_named else ""
        say(f"left out {', '.join(names[:most_named])}{more}: {reason}")
    for scan in scans:
        for note in scan.notes:
            say(f"{scan.name}: {note}")
    used = settings.used_meshes(len(scans))
    say(f"{_count_of(len(scans), 'mesh')} from {meshes}")
    command = command or shlex.join(["vig", "class", "build", str(meshes), "--out", str(out)])
    if not (out / "class.json").exists():  # a pack of an earlier build is whole until its files are replaced
        _write_command(out, command)
    say("drawing what was read, build/1-as-they-are.png ...")
    pictures.save_mesh_sheet(sheets / "1-as-they-are.png", [(scan.vertices, scan.faces) for scan in scans])

    say("sampling surfaces ...")
    with Meter(len(scans), 0, progress, "surfaces") as meter:
        surfaces = []
        for scan in scans:
            surfaces.append(surface_of(scan, run))
            meter.advance(1)
    upright = upright_poses(scans, surfaces, used, settings, run)
    for line in upright.report:
        say(line)
    standing = [StandingMesh.of(*each) for each in zip(scans, surfaces, upright.rotations, strict=True)]
    arrow = "" if upright.symmetries.symmetry == "any-turn" else settings.shows or "the front"
    pictures.save_mesh_sheet(
        sheets / "2-upright.png", [mesh.triangles for mesh in standing], above=True, arrow=arrow
    )
    if arrow and settings.front is None:
        say(
            f"the front is a guess: where the arrows of {sheets / '2-upright.png'} do not point to {arrow},"
            f" state --front={upright.back} for the opposite of all, --turn NUMBER:180 for a mesh"
        )

    others = " most like the others" if len(used) > 1 else ""
    say(f"making a template: the mesh{others}, closed, of about {settings.vertices} vertices ...")
    template = template_of(standing, used, settings.vertices, run)
    if template is None:
        raise UserError(f"expected a mesh in '{meshes}' that can be closed; none can. Mend one of them.")
    medoid, closed = standing[template.medoid], (template.vertices, template.faces)
    say(f"template: {medoid.scan.name}, {len(closed[0])} vertices, {len(closed[1])} faces")
    labels = [str(template.medoid + 1), "template"]
    pictures.save_mesh_sheet(sheets / "3-template.png", [medoid.triangles, closed], side=320, labels=labels)

    say("carrying the template onto each mesh ...")
    registered = register(standing, used, template, upright.symmetries.symmetry, run)
    if len(used) == 1 and not registered.accepted:
        reason = registered.qualities[used[0]].reason
        raise UserError(f"expected a mesh that one closed surface can stand for; of '{meshes}' {reason}.")
    if not registered.accepted:
        raise UserError(f"expected meshes of one kind in '{meshes}'; no two are alike. Look at {sheets}.")

    say("making the class: components, materials, holes through each mesh ...")
    (length, size_known), folder = settings.length_of(scans), folder_of(meshes)
    shapes = ClassShapes.of(registered, upright.symmetries, length)
    coloured = source_meshes(shapes) if settings.materials else []
    of_class = [mesh for mesh in coloured if mesh.design >= 0 and mesh.split == "train"]
    dark = dark_part(of_class, shapes.components.mean, template.faces)
    object_class = object_class_of(settings, shapes, dark, run)
    up_known = settings.up is not None or len(used) > 1
    object_class = replace(object_class, size_known=size_known, up_known=up_known)
    say(_line_on_shapes(shapes, len(object_class.families)))
    save_shape_sheets(shapes, sheets)
    if coloured:
        share = "" if dark is None else f"; {dark[0].mean():.0%} of the vertices, dark on most, are a part"
        say(f"training shows {_count_of(len(coloured), 'mesh')} with the materials of the files{share}")
    save_source_meshes(coloured, sheets)

    result = BuildResult(
        object_class=object_class,
        length=length,
        scans=scans,
        unreadable=unreadable,
        upright=upright,
        medoid=template.medoid,
        qualities=registered.qualities,
        splits=dict(zip(shapes.numbers, shapes.splits, strict=True)),
        components=shapes.components,
        sources=read_sources(folder).of({scan.name for scan in scans}),
    )
    _write_command(out, command)
    write_pack(result, shapes, out, run)
    if whole:
        (out / BUILD_COMMAND).unlink()
    return result


STEPS = 9  # steps of `build_class` that take a while, and begin with a line of their own


def is_step(line: str) -> bool:
    """Return whether a line of `build_class` begins a step; others state results."""
    return line.endswith(" ...")


def _write_command(out: Path, command: str) -> None:
    """Mark a pack as unfinished, with the command that finishes it."""
    with atomic_write(out / BUILD_COMMAND) as temporary:
        temporary.write_text(f"{command}\n", encoding="utf-8", errors="surrogateescape")


def check_folder(out: Path) -> None:
    """Raise UserError where a folder for a pack holds files that no build has made."""
    begun = (out / "build").is_dir()
    if out.exists() and not (begun or out.is_dir() and not any(out.iterdir())):
        raise UserError(
            f"'{out}' holds what `vig class build` did not make. Choose a new or an empty folder."
        )


def _line_on_shapes(shapes: ClassShapes, families: int) -> str:
    """Return the line on the shapes that the class is made of."""
    count, components = len(shapes.numbers), shapes.components
    held_out = count - len(shapes.trained)
    kept = f", {held_out} of them held out for validation and test" if held_out else ""
    modes = _count_of(len(components.basis), "shape component")
    modes += f", {families} families by the holes through them" if families else ""
    error = ""
    if components.errors:
        error = f"; a mesh left out is met within {components.errors[len(components.basis)]:.2%} of its size"
    return f"{_count_of(count, 'mesh')} taken{kept}: {'its shape is held' if count == 1 else modes}{error}"


def _count_of(count: int, noun: str) -> str:
    plural = {"mesh": "meshes", "family": "families"}.get(noun, f"{noun}s")
    return f"{count} {noun if count == 1 else plural}"

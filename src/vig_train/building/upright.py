"""The upright pose of each mesh, as the user states it or as it is estimated from all meshes together."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from vig.io.errors import UserError
from vig.io.progress import Meter
from vig.scene.object_class import axis_name
from vig_train.building.pose import (
    ClassSymmetry,
    PointCloud,
    align_clouds,
    alignment_steps,
    axis_of_revolution,
    class_symmetry,
    cube_turn_to_up,
    front_angle,
    levelling_rotation,
    rotation_to_vertical,
    straightening_angle,
    up_axis,
    usual_axes,
)
from vig_train.building.reading import Scan
from vig_train.building.settings import BuildSettings, axis_vector
from vig_train.building.stages import BuildRun
from vig_train.building.surface import SurfaceSample
from vig_world.rotations import about_z


@dataclass(frozen=True)
class UprightPoses:
    """The meshes upright in one frame, +X the front.

    Attributes:
        rotations: (N, 3, 3) from each file's axes; the identity for dropped meshes.
        symmetries: Symmetries of the class.
        report: Axes and symmetries, and whether each was estimated or given, one line each.
        back: The axis opposite to the front in most files, such as "-x"; empty where any turn looks the same.
    """

    rotations: np.ndarray
    symmetries: ClassSymmetry
    report: tuple[str, ...]
    back: str = ""


def upright_poses(
    scans: Sequence[Scan],
    surfaces: Sequence[SurfaceSample],
    used: list[int],
    settings: BuildSettings,
    run: BuildRun,
) -> UprightPoses:
    """Put meshes upright, their fronts to +X.

    Args:
        scans: (N,) all meshes.
        surfaces: (N,) surface of each, in its file's axes.
        used: Indices of the meshes that are not dropped; the others do not affect the pose.
        settings: The user's statements on axes, symmetry and turns.
        run: Keeps the rotations into a common pose.

    Raises:
        UserError: The front that the user states is not level.
    """
    surfaces = [surfaces[n] for n in used]
    run.say("comparing poses ...")
    to_common = _common_pose([scans[n] for n in used], surfaces, run)
    from_usual = usual_axes(to_common)
    up = up_axis(surfaces, to_common) if settings.up is None else from_usual @ axis_vector(settings.up)
    report = [f"up: {axis_name(from_usual.T @ up)} in most files, {_source(settings.up)}"]
    from_common = cube_turn_to_up(up)
    levelled = [from_common @ rotation for rotation in to_common]
    if len(used) > 1 or settings.up is None:  # the axis that is stated of a single mesh is exact
        levelled = [
            _level_rotation(surface, upright, from_usual.T @ up, settings.symmetry)
            for surface, upright in zip(surfaces, levelled, strict=True)
        ]
    clouds = [_turned_cloud(surface, turn) for surface, turn in zip(surfaces, levelled, strict=True)]
    run.say("looking for symmetries and the front ...")
    symmetries = _symmetries(clouds, settings.symmetry)
    lathe = "; of pots and the like, whatever their handles, state --symmetry any-turn"
    unsure = settings.symmetry is None and symmetries.symmetry == "none"
    report.append(f"symmetry: {symmetries.symmetry}, {_source(settings.symmetry)}{lathe if unsure else ''}")
    has_one_plane = symmetries.mirror and symmetries.symmetry == "none"
    if settings.front is None:
        front = front_angle(clouds, symmetries.mirror_plane) if has_one_plane else 0.0
    else:
        ahead = from_common @ from_usual @ axis_vector(settings.front)
        if abs(ahead[2]) > 0.5:
            raise UserError(f"expected a front that is level; got {settings.front} with {report[0]}.")
        front = math.atan2(ahead[1], ahead[0])
    back = ""
    if symmetries.symmetry != "any-turn":
        ahead = from_usual.T @ from_common.T @ np.array([math.cos(front), math.sin(front), 0.0])
        report.append(f"front: {axis_name(ahead)} in most files, {_source(settings.front)}")
        back = axis_name(-ahead)
        report.append(f"mirror plane: {'yes' if symmetries.mirror else 'none'}")
    rotations = np.tile(np.eye(3), (len(scans), 1, 1))
    for number, surface, rotation in zip(used, surfaces, levelled, strict=True):
        turned = about_z(-front) @ rotation
        if has_one_plane:
            turned = about_z(straightening_angle(_turned_cloud(surface, turned))) @ turned
        rotations[number] = about_z(math.radians(settings.turns.get(number + 1, 0.0))) @ turned
    return UprightPoses(rotations, symmetries, tuple(report), back)


def _common_pose(scans: Sequence[Scan], surfaces: Sequence[SurfaceSample], run: BuildRun) -> list[np.ndarray]:
    """Return rotations (3, 3) of the surfaces from their files' axes to a pose in which they are alike."""

    def compute() -> dict[str, np.ndarray]:
        clouds = [PointCloud.from_surface(surface) for surface in surfaces]
        with Meter(alignment_steps(len(clouds)), 0, run.progress, "comparisons") as meter:
            _, rotations, costs = align_clouds(clouds, meter.advance)
        return {"rotations": np.array(rotations), "costs": costs}

    return list(run.result("pose", [scan.content_hash for scan in scans], compute)["rotations"])


def _source(setting: str | None) -> str:
    """Return where a reported axis or symmetry comes from."""
    return "estimated" if setting is None else "as stated"


def _turned_cloud(surface: SurfaceSample, rotation: np.ndarray) -> PointCloud:
    return PointCloud.from_surface(surface.transform(rotation, np.zeros(3)))


def _level_rotation(
    surface: SurfaceSample, upright: np.ndarray, usual_up: np.ndarray, symmetry: str | None
) -> np.ndarray:
    """Return the rotation (3, 3) that puts a mesh level, near the rotation `upright` of the common pose.

    That is its foot level; or, where the user states a class of surfaces of revolution, its axis vertical:
    then which end is up is decided by the up axis `usual_up` (3,) of most files where it is within about 26
    degrees of the axis, else by the common pose.
    """
    if symmetry != "any-turn":
        return levelling_rotation(surface.transform(upright, np.zeros(3))) @ upright
    own_up = upright[2]
    axis = axis_of_revolution(PointCloud.from_surface(surface), own_up)
    return rotation_to_vertical(axis, usual_up if abs(axis @ usual_up) > 0.9 else own_up)


def _symmetries(clouds: list[PointCloud], stated: str | None) -> ClassSymmetry:
    """Return the symmetries of upright clouds, with the one that the user states in place of the estimate."""
    symmetries = class_symmetry(clouds)
    if stated is not None:
        symmetries = replace(symmetries, symmetry=stated)
    return replace(symmetries, mirror=True) if symmetries.symmetry == "any-turn" else symmetries

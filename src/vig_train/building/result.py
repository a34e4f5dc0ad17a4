"""A built class, its sources, and its card."""

from dataclasses import dataclass

import numpy as np

from vig.scene import ObjectClass
from vig_train.building.acceptance import Quality
from vig_train.building.model import Components
from vig_train.building.reading import Scan
from vig_train.building.upright import UprightPoses
from vig_train.packs.card import table_lines
from vig_world.assets.own.catalogue import Source
from vig_world.dataset.spec import Split


@dataclass(frozen=True)
class BuildResult:
    """A built class, and its sources.

    Attributes:
        object_class: The class, as saved.
        length: Longest side of its mean shape, metres, as stated or assumed.
        scans: All meshes that could be read.
        unreadable: Reasons why other files were left out, by name.
        upright: Rotations of the meshes to the class's frame.
        medoid: Index of the mesh that the template was made from.
        qualities: Fit quality of each mesh that was not dropped, by its index.
        splits: Split of each accepted mesh, by its index.
        components: The shape model.
        sources: Origins of the meshes that come from furniture catalogues.
    """

    object_class: ObjectClass
    length: float
    scans: list[Scan]
    unreadable: dict[str, str]
    upright: UprightPoses
    medoid: int
    qualities: dict[int, Quality]
    splits: dict[int, Split]
    components: Components
    sources: tuple[Source, ...] = ()

    @property
    def refused(self) -> dict[str, str]:
        """Return why each mesh that is not in the class was left out, by its file's name."""
        reasons = dict(self.unreadable)
        for index, scan in enumerate(self.scans):
            if index not in self.splits:
                quality = self.qualities.get(index)
                reasons[scan.name] = "dropped" if quality is None else quality.reason
        return reasons


def card(result: BuildResult) -> str:
    """Return the card of a built class in Markdown."""
    object_class, components = result.object_class, result.components
    size, count = np.ptp(object_class.shape_model.mean, axis=0), len(result.scans) + len(result.unreadable)
    lines = [
        f"# Class {object_class.name}",
        "",
        f"Built by `vig class build` from {len(result.splits)} of {count} meshes."
        " Licences of the meshes are those of their authors; the pack holds shapes derived from them.",
        "",
        f"Mean size {size[0]:.3f} x {size[1]:.3f} x {size[2]:.3f} m (length, width, height):"
        f" metres are only as true as `--length {result.length:g}`.",
        "",
        *(f"- {line}" for line in result.upright.report),
        "",
        "![upright](build/2-upright.png)",
        "",
        "## Meshes",
        "",
    ]
    rows = []
    for number, scan in enumerate(result.scans):
        quality = result.qualities.get(number)
        if quality is None:
            rows.append([str(number + 1), scan.name, "dropped", *[""] * 4])
            continue
        split = result.splits[number] if number in result.splits else f"refused: {quality.reason}"
        shares = quality.unmatched_mesh, quality.unmatched_template, quality.folded_share
        measured = [f"{100 * quality.mean:.2f}", *(f"{share:.1%}" for share in shares)]
        rows.append([str(number + 1), scan.name, split, *measured])
    rows += [["-", name, f"left out: {why}", *[""] * 4] for name, why in result.unreadable.items()]
    lines += [
        *table_lines(["number", "file", "taken", "off, % of size", "lacking", "spare", "folded"], rows),
        "",
        f"The template is {result.scans[result.medoid].name}. Off: mean distance both ways. Lacking: share of"
        " the mesh that the template does not reach. Spare: share of the template that the mesh lacks."
        " Folded: share of its edges at which the template folds over itself."
        + (
            " Any turn leaves the shapes the same: up to 9 % of a mesh, as handles, may be left out of them."
            if result.upright.symmetries.symmetry == "any-turn"
            else ""
        ),
        "",
        "![registered](build/4-registered.png)",
        "",
        "## Shapes",
        "",
        "One, which fits hold."
        if object_class.shape_model.rigid
        else f"{len(components.basis)} components"
        + (
            f", smooth deformations of {components.amplitude:.0%} of the size among them"
            if components.amplitude
            else ""
        )
        + ".",
    ]
    if components.errors:
        lines += [
            f"A mesh left out is met within {components.errors[len(components.basis)]:.2%} of its size in the"
            f" mean ({components.errors[0]:.2%} by the mean shape)."
        ]
    elif not object_class.shape_model.rigid:
        lines.append(
            "Too few meshes for a leave-one-out error: shapes other than these are guessed as smooth."
        )
    if object_class.part_reflectance is not None:
        lines += [
            "",
            f"{object_class.shape_model.parts.mean():.0%} of the vertices are dark on most of the meshes with"
            f" materials: fits give them {object_class.part_reflectance[1]:.0%} of the albedo.",
        ]
    if object_class.families:
        families = [[family.name, f"{family.share:.0%}"] for family in object_class.families]
        lines += ["", *table_lines(["family", "share"], families)]
    lines += ["", "![components](build/6-components.png)", ""]
    if components.errors:
        lines += ["![errors](build/7-leave-one-out.png)", ""]
    return "\n".join(lines + _attribution(result))


def _attribution(result: BuildResult) -> list[str]:
    """Return the authors of the meshes that come from catalogues, as licences such as CC-BY ask for."""
    if not result.sources:
        return []
    rows = [
        [
            cell.replace("|", "/")
            for cell in (s.file, s.name, s.creator or "unknown", s.licence or "unknown", s.catalogue)
        ]
        for s in result.sources
    ]
    return [
        "## Sources",
        "",
        "The meshes come from furniture catalogues. Where a licence asks for attribution, as CC-BY does, this"
        " table has to go with the pack.",
        "",
        *table_lines(["file", "name", "creator", "licence", "catalogue"], rows),
        "",
    ]

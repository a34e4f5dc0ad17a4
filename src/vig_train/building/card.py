"""The card of a class that was built from meshes: what it is made of, how well, and where its limits are."""

from __future__ import annotations

import numpy as np

from vig_train.building.result import BuildResult


def card(result: BuildResult) -> str:
    """The card in Markdown."""
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
        "| number | file | taken | off, % of size | lacking | spare | folded |",
        "|---|---|---|---|---|---|---|",
    ]
    for number, scan in enumerate(result.scans):
        quality = result.qualities.get(number)
        if quality is None:
            lines.append(f"| {number + 1} | {scan.name} | dropped | | | | |")
            continue
        split = result.splits[number] if number in result.splits else f"refused: {quality.reason}"
        shares = " | ".join(
            f"{share:.1%}"
            for share in (quality.unmatched_mesh, quality.unmatched_template, quality.folded_share)
        )
        lines.append(f"| {number + 1} | {scan.name} | {split} | {100 * quality.mean:.2f} | {shares} |")
    lines += [f"| - | {name} | left out: {why} | | | | |" for name, why in result.unreadable.items()]
    lines += [
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
            f" mean ({components.errors[0]:.2%} by the mean shape).",
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
        lines += ["", "| family | share |", "|---|---|"]
        lines += [f"| {family.name} | {family.share:.0%} |" for family in object_class.families]
    lines += ["", "![components](build/6-components.png)", "", "![errors](build/7-leave-one-out.png)", ""]
    return "\n".join(lines + _attribution(result))


def _attribution(result: BuildResult) -> list[str]:
    """The authors of the meshes that come from catalogues, as licences such as CC-BY ask for."""
    if not result.sources:
        return []
    rows = [
        [source.file, source.name, source.creator or "unknown", source.licence or "unknown", source.catalogue]
        for source in result.sources
    ]
    return [
        "## Sources",
        "",
        "The meshes come from furniture catalogues. Where a licence asks for attribution, as CC-BY does, this"
        " table has to go with the pack.",
        "",
        "| file | name | creator | licence | catalogue |",
        "|---|---|---|---|---|",
        *(f"| {' | '.join(cell.replace('|', '/') for cell in row)} |" for row in rows),
        "",
    ]

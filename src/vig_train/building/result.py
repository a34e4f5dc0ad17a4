"""A built class, and what it was built from."""

from __future__ import annotations

from dataclasses import dataclass

from vig.scene import ObjectClass
from vig_train.building.acceptance import Quality
from vig_train.building.model import Components
from vig_train.building.reading import Scan
from vig_train.building.upright import UprightPoses
from vig_world.assets.own.catalogue import Source
from vig_world.dataset.spec import Split


@dataclass(frozen=True)
class BuildResult:
    """A built class, and what it was built from.

    Attributes:
        object_class: As saved.
        length: Longest side of its mean shape, metres, as stated or assumed.
        scans: All meshes that could be read.
        unreadable: Why other files were left out, by name.
        upright: Rotations of the meshes to the class's frame.
        medoid: Index of the mesh that the template was made from.
        qualities: Of each mesh that was not dropped, by its index.
        splits: Of each accepted mesh, by its index.
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
        """Why each mesh that is not in the class was left out, by its file's name."""
        reasons = dict(self.unreadable)
        for index, scan in enumerate(self.scans):
            if index not in self.splits:
                quality = self.qualities.get(index)
                reasons[scan.name] = "dropped" if quality is None else quality.reason
        return reasons

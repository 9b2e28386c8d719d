"""What each preset does to a certain cloud of the library."""

from collections.abc import Mapping
from dataclasses import dataclass

from app.jobs.clouds import cloud_of
from app.library.item import ScanItem
from app.surface.finish import Preset, preset_mesh, preset_steps
from app.surface.meshing.options import MeshOptions
from app.surface.ply_reader import PlyFile
from app.surface.step import StepDocument

_JOINED, _CLEANED = "joined", "cleaned"


@dataclass(frozen=True, slots=True)
class Finishing:
    """Steps and mesh of a preset, as they are fit for a cloud."""

    steps: tuple[StepDocument, ...]
    mesh: MeshOptions


def finishing_of(item: ScanItem, cloud: str = "") -> Mapping[Preset, Finishing]:
    """What every preset would do with a cloud; with the newest where none is named.

    A thing that was joined of several scans was seen from below, too: it has no table, and needs no base.

    Raises:
        NotThere: there is no such cloud.
        PointCloudFileError: it cannot be read.
    """
    path = cloud_of(item, cloud)
    name = path.relative_to(item.folder).as_posix()
    made_by = {each.name: each.made_by for each in item.clouds}
    # What was cleaned in a scan that was joined is as round about as before.
    is_joined = made_by[name] in (_JOINED, _CLEANED) and _JOINED in made_by.values()
    is_on_table = bool(PlyFile.open(path).laser_names) and not is_joined
    changes = {"has_flat_base": False} if is_joined else {}
    return {
        preset: Finishing(
            preset_steps(preset, is_on_table=is_on_table), preset_mesh(preset).model_copy(update=changes)
        )
        for preset in Preset
    }

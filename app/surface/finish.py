"""From raw clouds to a thing: steps, a mesh, and what is to be said about both."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from enum import StrEnum
from typing import TYPE_CHECKING, Annotated

import numpy as np
from pydantic import BaseModel, ConfigDict, Field

from app.errors import SurfaceError
from app.geometry.cloud import PointCloud
from app.geometry.mesh import TriangleMesh
from app.surface.meshing.layout import Layout
from app.surface.meshing.options import MeshOptions
from app.surface.normals import has_normals, with_normals
from app.surface.printing import PrintReport, check_print
from app.surface.step import StepDocument, parse_step
from app.surface.texture import Texture, paint_texture
from app.surface.thinning import MOST_POINTS, without_copies

if TYPE_CHECKING:
    from scipy.spatial import cKDTree

    from app.surface.meshing.make import Progress

TextureSize = Annotated[int, Field(ge=64, le=8192)]
"""Pixels along the longer side of a picture with a mesh's colours."""

_FEWEST_POINTS = 50
_GUESS_SAMPLE = 20_000
# In spacings of the points.
_GUESSED_SPACINGS = 8.0
_NOTED_SHARE, _DOUBTFUL_SHARE = 0.1, 0.3


class Preset(StrEnum):
    """What the thing is wanted for."""

    PRINT = "print"
    ARCHIVE = "archive"
    MEASURE = "measure"


_TABLE: StepDocument = {"kind": "table"}
_STEPS: Mapping[Preset, tuple[StepDocument, ...]] = {
    # What was seen at a slant is worth more for a closed thing than the guess that stands there without it.
    Preset.PRINT: ({"kind": "quality", "least": 0.15}, _TABLE, {"kind": "statistical-outliers"}),
    Preset.ARCHIVE: ({"kind": "statistical-outliers"},),
    Preset.MEASURE: ({"kind": "quality"}, {"kind": "statistical-outliers"}),
}
_MESH: Mapping[Preset, MeshOptions] = {
    Preset.PRINT: MeshOptions(tolerance_mm=0.03),
    Preset.ARCHIVE: MeshOptions(is_closed=False, hole_mm=2.0, island_share=0.0),
    Preset.MEASURE: MeshOptions(is_closed=False),
}
_FORMS: Mapping[Preset, tuple[str, ...]] = {
    Preset.PRINT: (".stl", ".3mf"),
    Preset.ARCHIVE: (".ply", ".glb"),
    Preset.MEASURE: (".ply",),
}


class Finish(BaseModel):
    """How clouds become a thing; the preset fills in what is not given.

    Attributes:
        preset: what for.
        steps: that clean the cloud, in order.
        mesh: how the mesh is made.
        has_mesh: whether there is to be one at all.
        texture_px: sides of a picture with the mesh's colours, at most; none where it is not given.
        export: endings of the files that are wanted, such as `.stl`.
        most_points: clouds of more are thinned.
    """

    model_config = ConfigDict(frozen=True, extra="forbid")

    preset: Preset = Preset.PRINT
    steps: tuple[StepDocument, ...] | None = None
    mesh: MeshOptions | None = None
    has_mesh: bool = True
    texture_px: TextureSize | None = None
    export: tuple[str, ...] | None = None
    most_points: Annotated[int, Field(ge=1_000, le=50_000_000)] = MOST_POINTS

    @property
    def mesh_options(self) -> MeshOptions:
        return _MESH[self.preset] if self.mesh is None else self.mesh

    @property
    def forms(self) -> tuple[str, ...]:
        """Endings of the files that are wanted."""
        return _FORMS[self.preset] if self.export is None else self.export

    def steps_for(self, cloud: PointCloud) -> tuple[StepDocument, ...]:
        """Those to be taken; only clouds of this program are known to stand on a table at height zero."""
        if self.steps is not None:
            return self.steps
        return preset_steps(self.preset, is_on_table=bool(cloud.laser_names))


def preset_steps(preset: Preset, *, is_on_table: bool) -> tuple[StepDocument, ...]:
    """The preset's own steps; the table is only looked for where it is known to be at height zero."""
    return tuple(step for step in _STEPS[preset] if is_on_table or step != _TABLE)


def preset_mesh(preset: Preset) -> MeshOptions:
    """The preset's own mesh, to be changed in parts."""
    return _MESH[preset]


@dataclass(frozen=True, slots=True)
class StepReport:
    """What a step left of the points, and what it had to say of them; mostly nothing."""

    kind: str
    before: int
    after: int
    note: str = ""


@dataclass(frozen=True, slots=True)
class FinishReport:
    """What was done.

    Attributes:
        points: that there were.
        copies: left out because they were at a place of another, or at none.
        thinned: left out because there were too many.
        estimated_normals: points that came without a normal.
        steps: one for each step.
        is_strewn: the points of a mesh do not lie as those of a surface do.
        guessed_share: of a closed mesh's surface that lies where no points are, without its flat base.
        printing: checks of a closed mesh.
    """

    points: int
    copies: int
    thinned: int
    estimated_normals: int
    steps: tuple[StepReport, ...]
    is_strewn: bool = False
    guessed_share: float = 0.0
    printing: PrintReport | None = None

    @property
    def notes(self) -> tuple[str, ...]:
        """Sentences that a person should read."""
        notes = []
        if self.estimated_normals:
            notes.append(f"{self.estimated_normals:,} points came without normals. They were estimated.")
        if _NOTED_SHARE < self.guessed_share <= _DOUBTFUL_SHARE:
            notes.append(f"{_percent(self.guessed_share)} of the surface is a guess: no points are there.")
        return tuple(notes)

    @property
    def doubts(self) -> tuple[str, ...]:
        """Why the result must not be trusted; empty where it may."""
        doubts = []
        if self.is_strewn:
            doubts.append("Neighbouring points face different ways, as points do that lie on no surface.")
        if self.guessed_share > _DOUBTFUL_SHARE:
            doubts.append(
                f"{_percent(self.guessed_share)} of the surface is a guess: no points are there. "
                "Scan more sides, or make an open mesh."
            )
        return tuple(doubts)


@dataclass(frozen=True, eq=False, slots=True)
class Finished:
    """A clean cloud, the mesh of it unless none was wanted, its colours as a picture, and what was done."""

    cloud: PointCloud
    mesh: TriangleMesh | None
    report: FinishReport
    texture: Texture | None = None


def finish(
    clouds: Sequence[PointCloud], order: Finish | None = None, progress: "Progress | None" = None
) -> Finished:
    """Clean a cloud, or several in one frame, and make the surface of them.

    Args:
        clouds: raw.
        order: what is wanted.
        progress: told how far it is; may raise to stop it.

    Raises:
        SurfaceError: there are too few points, or they make no surface.
        OptionError: a step does not exist, or has a wrong setting.
    """
    order = order or Finish()
    tell = progress or _nothing
    tell("looking at the points", 0.0)
    raw = clouds[0] if len(clouds) == 1 else PointCloud.joined(list(clouds))
    documents = order.steps_for(raw)
    steps = [parse_step(document) for document in documents]
    cloud = without_copies(raw)
    different = len(cloud)
    if different < _FEWEST_POINTS:
        raise SurfaceError(
            f"The points lie at {different:,} different places; a surface needs {_FEWEST_POINTS}.",
            "Scan again, or name another cloud.",
        )
    cloud = cloud.select(np.arange(0, different, -(-different // order.most_points)))
    thinned = different - len(cloud)
    cloud, estimated = _with_all_normals(cloud, tell)
    done = []
    for number, (document, step) in enumerate(zip(documents, steps, strict=True)):
        tell(f"cleaning: {document['kind']}", 0.1 + 0.2 * number / len(steps))
        before, note = len(cloud), step.says(cloud)
        cloud = step.apply(cloud)
        done.append(StepReport(str(document["kind"]), before, len(cloud), note))
    if len(cloud) < _FEWEST_POINTS:
        raise SurfaceError(
            f"The steps left {len(cloud):,} of {different:,} points; a surface needs {_FEWEST_POINTS}.",
            "Take a step back, or make it less strict.",
        )
    report = FinishReport(len(raw), len(raw) - different, thinned, estimated, tuple(done))
    if not order.has_mesh:
        return Finished(cloud, None, report)
    # As in `Places.of`.
    from scipy.spatial import cKDTree

    from app.surface.meshing.make import make_mesh

    mesh = make_mesh(cloud, order.mesh_options, lambda words, share: tell(words, 0.3 + 0.5 * share))
    texture = None
    if order.texture_px is not None:
        texture = paint_texture(
            mesh, cloud, order.texture_px, lambda share: tell("painting", 0.8 + 0.15 * share)
        )
    tell("checking", 0.95)
    tree = cKDTree(cloud.points, balanced_tree=False)
    report = replace(report, is_strewn=Layout.of(tree, cloud.normals).is_strewn)
    if order.mesh_options.is_closed:
        guessed = _guessed(mesh, tree, order.mesh_options)
        report = replace(report, guessed_share=guessed, printing=check_print(mesh))
    tell("done", 1.0)
    return Finished(cloud, mesh, report, texture)


def _with_all_normals(cloud: PointCloud, tell: Callable[[str, float], None]) -> tuple[PointCloud, int]:
    """And how many had none."""
    # A few without are left out by the mesh; they are not worth the time.
    if has_normals(cloud):
        return cloud, 0
    tell("estimating normals", 0.05)
    missing = int(np.count_nonzero(~np.any(cloud.normals != 0.0, axis=1)))
    return with_normals(cloud), missing


def _guessed(mesh: TriangleMesh, tree: "cKDTree", options: MeshOptions) -> float:
    """The share of a closed surface that has none of the points near it."""
    vectors = mesh.face_vectors()
    areas = np.linalg.norm(vectors, axis=1)
    middles = mesh.corners().mean(axis=1)
    if options.has_flat_base:
        lowest = float(mesh.vertices[:, 2].min())
        is_base = (vectors[:, 2] < -0.9 * areas) & (middles[:, 2] < lowest + 0.5)
        middles, areas = middles[~is_base], areas[~is_base]
    if not areas.sum() > 0.0:
        return 1.0
    rng = np.random.default_rng(0)
    chosen = rng.choice(len(areas), min(_GUESS_SAMPLE, len(areas)), p=areas / areas.sum())
    sample = np.asarray(tree.data)[:: -(-tree.n // 2_000)]
    spacing = float(np.median(tree.query(sample, k=[2], workers=-1)[0]))
    distances = tree.query(middles[chosen], workers=-1)[0]
    sides = np.sqrt(areas[chosen])
    return float(np.mean(distances > _GUESSED_SPACINGS * spacing + sides))


def _percent(share: float) -> str:
    return f"{100.0 * share:.0f} %"


def _nothing(words: str, share: float) -> None:
    pass

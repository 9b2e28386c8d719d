"""One step from a raw cloud to a clean one, as a value that can be kept, shown and taken back."""

from typing import Annotated, Any, TypeAlias

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from app.errors import OptionError
from app.geometry.cloud import PointCloud
from app.registry import Registry


class Step(BaseModel):
    """A change of a cloud, with its settings; each kind registers itself and becomes a form in the page.

    Steps are pure: the same cloud and settings give the same result, so that a list of steps over the raw
    cloud is all that needs to be kept, and taking one back is leaving it out.
    """

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

    def apply(self, cloud: PointCloud) -> PointCloud:
        """The changed cloud; the one that was given stays as it is.

        Raises:
            SurfaceError: the step makes no sense for this cloud.
        """
        raise NotImplementedError

    def for_share(self, share: float) -> "Step":
        """The step for a copy of the cloud with only this share of its points, evenly chosen, 0..1."""
        return self

    def says(self, cloud: PointCloud) -> str:
        """What there is to tell of it, where it is applied to this cloud; mostly nothing."""
        return ""


STEPS: Registry[Step] = Registry("step", "app.surface.steps")

StepDocument: TypeAlias = Annotated[dict[str, Any], Field(examples=[{"kind": "quality", "least": 0.3}])]
"""A step as JSON: its name as `kind`, and its settings."""


def parse_step(document: StepDocument) -> Step:
    """A step from JSON.

    Raises:
        OptionError: there is no such step, or a setting is wrong; names the setting.
    """
    settings = dict(document)
    kind = str(settings.pop("kind", ""))
    maker = STEPS.maker(kind)
    try:
        return maker(**settings)
    except ValidationError as error:
        first = error.errors()[0]
        place = ".".join(str(part) for part in first["loc"]) or "settings"
        raise OptionError(f"Step {kind!r}, {place}: {first['msg']}.") from None


def document_of(step: Step) -> StepDocument:
    """A step as JSON."""
    kind = next(name for name in STEPS if STEPS.maker(name) is type(step))
    return {"kind": kind, **step.model_dump(mode="json")}

"""One tap to see whether a device works: a picture comes, the table turns, each laser blinks."""

from fastapi import APIRouter
from pydantic import BaseModel

from app.api.services import Served
from app.devices.bench import Bench
from app.devices.frame import Use
from app.devices.stripe_look import look_at_stripe
from app.jobs.events import BenchChanged
from app.vision.stripe import LaserView

router = APIRouter(prefix="/bench/try", tags=["bench"])
_TRY_DEG = 10.0


class TriedOut(BaseModel):
    """What was tried, and what was seen of it.

    Attributes:
        ok: whether it is as it should be; a device that fails is answered as a problem instead.
        said: a sentence for each thing that was tried.
    """

    ok: bool
    said: list[str]


@router.post("/camera")
def try_camera(served: Served) -> TriedOut:
    """Take a picture."""
    camera = served.bench.camera
    served.bench.connect_camera()
    frame = camera.fresh_frame()
    brightness = float(frame.image(grey=True).mean())
    width, height = frame.size
    said = [f"A picture of {width} x {height} pixels came from {camera.facts.name}."]
    is_dark = brightness < 2.0
    if is_dark:
        said.append("It is black: take off the lens cap, or expose longer.")
    served.runner.bus.publish(BenchChanged())
    return TriedOut(ok=not is_dark, said=said)


@router.post("/table")
def try_table(served: Served) -> TriedOut:
    """Turn the table by ten degrees and back."""
    bench = served.bench
    bench.refuse_held("trying its table")
    bench.connect_turntable()
    with bench.lease("trying the table", wait_s=0.0):
        start = bench.turntable.angle_deg
        reached = bench.turntable.move_to(start + _TRY_DEG)
        back = bench.turntable.move_to(start)
    served.runner.bus.publish(BenchChanged())
    said = (
        f"The board says that the table turned from {start:.1f} to {reached:.1f} "
        f"and back to {back:.1f} degrees."
    )
    return TriedOut(ok=True, said=[said])


@router.post("/lasers")
def try_lasers(served: Served) -> TriedOut:
    """Light each laser for a moment, and see whether the camera sees its stripe."""
    bench = served.bench
    bench.refuse_held("trying its lasers")
    bench.connect()
    with bench.lease("trying the lasers", wait_s=0.0):
        bench.camera.prepare(Use.LASER)
        seen = {name: _is_seen(bench, served.live.settings.detector, name) for name in bench.lasers}
    served.runner.bus.publish(BenchChanged())
    said = [
        f"The laser {name} went on, and the camera {'sees' if is_seen else 'does not see'} its stripe."
        for name, is_seen in seen.items()
    ]
    return TriedOut(ok=all(seen.values()), said=said or ["The bench has no laser."])


def _is_seen(bench: Bench, detector: str, name: str) -> bool:
    dark = bench.camera.fresh_frame().image()
    with bench.lit(name):
        lit = bench.camera.fresh_frame().image()
    view = LaserView(lit, dark, bench.lasers[name].colour, "vertical")
    return look_at_stripe(view, detector, 0.0).is_seen

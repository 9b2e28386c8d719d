"""The compiled inner loops and their NumPy twins see the same world."""

import numpy as np
import pytest
from simulated_scenes import on_the_table

from app.geometry.transform import RigidTransform, rotation_from_rvec
from app.simulation import kernels
from app.simulation.boards import board_body
from app.simulation.kernels import plain
from app.simulation.noise import Noise
from app.simulation.objects import cube, make_object
from app.simulation.render import Renderer
from app.simulation.rig import standard_rig
from app.simulation.scene import Scene
from app.vision.board import BoardSpec
from app.vision.markers import PlatterSpec

pytestmark = pytest.mark.skipif(not kernels.IS_COMPILED, reason="Numba is not installed")


def scene_of(name: str) -> Scene:
    scanner = standard_rig(160, 90)
    if name == "board":
        spec = BoardSpec("charuco", 4, 3, 16.0, 12.0, "DICT_4X4_50")
        turn = rotation_from_rvec(np.array([0.3, -0.2, 0.1]))
        held = RigidTransform(turn, np.array([-20.0, -15.0, 290.0]))
        return Scene(scanner, (board_body(spec, scanner.table_from_camera @ held, turns=True),))
    if name == "platter":
        platter = PlatterSpec("DICT_4X4_50", 14.0, (1, 2, 3))
        return on_the_table(scanner, cube(), platter=platter, noise=Noise())
    return on_the_table(scanner, make_object(name), noise=Noise(), lens_blur_px=0.4)


@pytest.mark.parametrize("name", ["board", "platter", "cone", "cylinder"])
def test_both_kernels_make_the_same_picture(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    scene = scene_of(name)
    fast = Renderer(scene)
    fast_view = fast.look(0.3)
    fast_light = fast.irradiance(fast_view, "left")
    fast_image = fast.expose(fast_view, ("left", "right"), 5)
    for loop in kernels.LOOPS:
        monkeypatch.setattr(kernels, loop, getattr(plain, loop))
    slow = Renderer(scene)
    slow_view = slow.look(0.3)
    slow_light = slow.irradiance(slow_view, "left")
    slow_image = slow.expose(slow_view, ("left", "right"), 5)

    assert (fast_view.owner != slow_view.owner).mean() < 0.001
    same = fast_view.owner == slow_view.owner
    is_seen = same & np.isfinite(fast_view.depth)
    assert np.allclose(fast_view.depth[is_seen], slow_view.depth[is_seen], atol=1e-3)
    assert np.allclose(fast_view.normal[is_seen], slow_view.normal[is_seen], atol=1e-4)
    assert np.allclose(fast_view.albedo[is_seen], slow_view.albedo[is_seen], atol=0.01)
    assert (np.abs(fast_light - slow_light) > 0.05).mean() < 0.001
    assert fast_light.max() > 30.0
    off = np.abs(fast_image.astype(int) - slow_image.astype(int)).max(axis=2)
    assert (off > 1).mean() < 0.002

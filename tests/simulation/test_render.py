"""What the simulated camera sees."""

from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import numpy as np
import pytest
from simulated_scenes import OFF_AXIS_MM, on_the_table

from app.errors import OptionError
from app.geometry.arrays import Floats, Pixels
from app.simulation.noise import Noise
from app.simulation.objects import cube, make_object, sphere
from app.simulation.render import Renderer, render_shot
from app.simulation.rig import SimulatedRig, standard_rig
from app.simulation.scene import Scene
from app.simulation.view import View
from app.vision.markers import PlatterSpec, detect_markers

RADIUS_MM = 30.0


@pytest.fixture(scope="module")
def scanner() -> SimulatedRig:
    return standard_rig()


@pytest.fixture(scope="module")
def thin(scanner: SimulatedRig) -> SimulatedRig:
    """The same rig with sheets so thin that the curvature within them does not matter."""
    return SimulatedRig.around(scanner.rig, stripe_sigma_px=0.6, table_radius_mm=75.0)


@pytest.fixture(scope="module")
def small() -> SimulatedRig:
    return standard_rig(320, 180)


def centres_of_gravity(light: Floats) -> Pixels:
    """Stripe centres (N, 2) of a noise-free picture, strongest stripe of each row."""
    rows = np.flatnonzero(light.max(axis=1) > 15.0)
    found = []
    for row in rows:
        peak = int(light[row].argmax())
        window = np.arange(max(peak - 12, 0), min(peak + 13, light.shape[1]))
        found.append((np.average(window, weights=light[row, window]), row))
    return np.array(found, np.float64)


def errors_on_the_ball(scene: Scene, laser: str, angle_rad: float) -> Floats:
    """Distance (N,) mm of triangulated points from the ball's surface, its limb and the table left out."""
    renderer = Renderer(scene)
    light = renderer.irradiance(renderer.look(angle_rad), laser).astype(np.float64)
    points = scene.scanner.rig.triangulate(centres_of_gravity(light), laser, angle_rad)
    from_centre = points - OFF_AXIS_MM - [0.0, 0.0, RADIUS_MM]
    distance = np.linalg.norm(from_centre, axis=1)
    in_camera = scene.scanner.rig.axis.table_from_camera(angle_rad).inverse() @ points
    normal = from_centre @ scene.scanner.rig.axis.table_from_camera(angle_rad).rotation
    facing = -np.einsum("ni,ni->n", normal, in_camera) / distance / np.linalg.norm(in_camera, axis=1)
    errors: Floats = (distance - RADIUS_MM)[(np.abs(distance - RADIUS_MM) < 2.0) & (facing > 0.4)]
    return errors


@pytest.mark.parametrize("laser", ["left", "right"])
@pytest.mark.parametrize("angle_rad", [0.0, 1.3])
def test_a_triangulated_ball_has_its_true_radius(thin: SimulatedRig, laser: str, angle_rad: float) -> None:
    errors = errors_on_the_ball(on_the_table(thin, sphere()), laser, angle_rad)

    assert len(errors) > 200
    assert abs(float(errors.mean())) < 0.002
    assert float(np.sqrt(np.mean(errors**2))) < 0.004


def test_a_sheet_of_usual_thickness_shifts_a_curved_surface_by_some_micrometres(
    scanner: SimulatedRig,
) -> None:
    errors = errors_on_the_ball(on_the_table(scanner, sphere()), "left", 0.0)

    assert -0.016 < float(errors.mean()) < -0.002
    assert float(np.std(errors)) < 0.005


def test_the_depth_of_a_ball_is_exact(scanner: SimulatedRig) -> None:
    view = Renderer(on_the_table(scanner, sphere())).look(0.7)
    v, u = np.nonzero(np.isfinite(view.depth))
    rays = scanner.rig.camera.rays(np.column_stack([u, v]).astype(np.float64))
    points = scanner.rig.axis.table_from_camera(0.7) @ (rays * view.depth[v, u, None])
    distance = np.linalg.norm(points - OFF_AXIS_MM - [0.0, 0.0, RADIUS_MM], axis=1)
    on_ball = points[:, 2] > 10.0

    assert np.count_nonzero(on_ball) > 40_000
    assert float(np.abs(distance[on_ball] - RADIUS_MM).max()) < 0.0005
    assert float(np.abs(points[points[:, 2] < 0.001, 2]).min()) < 1e-4


def test_the_laser_does_not_reach_what_lies_in_its_shadow(scanner: SimulatedRig) -> None:
    renderer = Renderer(on_the_table(scanner, cube()))
    view = renderer.look(0.0)
    v, u = np.nonzero(renderer.irradiance(view, "left") > 1.0)
    rays = scanner.rig.camera.rays(np.column_stack([u, v]).astype(np.float64))
    lit = scanner.table_from_camera @ (rays * view.depth[v, u, None])
    source = (scanner.table_from_camera @ scanner.sources["left"].position_mm[None])[0]

    # On the table, straight on from the source through the cube, nothing is lit.
    on_table = lit[np.abs(lit[:, 2]) < 0.01]
    beyond = (on_table - source)[:, :2] @ (-source[:2]) / np.linalg.norm(source[:2])
    assert len(on_table) > 100
    assert beyond.max() < np.linalg.norm(source[:2])
    # Every lit face of the cube looks at the source.
    on_cube = np.abs(lit[:, 2]) > 0.5
    facing = np.einsum(
        "ni,ni->n",
        view.normal[v, u][on_cube],
        scanner.sources["left"].position_mm - (rays * view.depth[v, u, None])[on_cube],
    )
    assert (facing > 0.0).all()


def test_light_falls_only_near_the_sheet(scanner: SimulatedRig) -> None:
    renderer = Renderer(on_the_table(scanner, cube()))
    view = renderer.look(0.4)
    v, u = np.nonzero(renderer.irradiance(view, "right") > 0.0)
    rays = scanner.rig.camera.rays(np.column_stack([u, v]).astype(np.float64))
    off = scanner.rig.lasers["right"].signed_distance(rays * view.depth[v, u, None])

    assert float(np.abs(off).max()) <= 4.51 * scanner.sources["right"].sigma_mm


def test_the_same_seed_gives_the_same_bytes_and_another_does_not(small: SimulatedRig) -> None:
    renderer = Renderer(on_the_table(small, sphere(), noise=Noise()))
    view = renderer.look(0.2)
    first = renderer.expose(view, ("left",), 7)

    assert (renderer.expose(renderer.look(0.2), ("left",), 7) == first).all()
    assert (renderer.expose(view, ("left",), 8) != first).any()


def test_render_shot_takes_its_seed_from_the_generator(small: SimulatedRig) -> None:
    scene = on_the_table(small, sphere(), noise=Noise())
    one, two = (render_shot(scene, ("right",), 0.1, np.random.default_rng(3)) for _ in range(2))

    assert one.shape == (180, 320, 3)
    assert (one == two).all()


def lit_and_dark(scene: Scene, laser: str, noise: Noise) -> tuple[Floats, Floats]:
    renderer = Renderer(scene)
    view = renderer.look(0.0)
    lit = renderer.expose(view, (laser,), 1, noise).astype(np.float64)
    return lit, renderer.expose(view, (), 2, noise).astype(np.float64)


def test_a_red_laser_is_red_and_a_green_one_green() -> None:
    scanner = standard_rig(320, 180, colours={"left": "red", "right": "green"})
    scene = on_the_table(scanner, sphere())
    for laser, channel in (("left", 2), ("right", 1)):
        lit, dark = lit_and_dark(scene, laser, Noise.none())
        gained = (lit - dark).reshape(-1, 3).sum(axis=0)
        assert int(gained.argmax()) == channel
        assert gained[channel] > 5.0 * np.delete(gained, channel).max()


def test_a_bright_stripe_is_clipped_and_its_core_turns_white() -> None:
    dim = standard_rig(320, 180)
    bright = SimulatedRig(dim.rig, {n: replace(s, peak_grey=6000.0) for n, s in dim.sources.items()}, 75.0)
    lit, _ = lit_and_dark(on_the_table(bright, sphere()), "left", Noise.none())

    assert lit.max() == 255.0
    assert lit.min(axis=2).max() > 150.0


def test_speckle_has_its_contrast_and_leaves_the_mean(scanner: SimulatedRig) -> None:
    scene = on_the_table(scanner, sphere())
    renderer = Renderer(scene)
    view = renderer.look(0.0)
    glow = renderer.glow(view, "left")
    light = glow.whole(view.depth.shape)
    red = view.ambient[:, :, 2]
    where = (light > 50.0) & (light + red < 140.0)
    noise = Noise(speckle=0.2, electrons_per_grey=float("inf"), read_grey=0.0)
    shares = np.concatenate(
        [
            (renderer.sense(view, {"left": glow}, seed, noise)[:, :, 2] - red)[where] / light[where]
            for seed in range(30)
        ]
    )

    assert len(shares) > 4_000
    assert abs(float(shares.mean()) - 1.0) < 0.01
    assert abs(float(shares.std()) - 0.2) < 0.008


def test_noise_grows_with_the_light_as_electrons_do(small: SimulatedRig) -> None:
    renderer = Renderer(on_the_table(small, sphere()))
    view = renderer.look(0.0)
    noise = Noise(0.0, electrons_per_grey=5.0, read_grey=1.5)
    pictures = np.stack([renderer.expose(view, (), seed, noise) for seed in range(200)]).astype(np.float64)
    where = view.ambient > 12.0
    expected = view.ambient[where] / 5.0 + 1.5**2 + 1.0 / 12.0

    assert abs(float(np.mean(pictures.var(axis=0)[where] / expected)) - 1.0) < 0.02
    assert float(np.abs(pictures.mean(axis=0)[where] - view.ambient[where]).mean()) < 0.25


@pytest.mark.parametrize("has_markers", [False, True])
def test_a_picture_drawn_in_part_is_the_one_drawn_whole(small: SimulatedRig, has_markers: bool) -> None:
    platter = PlatterSpec("DICT_4X4_50", 14.0, tuple(range(5))) if has_markers else None
    scene = on_the_table(small, make_object("mug"), platter=platter, noise=Noise(), lens_blur_px=0.8)
    # What does not turn is drawn once and for all, over the whole picture.
    bodies = tuple(replace(body, turns=False, is_round=False) for body in scene.bodies)
    renderers = Renderer(scene), Renderer(replace(scene, bodies=bodies))
    part, whole = (renderer.look(0.0) for renderer in renderers)

    assert part.box != whole.box
    for what in ("depth", "owner", "normal", "albedo"):
        assert (getattr(part, what) == getattr(whole, what)).all()
    assert np.allclose(part.ambient, whole.ambient, atol=1e-4)
    lights = [renderer.irradiance(renderer.look(0.0), "left") for renderer in renderers]
    assert lights[0].max() > 30.0
    assert np.allclose(lights[0], lights[1], atol=1e-3)
    pictures = [renderer.expose(renderer.look(0.0), ("left",), 3) for renderer in renderers]
    assert np.abs(pictures[0].astype(int) - pictures[1]).max() <= 1


def test_noise_of_one_pixel_says_nothing_of_another(small: SimulatedRig) -> None:
    renderer = Renderer(on_the_table(small, sphere()))
    view, noise = renderer.look(0.0), Noise(0.0, electrons_per_grey=1.0, read_grey=8.0)
    spread = np.sqrt(view.ambient + 8.0**2)
    one, two = (
        (renderer.expose(view, (), seed, noise).astype(np.float64) - view.ambient) / spread for seed in (1, 2)
    )
    one, two = (np.where(view.ambient > 15.0, part - part.mean(), 0.0) for part in (one, two))
    others = (
        one[:, 1:] * one[:, :-1], one[1:] * one[:-1], one[:, :, 1:] * one[:, :, :-1], one * two
    )  # fmt: skip

    for product in others:
        assert abs(float(product.mean())) < 0.015


def test_several_threads_make_the_same_pictures_as_one(small: SimulatedRig) -> None:
    renderer = Renderer(on_the_table(small, make_object("mug"), noise=Noise(), lens_blur_px=0.8))

    def picture(number: int) -> bytes:
        view = renderer.look(0.4 * (number % 5))
        return renderer.expose(view, ("left", "right")[: number % 3], number).tobytes()

    with ThreadPoolExecutor(4) as threads:
        together = list(threads.map(picture, range(30)))

    assert together == [picture(number) for number in range(30)]


def test_the_table_turns_counter_clockwise_seen_from_above(scanner: SimulatedRig) -> None:
    platter = PlatterSpec("DICT_4X4_50", 12.0, tuple(range(8)))
    renderer = Renderer(on_the_table(scanner, platter=platter))
    places = []
    for angle_rad in (0.0, 0.1):
        seen = detect_markers(renderer.expose(renderer.look(angle_rad), (), 0), platter)
        rays = scanner.rig.camera.rays(seen.corners.mean(axis=1))
        up, origin = scanner.rig.axis.direction, scanner.rig.axis.origin
        on_table = scanner.table_from_camera @ (rays * (origin @ up / (rays @ up))[:, None])
        places.append(dict(zip(seen.ids.tolist(), np.arctan2(on_table[:, 1], on_table[:, 0]), strict=True)))
    both = sorted(places[0].keys() & places[1].keys())
    turned = np.array([places[1][number] - places[0][number] for number in both])

    assert len(both) >= 6
    assert np.allclose((turned + np.pi) % (2.0 * np.pi) - np.pi, 0.1, atol=0.003)


def test_a_grey_camera_has_one_channel(small: SimulatedRig) -> None:
    image = render_shot(on_the_table(small, sphere(), is_grey=True), ("left",), 0.0, np.random.default_rng(0))

    assert image.shape == (180, 320)


def test_a_sheet_out_of_focus_gives_a_wider_dimmer_stripe(small: SimulatedRig) -> None:
    source = small.sources["left"]
    blurred = replace(source, focus_mm=source.focus_mm - 60.0, focus_depth_mm=40.0)
    far = SimulatedRig(small.rig, {**small.sources, "left": blurred}, small.table_radius_mm)
    sharp, soft = (irradiance_of(on_the_table(rig, sphere()), "left") for rig in (small, far))

    assert soft.max() < sharp.max()
    assert np.count_nonzero(soft) > np.count_nonzero(sharp)


def irradiance_of(scene: Scene, laser: str) -> Floats:
    renderer = Renderer(scene)
    light: Floats = renderer.irradiance(renderer.look(0.0), laser).astype(np.float64)
    return light


def test_an_unknown_laser_is_named(small: SimulatedRig) -> None:
    renderer = Renderer(on_the_table(small, sphere()))
    view: View = renderer.look(0.0)

    with pytest.raises(OptionError, match="middle"):
        renderer.expose(view, ("middle",), 0)

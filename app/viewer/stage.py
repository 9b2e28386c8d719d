"""What stands around the cloud: table, grid, axis, camera, laser sheets, boards."""

import math
from collections.abc import Collection, Mapping, Sequence

import cv2
import numpy as np
from viser import (
    CameraFrustumHandle,
    FrameHandle,
    LineSegmentsHandle,
    MeshHandle,
    SceneNodeHandle,
    ViserServer,
)

from app.geometry.rig import Rig
from app.geometry.transform import RigidTransform
from app.viewer.colouring import LASER_COLOURS
from app.viewer.rotations import quaternion, rotation_of, turned
from app.viewer.shapes import board_picture, circle, degree_numbers, degree_ticks, fan, sheet
from app.vision.board import BoardSpec
from app.vision.stripe import Image

TABLE = "/table"
PICTURE_SIZE = (320, 180)
_LIT, _UNLIT = 0.34, 0.05
FRUSTUM_MM = 45.0
"""How far before the camera its picture hangs."""
_THICK_MM = 6.0


class Stage:
    """The scene without its cloud, in the table frame at angle 0; used by one thread."""

    def __init__(self, server: ViserServer, table_radius_mm: float, height_mm: float) -> None:
        self._server = server
        self.table_radius_mm, self.height_mm = table_radius_mm, height_mm
        self.world_from_camera: RigidTransform | None = None
        self._sheets: dict[str, tuple[MeshHandle, LineSegmentsHandle]] = {}
        self._frustum: CameraFrustumHandle | None = None
        self._boards: list[SceneNodeHandle] = []
        self._rig: Rig | None = None
        self._is_dark = True
        scene = server.scene
        scene.world_axes.visible = False
        scene.configure_environment_map("studio", environment_intensity=0.3)
        self._table: FrameHandle = scene.add_frame(TABLE, show_axes=False)
        self.set_dark(True)

    def set_dark(self, is_dark: bool) -> None:
        """Colours for a dark or a light page."""
        self._is_dark = is_dark
        self._server.gui.configure_theme(dark_mode=is_dark, show_logo=False, show_share_button=False)
        self._draw_ground()

    def set_table(self, radius_mm: float, height_mm: float) -> None:
        """The size of the table, and of what may stand on it."""
        self.table_radius_mm, self.height_mm = radius_mm, height_mm
        self._draw_ground()
        if self._rig is not None:
            self.show_rig(self._rig, ())

    def turn(self, angle_rad: float) -> None:
        self._table.wxyz = turned(angle_rad)

    @property
    def table_from_world(self) -> RigidTransform:
        """From where things stand to where they are on the table as it is turned."""
        return RigidTransform(rotation_of(self._table.wxyz), np.zeros(3)).inverse()

    def show_rig(self, rig: Rig, lit: Collection[str]) -> None:
        """Draw the camera and the laser sheets of a calibration instead of those there were."""
        for mesh, rim in self._sheets.values():
            mesh.remove()
            rim.remove()
        self._sheets.clear()
        self._rig = rig
        self.world_from_camera = rig.axis.camera_from_table.inverse()
        self._draw_camera(rig, self.world_from_camera)
        for number, (name, plane) in enumerate(rig.lasers.items()):
            outline = sheet(plane, self.world_from_camera, self.table_radius_mm, self.height_mm)
            if not len(outline):
                continue
            red, green, blue = (int(part) for part in LASER_COLOURS[number % len(LASER_COLOURS)])
            colour = (red, green, blue)
            mesh = self._server.scene.add_mesh_simple(
                f"/lasers/{number}", outline.astype(np.float32), fan(len(outline)), color=colour,
                opacity=_UNLIT, side="double", cast_shadow=False, receive_shadow=False,
            )  # fmt: skip
            rim = self._server.scene.add_line_segments(
                f"/lasers/{number}-rim", np.stack([outline, np.roll(outline, -1, axis=0)], axis=1), colour,
                thickness=1.0, thickness_units="screen",
            )  # fmt: skip
            self._sheets[name] = (mesh, rim)
        self.light(lit)

    def light(self, lit: Collection[str]) -> None:
        """Show which lasers are on."""
        for name, (mesh, rim) in self._sheets.items():
            is_lit = name in lit
            mesh.opacity = _LIT if is_lit else _UNLIT
            rim.thickness = 2.0 if is_lit else 1.0

    def show_picture(self, image: Image) -> None:
        """Hang a small copy of a camera picture into the camera's frustum."""
        if self._frustum is None:
            return
        if image.ndim == 2:
            image = np.asarray(cv2.cvtColor(image, cv2.COLOR_GRAY2BGR), np.uint8)
        height, width = image.shape[:2]
        scale = min(PICTURE_SIZE[0] / width, PICTURE_SIZE[1] / height, 1.0)
        size = (max(1, round(width * scale)), max(1, round(height * scale)))
        small = cv2.resize(image, size, interpolation=cv2.INTER_AREA)
        self._frustum.image = np.asarray(cv2.cvtColor(small, cv2.COLOR_BGR2RGB), np.uint8)

    def show_boards(self, spec: BoardSpec, poses: Sequence[RigidTransform], *, on_table: bool) -> None:
        """Draw a board where it was captured, instead of those there were.

        Args:
            spec: the board.
            poses: camera_from_board of each view, or table_from_board.
            on_table: whether they are the latter, and turn with the table.
        """
        self.take_boards_away()
        outline = spec.outline()
        middle, size = outline.mean(axis=0), outline[2] - outline[0]
        picture = board_picture(spec)
        parent = f"{TABLE}/boards" if on_table else "/boards"
        still = RigidTransform.identity() if on_table else self.world_from_camera
        if still is None:
            return
        for number, pose in enumerate(poses):
            placed = still @ pose
            node = self._server.scene.add_image(
                f"{parent}/{number:02d}", picture, float(size[0]), float(size[1]), format="png",
                wxyz=quaternion(placed.rotation), position=(placed @ middle[None])[0], cast_shadow=False,
                receive_shadow=False,
            )  # fmt: skip
            self._boards.append(node)

    def take_boards_away(self) -> None:
        """Leave the place to what is scanned."""
        for board in self._boards:
            board.remove()
        self._boards.clear()

    def _draw_camera(self, rig: Rig, world_from_camera: RigidTransform) -> None:
        width, height = rig.camera.size
        fov = 2.0 * math.atan(height / (2.0 * float(rig.camera.matrix[1, 1])))
        aspect = width / height
        # viser's scale is the edge of a cube as large as the frustum, not the distance of its picture.
        scale = FRUSTUM_MM * float(np.cbrt(math.tan(fov / 2.0) ** 2 * aspect / 3.0))
        self._frustum = self._server.scene.add_camera_frustum(
            "/camera", fov, aspect, scale=scale, thickness=1.5, thickness_units="screen",
            color=_COLOURS[self._is_dark]["line"], wxyz=quaternion(world_from_camera.rotation),
            position=world_from_camera.translation, cast_shadow=False, receive_shadow=False,
        )  # fmt: skip

    def _draw_ground(self) -> None:
        colours, radius = _COLOURS[self._is_dark], self.table_radius_mm
        scene = self._server.scene
        # viser's own fading is made for metres.
        scene.add_grid(
            "/grid", 2000.0, 2000.0, cell_size=10.0, section_size=100.0, fade_distance=1500.0,
            fade_strength=1.6, cell_color=colours["cell"], section_color=colours["section"],
            position=(0.0, 0.0, -_THICK_MM - 0.5), shadow_opacity=0.0,
        )  # fmt: skip
        scene.add_cylinder(
            f"{TABLE}/disc", radius, _THICK_MM, colours["disc"], radial_segments=96,
            position=(0.0, 0.0, -_THICK_MM / 2.0),
        )  # fmt: skip
        for name, lines, thickness in (
            ("ticks", degree_ticks(radius), 1.2),
            ("degrees", degree_numbers(radius), 1.2),
            ("rim", circle(radius), 1.5),
        ):
            scene.add_line_segments(
                f"{TABLE}/{name}", lines, colours["line"], thickness=thickness, thickness_units="screen"
            )
        scene.add_line_segments(
            "/axis", np.array([[[0.0, 0.0, 0.0], [0.0, 0.0, self.height_mm]]], np.float32), colours["axis"],
            thickness=1.2, thickness_units="screen",
        )  # fmt: skip


_COLOURS: Mapping[bool, Mapping[str, tuple[int, int, int]]] = {
    True: {
        "disc": (24, 26, 31), "line": (150, 160, 178), "cell": (58, 63, 72), "section": (92, 100, 116),
        "axis": (120, 170, 255),
    },
    False: {
        "disc": (222, 225, 230), "line": (70, 78, 92), "cell": (214, 218, 224), "section": (176, 183, 194),
        "axis": (30, 90, 200),
    },
}  # fmt: skip

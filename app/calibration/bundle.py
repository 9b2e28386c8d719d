"""One least-squares problem over everything that was seen: camera, boards, markers, axis, laser planes.

Every flat thing that is seen (a calibration board in one placement, the sheet of markers on the table) is
a body with a pose in the camera frame at table angle zero. A view of a body is either free (angle index
-1) or turned about the axis: X = Rot(axis, angle) (R X_b + t - p) + p.

Residuals are in units of their standard deviation: reprojected corners, and for each stripe point its
distance to the laser plane expressed in pixels across the stripe.
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from app.calibration.projection import project, rays_with_derivatives
from app.geometry.arrays import Floats, Vector3
from app.geometry.transform import rotation_about, rotation_from_rvec

Indices = NDArray[np.intp]


@dataclass(frozen=True, eq=False, slots=True)
class State:
    """The unknowns.

    Attributes:
        camera: (9,) as in `projection`.
        size: width and height of the picture, px.
        axis_point: (3,) mm.
        axis_direction: (3,) unit vector.
        planes: (L, 4) unit normal and distance of each laser plane.
        rotations: (B, 3, 3) of each body.
        translations: (B, 3) of each body, mm.
        angles: (A,) rad, of each stop of the table.
        layout: (M, 3) x mm, y mm, rotation rad of each marker on its sheet.
        marker_mm: side of a marker.
    """

    camera: Floats
    size: tuple[int, int]
    axis_point: Vector3
    axis_direction: Vector3
    planes: Floats
    rotations: Floats
    translations: Floats
    angles: Floats
    layout: Floats
    marker_mm: float


@dataclass(frozen=True, eq=False, slots=True)
class Corners:
    """Seen corners.

    Attributes:
        pixels: (N, 2).
        body: (N,) which body each belongs to.
        angle: (N,) index of the table angle, -1 for a free view.
        on_body: (N, 3) mm for a board; for a marker the corner in units of its side, from its centre.
        marker: (N,) index into the layout, -1 for a board.
        sigma: (N,) px.
        group: (N,) index of the group whose noise is estimated together.
    """

    pixels: Floats
    body: Indices
    angle: Indices
    on_body: Floats
    marker: Indices
    sigma: Floats
    group: Indices


@dataclass(frozen=True, eq=False, slots=True)
class Stripes:
    """Stripe points on flat bodies.

    Attributes:
        pixels: (N, 2).
        body: (N,) which body the light falls on.
        angle: (N,) index of the table angle, -1 for a free view.
        laser: (N,) which plane.
        across: (N,) 0 where the stripe was located along u, 1 along v.
        sigma: (N,) px across the stripe.
        group: (N,) index of the group whose noise is estimated together.
    """

    pixels: Floats
    body: Indices
    angle: Indices
    laser: Indices
    across: Indices
    sigma: Floats
    group: Indices


@dataclass(frozen=True, slots=True)
class Columns:
    """Where each unknown's local increments stand in the parameter vector."""

    planes: int
    bodies: int
    angles: int
    layout: int
    side: int
    total: int

    AXIS_POINT = 9
    AXIS_DIRECTION = 11

    @classmethod
    def of(cls, state: State) -> "Columns":
        planes = 13
        bodies = planes + 3 * len(state.planes)
        angles = bodies + 6 * len(state.rotations)
        layout = angles + len(state.angles)
        side = layout + 3 * len(state.layout)
        return cls(planes, bodies, angles, layout, side, side + 1)


def basis_across(direction: Vector3) -> Floats:
    """(3, 2) two unit vectors that span the plane across a unit vector."""
    _, _, rows = np.linalg.svd(direction[None, :])
    across: Floats = rows[1:].T
    return across


def moved(state: State, delta: Floats) -> State:
    """The state after local increments (P,)."""
    at = Columns.of(state)
    direction = state.axis_direction + basis_across(state.axis_direction) @ delta[11:13]
    planes = state.planes.copy()
    for laser, plane in enumerate(planes):
        d = delta[at.planes + 3 * laser : at.planes + 3 * laser + 3]
        normal = plane[:3] + basis_across(plane[:3]) @ d[:2]
        plane[:3] = normal / np.linalg.norm(normal)
        plane[3] += d[2]
    poses = delta[at.bodies : at.angles].reshape(-1, 6)
    turns = [rotation_from_rvec(rvec) for rvec in poses[:, :3]]
    rotations = np.array(turns).reshape(-1, 3, 3) @ state.rotations
    return replace(
        state,
        camera=state.camera + delta[:9],
        axis_point=state.axis_point + basis_across(state.axis_direction) @ delta[9:11],
        axis_direction=direction / np.linalg.norm(direction),
        planes=planes,
        rotations=rotations,
        translations=state.translations + poses[:, 3:],
        angles=state.angles + delta[at.angles : at.layout],
        layout=state.layout + delta[at.layout : at.side].reshape(-1, 3),
        marker_mm=state.marker_mm + float(delta[at.side]),
    )


def residuals(state: State, corners: Corners, stripes: Stripes) -> tuple[Floats, sparse.csr_array]:
    """Normalised residuals (2 N_corners + N_stripes,) and their Jacobian by the local increments."""
    first, first_blocks = _corner_residuals(state, corners)
    second, second_blocks = _stripe_residuals(state, stripes)
    total = Columns.of(state).total
    upper = _assemble(first_blocks, len(first), total)
    lower = _assemble(second_blocks, len(second), total)
    jacobian = sparse.csr_array(sparse.vstack([upper, lower], format="csr"))
    return np.concatenate([first, second]), jacobian


_Block = tuple[Indices, Floats]
"""Column of the first entry for each observation (-1: none), and (N, rows, width) derivatives."""


def _assemble(blocks: list[_Block], n_rows: int, n_columns: int) -> sparse.csr_array:
    rows, columns, values = [], [], []
    for first_column, derivatives in blocks:
        used = first_column >= 0
        block = derivatives[used]
        n, height, width = block.shape
        row = (np.flatnonzero(used)[:, None, None] * height) + np.arange(height)[None, :, None]
        column = first_column[used][:, None, None] + np.arange(width)[None, None, :]
        rows.append(np.broadcast_to(row, (n, height, width)).ravel())
        columns.append(np.broadcast_to(column, (n, height, width)).ravel())
        values.append(block.ravel())
    matrix = sparse.coo_array(
        (np.concatenate(values), (np.concatenate(rows), np.concatenate(columns))), shape=(n_rows, n_columns)
    )
    return sparse.csr_array(matrix)


def _skew(vectors: Floats) -> Floats:
    """(N, 3, 3) cross-product matrices of (N, 3)."""
    out = np.zeros((len(vectors), 3, 3))
    x, y, z = vectors.T
    out[:, 0, 1], out[:, 0, 2], out[:, 1, 2] = -z, y, -x
    out[:, 1, 0], out[:, 2, 0], out[:, 2, 1] = z, -y, x
    return out


def _turns(state: State, angle: Indices) -> Floats:
    """(N, 3, 3) rotation about the axis for each observation; the identity for free views."""
    table = np.array([rotation_about(state.axis_direction, a) for a in state.angles] + [np.eye(3)])
    turns: Floats = table.reshape(-1, 3, 3)[angle]
    return turns


def _axis_derivatives(state: State, turn: Floats, before: Floats, after: Floats) -> tuple[Floats, Floats]:
    """How a turned point moves with the axis: (N, 3, 2) by its point, (N, 3, 2) by its direction.

    Args:
        before: (N, 3) from the axis point to the point at angle zero.
        after: (N, 3) the same after the turn.
    """
    across = basis_across(state.axis_direction)
    by_point = (np.eye(3) - turn) @ across
    tilt = _skew(state.axis_direction[None])[0] @ across
    by_direction = (turn @ _skew(before) - _skew(after)) @ tilt
    return by_point, by_direction


def _corner_residuals(state: State, seen: Corners) -> tuple[Floats, list[_Block]]:
    at = Columns.of(state)
    is_marker = seen.marker >= 0
    on_body = seen.on_body.copy()
    spin = np.zeros((len(on_body), 3))
    if is_marker.any():
        place = state.layout[seen.marker[is_marker]]
        cosine, sine = np.cos(place[:, 2]), np.sin(place[:, 2])
        cx, cy = seen.on_body[is_marker, 0], seen.on_body[is_marker, 1]
        unit_x, unit_y = cosine * cx - sine * cy, sine * cx + cosine * cy
        on_body[is_marker] = np.column_stack(
            [
                place[:, 0] + state.marker_mm * unit_x,
                place[:, 1] + state.marker_mm * unit_y,
                np.zeros_like(cx),
            ]
        )
        spin[is_marker] = np.column_stack([unit_x, unit_y, np.zeros_like(cx)])
    rotation = state.rotations[seen.body]
    lever = np.einsum("nij,nj->ni", rotation, on_body)
    still = lever + state.translations[seen.body] - state.axis_point
    turn = _turns(state, seen.angle)
    turned = np.einsum("nij,nj->ni", turn, still)
    pixels, by_point, by_camera = project(state.camera, turned + state.axis_point)
    scale = 1.0 / seen.sigma
    by_point = by_point * scale[:, None, None]
    by_turned = by_point @ turn
    axis_point, axis_direction = _axis_derivatives(state, turn, still, turned)
    is_turned = seen.angle >= 0
    everywhere = np.zeros(len(on_body), np.intp)
    blocks: list[_Block] = [
        (everywhere, by_camera * scale[:, None, None]),
        (at.bodies + 6 * seen.body, -by_turned @ _skew(lever)),
        (at.bodies + 6 * seen.body + 3, by_turned),
        (np.where(is_turned, Columns.AXIS_POINT, -1), by_point @ axis_point),
        (np.where(is_turned, Columns.AXIS_DIRECTION, -1), by_point @ axis_direction),
        (
            np.where(is_turned, at.angles + seen.angle, -1),
            by_point @ np.cross(state.axis_direction, turned)[:, :, None],
        ),
    ]
    if is_marker.any():
        by_layout = by_turned @ rotation
        about = state.marker_mm * np.column_stack([-spin[:, 1], spin[:, 0], spin[:, 2]])
        layout_column = np.where(is_marker, at.layout + 3 * seen.marker, -1)
        blocks += [
            (layout_column, by_layout[:, :, :2]),
            (np.where(is_marker, layout_column + 2, -1), by_layout @ about[:, :, None]),
            (np.where(is_marker, at.side, -1), by_layout @ spin[:, :, None]),
        ]
    return ((pixels - seen.pixels) * scale[:, None]).ravel(), blocks


def _stripe_residuals(state: State, seen: Stripes) -> tuple[Floats, list[_Block]]:
    at = Columns.of(state)
    n = len(seen.pixels)
    rays, by_pixel, by_camera = rays_with_derivatives(state.camera, state.size, seen.pixels)
    turn = _turns(state, seen.angle)
    still_point = state.translations[seen.body] - state.axis_point
    still_normal = state.rotations[seen.body][:, :, 2]
    point = np.einsum("nij,nj->ni", turn, still_point) + state.axis_point
    normal = np.einsum("nij,nj->ni", turn, still_normal)
    facing = np.einsum("ni,ni->n", normal, rays)
    depth = np.einsum("ni,ni->n", normal, point) / facing
    hit = rays * depth[:, None]
    plane = state.planes[seen.laser]
    off_plane = np.einsum("ni,ni->n", plane[:, :3], hit) - plane[:, 3]
    # Along the board a ray that leans by dr moves its hit by depth (dr - r (m.dr)/(m.r)).
    slide = depth[:, None] * (
        plane[:, :3] - normal * (np.einsum("ni,ni->n", plane[:, :3], rays) / facing)[:, None]
    )
    by_xy = slide[:, None, :2]
    per_pixel = (by_xy @ by_pixel)[np.arange(n), 0, seen.across]
    scale = 1.0 / (per_pixel * seen.sigma)
    # The hit moves along the ray when the board does: dZ = (dm.(point - hit) + m.dpoint) / (m.r).
    along = (np.einsum("ni,ni->n", plane[:, :3], rays) / facing * scale)[:, None, None]
    to_point = (point - hit)[:, None, :]
    row_normal = normal[:, None, :]
    is_turned = seen.angle >= 0
    tilt_normal = -turn @ _skew(still_normal)
    axis_point, axis_direction = _axis_derivatives(state, turn, still_point, point - state.axis_point)
    _, normal_by_direction = _axis_derivatives(state, turn, still_normal, normal)
    spin_point = np.cross(state.axis_direction, point - state.axis_point)[:, :, None]
    spin_normal = np.cross(state.axis_direction, normal)[:, :, None]
    normal_across = np.array([basis_across(p[:3]) for p in state.planes]).reshape(-1, 3, 2)[seen.laser]
    by_plane = np.concatenate(
        [hit[:, None, :] @ normal_across, np.full((n, 1, 1), -1.0)], axis=2
    ) * scale[:, None, None]  # fmt: skip
    blocks: list[_Block] = [
        (np.zeros(n, np.intp), (by_xy @ by_camera) * scale[:, None, None]),
        (at.planes + 3 * seen.laser, by_plane),
        (at.bodies + 6 * seen.body, along * (to_point @ tilt_normal)),
        (at.bodies + 6 * seen.body + 3, along * (row_normal @ turn)),
        (np.where(is_turned, Columns.AXIS_POINT, -1), along * (row_normal @ axis_point)),
        (
            np.where(is_turned, Columns.AXIS_DIRECTION, -1),
            along * (row_normal @ axis_direction + to_point @ normal_by_direction),
        ),
        (
            np.where(is_turned, at.angles + seen.angle, -1),
            along * (row_normal @ spin_point + to_point @ spin_normal),
        ),
    ]
    return off_plane * scale, blocks

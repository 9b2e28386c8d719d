"""The renderer's inner loops in NumPy: what `compiled` computes, several times slower.

Arrays shared by all of them, for a picture of H rows and W columns: `rays` (H, W, 2) float32, the ray of
every pixel at z = 1 with distortion taken out; `depth` (H, W) float32 mm along z, infinite where nothing
is; `owner` (H, W) int32, number of the triangle that is seen there, -1 for none; `normal` and `albedo`
(H, W, 3) float32. Vectors and meshes are in the camera frame, mm. A box is (top, bottom, left, right).
"""

import numpy as np
from numpy.typing import NDArray

from app.geometry.arrays import Floats

F32 = NDArray[np.float32]
_NODES = (-0.5 * np.sqrt(0.6), 0.0, 0.5 * np.sqrt(0.6))
_WEIGHTS = (5.0 / 18.0, 8.0 / 18.0, 5.0 / 18.0)


def project(vertices: Floats, matrix: Floats, distortion: Floats, width: int, height: int) -> Floats:
    """Pixels (V, 2); far outside the picture without distortion, which folds back there for some lenses.

    Args:
        vertices: (V, 3).
        matrix: (3, 3) of the camera.
        distortion: (5,) k1, k2, p1, p2, k3.
        width: columns of the picture.
        height: rows.
    """
    z = np.where(vertices[:, 2] > 0.0, vertices[:, 2], np.nan)
    x, y = vertices[:, 0] / z, vertices[:, 1] / z
    k1, k2, p1, p2, k3 = distortion
    r2 = x * x + y * y
    radial = 1.0 + r2 * (k1 + r2 * (k2 + r2 * k3))
    bent = np.column_stack(
        [
            x * radial + 2.0 * p1 * x * y + p2 * (r2 + 2.0 * x * x),
            y * radial + p1 * (r2 + 2.0 * y * y) + 2.0 * p2 * x * y,
        ]
    )
    scale, middle = np.array([matrix[0, 0], matrix[1, 1]]), np.array([matrix[0, 2], matrix[1, 2]])
    straight = np.column_stack([x, y]) * scale + middle
    size = np.array([width, height], np.float64)
    is_far = (np.abs(straight - 0.5 * size) > 0.8 * size).any(axis=1)
    pixels: Floats = np.where(is_far[:, None], straight, bent * scale + middle)
    return pixels


def bounds(vertices: Floats, pixels: Floats) -> tuple[float, float, float, float, float]:
    """Least and largest row and column (top, bottom, left, right) of pixels (V, 2), and least z of (V, 3)."""
    (left, top), (right, bottom) = pixels.min(axis=0).tolist(), pixels.max(axis=0).tolist()
    return top, bottom, left, right, float(vertices[:, 2].min())


def rasterise(
    vertices: Floats,
    pixels: Floats,
    normals: Floats,
    albedo: F32,
    faces: NDArray[np.int32],
    rays: F32,
    depth: F32,
    owner: NDArray[np.int32],
    normal_out: F32,
    albedo_out: F32,
    first_face: int,
    is_closed: bool,
    bulge_per_px: float,
) -> tuple[int, int, int, int]:
    """Draw triangles, with normal and colour where they are seen; return the box of pixels that changed.

    Whether a pixel sees a triangle is decided on the pixel's own ray, in homogeneous coordinates (Olano
    and Greer 1997), so distortion is exact and no edge needs clipping.

    Args:
        vertices: (V, 3).
        pixels: (V, 2) where each vertex is seen.
        normals: (V, 3).
        albedo: (V, 3).
        faces: (F, 3).
        rays: of every pixel.
        depth: is lowered where a triangle is nearer.
        owner: becomes `first_face` + the triangle's number there.
        normal_out: becomes the unit vector out of the surface.
        albedo_out: becomes blue, green, red.
        first_face: number of the first triangle.
        is_closed: leave out triangles seen from behind.
        bulge_per_px: how far the lens bends an edge out of the straight line, pixels per squared length.
    """
    height, width = depth.shape
    box = (height, 0, width, 0)
    corners = vertices[faces]
    sides = np.stack(
        [
            np.cross(corners[:, 1], corners[:, 2]),
            np.cross(corners[:, 2], corners[:, 0]),
            np.cross(corners[:, 0], corners[:, 1]),
        ],
        axis=1,
    )
    det = np.einsum("fi,fi->f", corners[:, 0], sides[:, 0])
    low, high = pixels[faces].min(axis=1), pixels[faces].max(axis=1)
    extent = (high - low).max(axis=1, keepdims=True)
    margin = np.minimum(0.06 * extent, 0.02 + bulge_per_px * extent**2)
    start = np.maximum(np.ceil(low - margin), 0.0)
    end = np.minimum(np.floor(high + margin), [width - 1, height - 1])
    is_drawn = (corners[:, :, 2] > 1e-3).all(axis=1) & (start <= end).all(axis=1) & (det != 0.0)
    if is_closed:
        is_drawn &= det < 0.0
    for face in np.flatnonzero(is_drawn):
        (u0, v0), (u1, v1) = start[face].astype(int), end[face].astype(int) + 1
        x, y = rays[v0:v1, u0:u1, 0].astype(float), rays[v0:v1, u0:u1, 1].astype(float)
        weights = [side[0] * x + side[1] * y + side[2] for side in sides[face]]
        sign = np.sign(det[face])
        with np.errstate(divide="ignore", invalid="ignore"):
            z = (det[face] / sum(weights)).astype(np.float32)
        hit = (z < depth[v0:v1, u0:u1]) & np.logical_and.reduce([w * sign >= 0.0 for w in weights])
        if not hit.any():
            continue
        depth[v0:v1, u0:u1][hit] = z[hit]
        owner[v0:v1, u0:u1][hit] = first_face + face
        rows, columns = np.flatnonzero(hit.any(axis=1)), np.flatnonzero(hit.any(axis=0))
        box = (
            min(box[0], v0 + int(rows[0])), max(box[1], v0 + int(rows[-1]) + 1),
            min(box[2], u0 + int(columns[0])), max(box[3], u0 + int(columns[-1]) + 1),
        )  # fmt: skip
    _resolve(owner, first_face, vertices, normals, faces, albedo, rays, normal_out, albedo_out)
    return box


def _resolve(
    owner: NDArray[np.int32],
    first_face: int,
    vertices: Floats,
    normals: Floats,
    faces: NDArray[np.int32],
    albedo: F32,
    rays: F32,
    normal_out: F32,
    albedo_out: F32,
) -> None:
    """Normal and colour where a body is seen."""
    v, u = _mine(None, owner, first_face, len(faces))
    corner = faces[owner[v, u] - first_face]
    ray = np.column_stack([rays[v, u], np.ones(len(v))]).astype(np.float64)
    at = vertices[corner]
    weights = np.stack(
        [np.einsum("ni,ni->n", np.cross(at[:, (n + 1) % 3], at[:, (n + 2) % 3]), ray) for n in range(3)],
        axis=1,
    )
    total = weights.sum(axis=1)
    weights /= total[:, None]
    out = np.einsum("nc,ncx->nx", weights, normals[corner])
    is_behind = (np.einsum("ni,ni->n", out, ray) > 0.0) & (total > 0.0)
    length = np.linalg.norm(out, axis=1) * np.where(is_behind, -1.0, 1.0)
    normal_out[v, u] = out / length[:, None]
    albedo_out[v, u] = np.einsum("nc,ncx->nx", weights, albedo[corner])


def curve(
    owner: NDArray[np.int32],
    first_face: int,
    quadrics: Floats,
    face_quadric: NDArray[np.int32],
    rays: F32,
    depth: F32,
    normal: F32,
) -> None:
    """Move what is seen from a body's triangles to the curved surfaces that they stand for.

    Args:
        owner: as `rasterise` left it.
        first_face: number of the first triangle.
        quadrics: (Q, 4, 4).
        face_quadric: (F,) which of them a triangle stands for, or -1.
        rays: of every pixel.
        depth: of every pixel, is moved.
        normal: as `rasterise` left it, is turned.
    """
    v, u = _mine(None, owner, first_face, len(face_quadric))
    which = face_quadric[owner[v, u] - first_face]
    for number, q in enumerate(quadrics):
        mine = which == number
        row, column = v[mine], u[mine]
        ray = np.column_stack([rays[row, column], np.ones(len(row))]).astype(np.float64)
        gradient = ray @ q[:3, :3]
        a, b = np.einsum("ni,ni->n", gradient, ray), ray @ q[:3, 3]
        z = depth[row, column].astype(np.float64)
        with np.errstate(divide="ignore", invalid="ignore"):
            root = np.sqrt(b * b - a * q[3, 3])
            near, far = (-b - root) / a, (-b + root) / a
            exact = np.where(np.abs(near - z) < np.abs(far - z), near, far)
            is_near = np.abs(exact - z) < 0.01 * z
        row, column, exact, gradient = row[is_near], column[is_near], exact[is_near], gradient[is_near]
        depth[row, column] = exact
        slope = exact[:, None] * gradient + q[:3, 3]
        side = np.where(np.einsum("ni,ni->n", slope, normal[row, column]) < 0.0, -1.0, 1.0)
        normal[row, column] = slope / (side * np.linalg.norm(slope, axis=1))[:, None]


def paint(
    box: tuple[int, int, int, int],
    owner: NDArray[np.int32],
    first_face: int,
    count: int,
    rotation: Floats,
    translation: Floats,
    texture: F32,
    coarse: F32,
    coarse_block: int,
    fine: F32,
    fine_block: int,
    origin_mm: Floats,
    texel_mm: float,
    samples: int,
    rays: F32,
    albedo_out: F32,
) -> None:
    """Albedo of a printed plane, averaged over each pixel's area.

    Args:
        box: where to look.
        owner: as `rasterise` left it.
        first_face: number of the plane's first triangle.
        count: of its triangles.
        rotation: (3, 3) body from camera.
        translation: (3,) of the same motion; the print lies on the body's z = 0.
        texture: (h, w) albedo.
        coarse: albedo of blocks of texels with nothing else in or beside them, NaN of the others; where there
            is one, `compiled` does not sample.
        coarse_block: side of such a block, texels.
        fine: the same for smaller blocks.
        fine_block: side of such a block, texels.
        origin_mm: (2,) the body's x and y at the texture's upper left edge.
        texel_mm: side of a texel.
        samples: as many squared are taken per pixel.
        rays: of every pixel.
        albedo_out: grey, in all three channels.
    """
    v, u = _mine(box, owner, first_face, count)
    ray, across, down = _rays_about(rays, u, v)
    total = np.zeros(len(v))
    for sv in range(samples):
        for su in range(samples):
            du, dv = (su + 0.5) / samples - 0.5, (sv + 0.5) / samples - 0.5
            x, y = (ray + du * across + dv * down).T
            bx, by, bz = (r[0] * x + r[1] * y + r[2] for r in rotation)
            z = -translation[2] / bz
            column = (bx * z + translation[0] - origin_mm[0]) / texel_mm - 0.5
            row = (by * z + translation[1] - origin_mm[1]) / texel_mm - 0.5
            column = np.clip(column, 0.0, texture.shape[1] - 1.001)
            row = np.clip(row, 0.0, texture.shape[0] - 1.001)
            c0, r0 = column.astype(np.intp), row.astype(np.intp)
            fc, fr = column - c0, row - r0
            upper = texture[r0, c0] + fc * (texture[r0, c0 + 1] - texture[r0, c0])
            lower = texture[r0 + 1, c0] + fc * (texture[r0 + 1, c0 + 1] - texture[r0 + 1, c0])
            total += upper + fr * (lower - upper)
    albedo_out[v, u] = (total / samples**2)[:, None]


def shade(
    owner: NDArray[np.int32],
    normal: F32,
    albedo: F32,
    towards_lamp: Floats,
    lamp_grey: float,
    ambient_grey: float,
    seen: F32,
) -> None:
    """What the room's light makes of matte surfaces.

    Args:
        owner: as `rasterise` left it.
        normal: of every pixel.
        albedo: of every pixel.
        towards_lamp: (3,) unit vector.
        lamp_grey: grey levels of a white surface that faces the lamp.
        ambient_grey: grey levels of a white surface from all around.
        seen: (H, W, 3) grey levels, written where there is a surface.
    """
    is_seen = owner >= 0
    facing = normal[is_seen] @ towards_lamp.astype(np.float32)
    amount = np.float32(ambient_grey) + np.float32(lamp_grey) * np.maximum(facing, 0.0)
    seen[is_seen] = albedo[is_seen] * amount[:, None]


def cut(
    vertices: Floats,
    faces: NDArray[np.int32],
    normal: Floats,
    distance_mm: float,
    source: Floats,
    forward: Floats,
    sideways: Floats,
    offsets_mm: Floats,
    half_fan: float,
    cosine: Floats,
    sine: Floats,
    reach: F32,
) -> None:
    """How far the light gets in every direction of the fan before it meets one of these triangles.

    The sheet has a thickness, so this is asked for several planes beside each other.

    Args:
        vertices: (V, 3).
        faces: (F, 3).
        normal: (3,) of the sheet.
        distance_mm: of the sheet from the camera centre.
        source: (3,) where the fan starts.
        forward: (3,) the fan's middle, unit vector.
        sideways: (3,) in the sheet, across `forward`.
        offsets_mm: (S,) the planes, along the normal, ascending.
        half_fan: opening to either side, rad.
        cosine: (B,) of the fan's directions, evenly spaced over the opening.
        sine: (B,) the same.
        reach: (S, B) mm, is lowered.
    """
    bins = reach.shape[1]
    per_rad = (bins - 1) / (2.0 * half_fan)
    ahead = (vertices @ normal - distance_mm)[faces]
    low, high = ahead.min(axis=1), ahead.max(axis=1)
    for s, offset in enumerate(offsets_mm):
        crossing = np.flatnonzero((low < offset) & (offset <= high))
        q = ahead[crossing] - offset
        corners = vertices[faces[crossing]] - source
        planar = np.stack([corners @ forward, corners @ sideways], axis=-1)
        is_cut = (q < 0.0) != (np.roll(q, -1, axis=1) < 0.0)
        with np.errstate(divide="ignore", invalid="ignore"):
            share = q / (q - np.roll(q, -1, axis=1))
            meeting = planar + share[..., None] * (np.roll(planar, -1, axis=1) - planar)
        ends = meeting[is_cut].reshape(-1, 2, 2)
        ends = ends[(ends[:, :, 0] > 0.0).all(axis=1)]
        place = np.sort((np.arctan2(ends[:, :, 1], ends[:, :, 0]) + half_fan) * per_rad, axis=1)
        start = np.maximum(np.ceil(place[:, 0]), 0).astype(int)
        end = np.minimum(np.floor(place[:, 1]), bins - 1).astype(int) + 1
        (px, py), (rx, ry) = ends[:, 0].T, ends[:, 1].T
        for n in np.flatnonzero(start < end):
            part = slice(start[n], end[n])
            with np.errstate(divide="ignore", invalid="ignore"):
                distance = (px[n] * ry[n] - py[n] * rx[n]) / (
                    cosine[part] * (ry[n] - py[n]) - sine[part] * (rx[n] - px[n])
                )
            distance = np.where(distance > 0.0, distance, np.inf)
            reach[s, part] = np.minimum(reach[s, part], distance)


def near(
    rays: F32, depth: F32, plane: Floats, distance_mm: float, widest_mm: float
) -> tuple[NDArray[np.int32], NDArray[np.int32]]:
    """Rows and columns (N,) of the pixels that see something near a sheet.

    Args:
        rays: of every pixel.
        depth: of every pixel.
        plane: (3,) normal of the sheet.
        distance_mm: of the sheet from the camera centre.
        widest_mm: what counts as near.
    """
    n = plane.astype(np.float32)
    with np.errstate(invalid="ignore"):
        ahead = (n[0] * rays[:, :, 0] + n[1] * rays[:, :, 1] + n[2]) * depth - np.float32(distance_mm)
    rows, columns = np.nonzero(np.abs(ahead) <= np.float32(widest_mm))
    return rows.astype(np.int32), columns.astype(np.int32)


def light(
    rays: F32,
    depth: F32,
    normal: F32,
    albedo: F32,
    rows: NDArray[np.int32],
    columns: NDArray[np.int32],
    colour: F32,
    plane: Floats,
    distance_mm: float,
    source: Floats,
    forward: Floats,
    sideways: Floats,
    offsets_mm: Floats,
    half_fan: float,
    reach: F32,
    sigma_mm: float,
    focus_mm: float,
    focus_depth_mm: float,
    peak_grey: float,
    grey: F32,
) -> None:
    """Grey levels that a laser adds, without speckle.

    A Gaussian of the distance from the sheet, gathered over each pixel's area on the surface's tangent
    plane, times Lambert's cosine and the fan's 1/r, where the light arrives at all.

    Args:
        rays: of every pixel.
        depth: of every pixel.
        normal: of every pixel.
        albedo: of every pixel.
        rows: (N,) of the pixels near the sheet, from `near`.
        columns: (N,) the same.
        colour: (3,) what of each channel's albedo counts.
        plane: (3,) normal of the sheet.
        distance_mm: of the sheet from the camera centre.
        source: as for `cut`, with `forward`, `sideways`, `offsets_mm`, `half_fan` and `reach`.
        forward: see there.
        sideways: see there.
        offsets_mm: see there; evenly spaced.
        half_fan: see there.
        reach: see there.
        sigma_mm: of the sheet at its focus.
        focus_mm: distance of the focus from the source.
        focus_depth_mm: distance from the focus at which the sheet is sqrt(2) times as thick.
        peak_grey: on a white surface that faces the laser at the focus.
        grey: (N,), written where light arrives.
    """
    per_rad = (reach.shape[1] - 1) / (2.0 * half_fan)
    v, u = rows.astype(np.intp), columns.astype(np.intp)
    ray, across, down = _rays_about(rays, u, v)
    ray = np.column_stack([ray, np.ones(len(v))])
    z = depth[v, u].astype(np.float64)
    m = normal[v, u].astype(np.float64)
    slope = ray @ plane
    q = slope * z - distance_mm
    away = ray * z[:, None] - source
    distance = np.linalg.norm(away, axis=1)
    sigma = sigma_mm * np.sqrt(1.0 + ((distance - focus_mm) / focus_depth_mm) ** 2)
    facing = -np.einsum("ni,ni->n", away, m) / distance
    spacing = offsets_mm[1] - offsets_mm[0]
    s = np.clip(np.rint((q - offsets_mm[0]) / spacing), 0, len(offsets_mm) - 1).astype(np.intp)
    along = m @ plane
    walk = (offsets_mm[s] - q) / np.maximum(1.0 - along**2, 0.02)
    walked = away + walk[:, None] * (plane - along[:, None] * m)
    ahead, aside = walked @ forward, walked @ sideways
    fan = np.arctan2(aside, ahead)
    place = np.clip(np.rint((fan + half_fan) * per_rad), 0, reach.shape[1] - 1).astype(np.intp)
    farthest = reach[s, place] + 0.3 + 0.1 / np.maximum(facing, 0.05)
    is_lit = (np.abs(q) <= 4.5 * sigma) & (facing > 0.0) & (np.abs(fan) <= half_fan)
    is_lit &= np.hypot(ahead, aside) <= farthest
    towards = np.minimum(np.einsum("ni,ni->n", m, ray), -0.03)
    qu, qv = (
        z * (step @ plane[:2] - slope * np.einsum("ni,ni->n", m[:, :2], step) / towards)
        for step in (across, down)
    )
    total = np.zeros(len(v))
    for a, weight_a in zip(_NODES, _WEIGHTS, strict=True):
        for b, weight_b in zip(_NODES, _WEIGHTS, strict=True):
            total += weight_a * weight_b * np.exp(-0.5 * ((q + a * qu + b * qv) / sigma) ** 2)
    tint = albedo[v, u] @ colour
    bright = peak_grey * tint * total * facing * (focus_mm / distance) * (sigma_mm / sigma)
    grey[is_lit] = bright[is_lit]


def speckle(
    laser: F32,
    tint: F32,
    levels: F32,
    seed: np.uint64,
    first: int,
    stride: int,
    gathered: F32,
) -> None:
    """Add a laser's light to what the pixels of a part of the picture gather, each with a grain of speckle.

    Every pixel's grain is a hash of the seed and its number (Steele et al. 2014, SplitMix64), so pictures do
    not depend on the order in which they are made.

    Args:
        laser: (h, w) grey levels that it adds.
        tint: (C,) how strongly each channel sees it.
        levels: (65536,) quantiles of the speckle.
        seed: of this picture.
        first: number of the part's first pixel.
        stride: from there to the first of its next row.
        gathered: (h, w, C) grey levels.
    """
    v, u = np.nonzero(laser > 0.0)
    grain = levels[_random(seed, (first + v * stride + u).astype(np.uint64)) & np.uint64(0xFFFF)]
    gathered[v, u] += (laser[v, u] * grain)[:, None] * tint


def expose(
    ambient: F32,
    amounts: F32,
    gathered: F32,
    top: int,
    left: int,
    electrons_per_grey: float,
    read_variance: float,
    normals: F32,
    seed: np.uint64,
    image: NDArray[np.uint8],
) -> None:
    """Light to grey values: shot and read noise, rounding, clipping.

    Every row takes its noise from another place of one long list of random numbers, which a hash of the seed
    and the row chooses.

    Args:
        ambient: (H, W * C) grey levels without laser.
        amounts: (W * C,) how much of them is gathered.
        gathered: (h, w * C) what is gathered in a part of the picture, instead of that.
        top: its first row.
        left: its first column times C.
        electrons_per_grey: of the shot noise.
        read_variance: grey levels squared.
        normals: many numbers of the normal distribution.
        seed: of this picture.
        image: (H, W * C) is written.
    """
    height, length = ambient.shape
    most = np.uint64(len(normals) - length + 1)
    start = (_random(seed, np.arange(height, dtype=np.uint64)) % most).astype(np.intp)
    light_in = ambient * amounts
    light_in[top : top + gathered.shape[0], left : left + gathered.shape[1]] = gathered
    for v in range(height):
        row, noise = light_in[v], normals[start[v] : start[v] + length]
        spread = np.sqrt(row * np.float32(1.0 / electrons_per_grey) + np.float32(read_variance))
        image[v] = np.clip(row + spread * noise + np.float32(0.5), 0.0, 255.0).astype(np.uint8)


def _random(seed: np.uint64, number: NDArray[np.uint64]) -> NDArray[np.uint64]:
    bits = seed + number * np.uint64(0x9E3779B97F4A7C15)
    bits = (bits ^ (bits >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    bits = (bits ^ (bits >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    mixed: NDArray[np.uint64] = bits ^ (bits >> np.uint64(31))
    return mixed


def _mine(
    box: tuple[int, int, int, int] | None, owner: NDArray[np.int32], first_face: int, count: int
) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Rows and columns of the pixels that see some of the triangles; in a box, or everywhere."""
    top, bottom, left, right = box or (0, owner.shape[0], 0, owner.shape[1])
    part = owner[top:bottom, left:right]
    v, u = np.nonzero((part >= first_face) & (part < first_face + count))
    return v + top, u + left


def _rays_about(rays: F32, u: NDArray[np.intp], v: NDArray[np.intp]) -> tuple[Floats, Floats, Floats]:
    """Rays (N, 2) of pixels, and what they change by from column to column and from row to row."""
    height, width = rays.shape[:2]
    u_next, u_last = np.minimum(u + 1, width - 1), np.maximum(u - 1, 0)
    v_next, v_last = np.minimum(v + 1, height - 1), np.maximum(v - 1, 0)
    rays64 = rays.astype(np.float64)
    across = (rays64[v, u_next] - rays64[v, u_last]) / (u_next - u_last)[:, None]
    down = (rays64[v_next, u] - rays64[v_last, u]) / (v_next - v_last)[:, None]
    return rays64[v, u], across, down

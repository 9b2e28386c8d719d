"""The renderer's inner loops, compiled. `plain` holds the same functions in NumPy and says what they do."""

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

from app.geometry.arrays import Floats

F32 = NDArray[np.float32]
_GOLDEN = np.uint64(0x9E3779B97F4A7C15)
_MIX_1 = np.uint64(0xBF58476D1CE4E5B9)
_MIX_2 = np.uint64(0x94D049BB133111EB)
_LOW_16 = np.uint64(0xFFFF)


@njit(nogil=True, cache=True, inline="always")
def _side(vertices: Floats, j: int, k: int) -> tuple[float, float, float]:
    """Normal of the plane through the camera and two corners, as long as they span."""
    return (
        vertices[j, 1] * vertices[k, 2] - vertices[j, 2] * vertices[k, 1],
        vertices[j, 2] * vertices[k, 0] - vertices[j, 0] * vertices[k, 2],
        vertices[j, 0] * vertices[k, 1] - vertices[j, 1] * vertices[k, 0],
    )


@njit(nogil=True, cache=True, error_model="numpy", inline="always")
def _steps(rays: F32, v: int, u: int) -> tuple[float, float, float, float]:
    """What a ray's x and y change by from column to column, and from row to row."""
    u_next, u_last = min(u + 1, rays.shape[1] - 1), max(u - 1, 0)
    v_next, v_last = min(v + 1, rays.shape[0] - 1), max(v - 1, 0)
    per_u, per_v = 1.0 / (u_next - u_last), 1.0 / (v_next - v_last)
    return (
        per_u * (rays[v, u_next, 0] - rays[v, u_last, 0]),
        per_u * (rays[v, u_next, 1] - rays[v, u_last, 1]),
        per_v * (rays[v_next, u, 0] - rays[v_last, u, 0]),
        per_v * (rays[v_next, u, 1] - rays[v_last, u, 1]),
    )


@njit(nogil=True, cache=True, error_model="numpy")
def project(vertices: Floats, matrix: Floats, distortion: Floats, width: int, height: int) -> Floats:
    pixels = np.empty((vertices.shape[0], 2))
    k1, k2, p1, p2, k3 = distortion[0], distortion[1], distortion[2], distortion[3], distortion[4]
    for n in range(vertices.shape[0]):
        z = vertices[n, 2]
        if not z > 0.0:
            pixels[n, 0], pixels[n, 1] = np.nan, np.nan
            continue
        x, y = vertices[n, 0] / z, vertices[n, 1] / z
        u, v = matrix[0, 0] * x + matrix[0, 2], matrix[1, 1] * y + matrix[1, 2]
        if abs(u - 0.5 * width) <= 0.8 * width and abs(v - 0.5 * height) <= 0.8 * height:
            r2 = x * x + y * y
            radial = 1.0 + r2 * (k1 + r2 * (k2 + r2 * k3))
            u = matrix[0, 0] * (x * radial + 2.0 * p1 * x * y + p2 * (r2 + 2.0 * x * x)) + matrix[0, 2]
            v = matrix[1, 1] * (y * radial + p1 * (r2 + 2.0 * y * y) + 2.0 * p2 * x * y) + matrix[1, 2]
        pixels[n, 0], pixels[n, 1] = u, v
    return pixels


@njit(nogil=True, cache=True, error_model="numpy", inline="always")
def _reach_of(
    pixels: Floats, i: int, j: int, k: int, width: int, height: int, bulge_per_px: float
) -> tuple[np.uint64, np.uint64, np.uint64, np.uint64]:
    """Rows and columns in which a triangle can be seen, the second and last not among them; none are (0, 0).

    They are unsigned, because indices that cannot be negative need not be checked for it.
    """
    u_low = min(pixels[i, 0], pixels[j, 0], pixels[k, 0])
    u_high = max(pixels[i, 0], pixels[j, 0], pixels[k, 0])
    v_low = min(pixels[i, 1], pixels[j, 1], pixels[k, 1])
    v_high = max(pixels[i, 1], pixels[j, 1], pixels[k, 1])
    # Distortion bends the edges of a large triangle out of the box about its corners.
    extent = max(u_high - u_low, v_high - v_low)
    margin = min(0.06 * extent, 0.02 + bulge_per_px * extent * extent)
    is_aside = not (u_low - margin < width and v_low - margin < height)
    if is_aside or not (u_high + margin >= 0.0 and v_high + margin >= 0.0):
        return np.uint64(0), np.uint64(0), np.uint64(0), np.uint64(0)
    return (
        np.uint64(math.ceil(max(0.0, v_low - margin))),
        np.uint64(math.floor(min(height - 1.0, v_high + margin)) + 1),
        np.uint64(math.ceil(max(0.0, u_low - margin))),
        np.uint64(math.floor(min(width - 1.0, u_high + margin)) + 1),
    )


@njit(nogil=True, cache=True, error_model="numpy")
def bounds(vertices: Floats, pixels: Floats) -> tuple[float, float, float, float, float]:
    left = top = nearest = np.inf
    right = bottom = -np.inf
    for n in range(vertices.shape[0]):
        left, right = min(left, pixels[n, 0]), max(right, pixels[n, 0])
        top, bottom = min(top, pixels[n, 1]), max(bottom, pixels[n, 1])
        nearest = min(nearest, vertices[n, 2])
    return top, bottom, left, right, nearest


@njit(nogil=True, cache=True, error_model="numpy", inline="always")
def _sum_of(a: float, b: float, c: float, values: Floats, i: int, j: int, k: int, axis: int) -> float:
    total: float = a * values[i, axis] + b * values[j, axis] + c * values[k, axis]
    return total


@njit(nogil=True, cache=True, error_model="numpy")
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
    height, width = depth.shape
    top, bottom, left, right = np.uint64(height), np.uint64(0), np.uint64(width), np.uint64(0)
    for face in range(faces.shape[0]):
        i, j, k = np.uint64(faces[face, 0]), np.uint64(faces[face, 1]), np.uint64(faces[face, 2])
        if not (vertices[i, 2] > 1e-3 and vertices[j, 2] > 1e-3 and vertices[k, 2] > 1e-3):
            continue
        ax, ay, az = _side(vertices, j, k)
        det = vertices[i, 0] * ax + vertices[i, 1] * ay + vertices[i, 2] * az
        if det == 0.0 or (is_closed and det > 0.0):
            continue
        v0, v1, u0, u1 = _reach_of(pixels, i, j, k, width, height, bulge_per_px)
        if v0 >= v1 or u0 >= u1:
            continue
        bx, by, bz = _side(vertices, k, i)
        cx, cy, cz = _side(vertices, i, j)
        is_from_behind = det > 0.0
        if not is_from_behind:
            ax, ay, az, bx, by, bz = -ax, -ay, -az, -bx, -by, -bz
            cx, cy, cz, det = -cx, -cy, -cz, -det
        # The mean of the corners' normals, as each counts for a ray, is linear in the ray but for its length.
        xx = _sum_of(ax, bx, cx, normals, i, j, k, 0)
        xy = _sum_of(ay, by, cy, normals, i, j, k, 0)
        xz = _sum_of(az, bz, cz, normals, i, j, k, 0)
        yx = _sum_of(ax, bx, cx, normals, i, j, k, 1)
        yy = _sum_of(ay, by, cy, normals, i, j, k, 1)
        yz = _sum_of(az, bz, cz, normals, i, j, k, 1)
        zx = _sum_of(ax, bx, cx, normals, i, j, k, 2)
        zy = _sum_of(ay, by, cy, normals, i, j, k, 2)
        zz = _sum_of(az, bz, cz, normals, i, j, k, 2)
        blue, green, red = albedo[i, 0], albedo[i, 1], albedo[i, 2]
        is_plain = (
            (blue == albedo[j, 0])
            & (green == albedo[j, 1])
            & (red == albedo[j, 2])
            & (blue == albedo[k, 0])
            & (green == albedo[k, 1])
            & (red == albedo[k, 2])
        )
        is_seen = False
        for v in range(v0, v1):
            for u in range(u0, u1):
                x, y = float(rays[v, u, 0]), float(rays[v, u, 1])
                wa = ax * x + ay * y + az
                wb = bx * x + by * y + bz
                wc = cx * x + cy * y + cz
                if (wa < 0.0) | (wb < 0.0) | (wc < 0.0):
                    continue
                total = wa + wb + wc
                if not det < depth[v, u] * total:
                    continue
                share = 1.0 / total
                depth[v, u] = np.float32(det * share)
                owner[v, u] = first_face + face
                is_seen = True
                nx, ny, nz = xx * x + xy * y + xz, yx * x + yy * y + yz, zx * x + zy * y + zz
                shorter = 1.0 / math.sqrt(nx * nx + ny * ny + nz * nz)
                # Seen from behind, a surface that is not closed shows its other side.
                if is_from_behind and nx * x + ny * y + nz > 0.0:
                    shorter = -shorter
                normal_out[v, u, 0] = shorter * nx
                normal_out[v, u, 1] = shorter * ny
                normal_out[v, u, 2] = shorter * nz
                if is_plain:
                    albedo_out[v, u, 0], albedo_out[v, u, 1], albedo_out[v, u, 2] = blue, green, red
                    continue
                wa, wb, wc = share * wa, share * wb, share * wc
                for c in range(3):
                    albedo_out[v, u, c] = wa * albedo[i, c] + wb * albedo[j, c] + wc * albedo[k, c]
        if is_seen:
            top, bottom = min(top, v0), max(bottom, v1)
            left, right = min(left, u0), max(right, u1)
    return int(top), int(bottom), int(left), int(right)


@njit(nogil=True, cache=True, error_model="numpy")
def curve(
    owner: NDArray[np.int32],
    first_face: int,
    quadrics: Floats,
    face_quadric: NDArray[np.int32],
    rays: F32,
    depth: F32,
    normal: F32,
) -> None:
    height, width = owner.shape
    count = face_quadric.shape[0]
    for v in range(np.uint64(height)):
        for u in range(np.uint64(width)):
            face = owner[v, u] - first_face
            if face < 0 or face >= count or face_quadric[face] < 0:
                continue
            x, y, z = float(rays[v, u, 0]), float(rays[v, u, 1]), float(depth[v, u])
            exact, nx, ny, nz = _on_quadric(quadrics[face_quadric[face]], x, y, z)
            if not abs(exact - z) < 0.01 * z:
                continue
            depth[v, u] = np.float32(exact)
            shorter = 1.0 / math.sqrt(nx * nx + ny * ny + nz * nz)
            if nx * normal[v, u, 0] + ny * normal[v, u, 1] + nz * normal[v, u, 2] < 0.0:
                shorter = -shorter
            normal[v, u, 0] = shorter * nx
            normal[v, u, 1] = shorter * ny
            normal[v, u, 2] = shorter * nz


@njit(nogil=True, cache=True, error_model="numpy", inline="always")
def _on_quadric(q: Floats, x: float, y: float, z: float) -> tuple[float, float, float, float]:
    """Depth at which a ray meets a curved surface nearest to a depth, NaN for never; and its normal there."""
    gx = q[0, 0] * x + q[0, 1] * y + q[0, 2]
    gy = q[1, 0] * x + q[1, 1] * y + q[1, 2]
    gz = q[2, 0] * x + q[2, 1] * y + q[2, 2]
    a = gx * x + gy * y + gz
    b = q[0, 3] * x + q[1, 3] * y + q[2, 3]
    root = math.sqrt(b * b - a * q[3, 3])
    near, far = (-b - root) / a, (-b + root) / a
    exact = near if abs(near - z) < abs(far - z) else far
    return exact, exact * gx + q[0, 3], exact * gy + q[1, 3], exact * gz + q[2, 3]


@njit(nogil=True, cache=True, error_model="numpy")
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
    top, bottom, left, right = box
    per_mm, per_coarse, per_fine, per_sample = (
        1.0 / texel_mm,
        1.0 / coarse_block,
        1.0 / fine_block,
        1.0 / samples,
    )
    last_column, last_row = texture.shape[1] - 1.001, texture.shape[0] - 1.001
    texels, stride, one = texture.ravel(), texture.shape[1], np.uint64(1)
    for v in range(top, bottom):
        for u in range(left, right):
            face = owner[v, u] - first_face
            if face < 0 or face >= count:
                continue
            x, y = float(rays[v, u, 0]), float(rays[v, u, 1])
            along_x = rotation[0, 0] * x + rotation[0, 1] * y + rotation[0, 2]
            along_y = rotation[1, 0] * x + rotation[1, 1] * y + rotation[1, 2]
            z = -translation[2] / (rotation[2, 0] * x + rotation[2, 1] * y + rotation[2, 2])
            column = (along_x * z + translation[0] - origin_mm[0]) * per_mm - 0.5
            row = (along_y * z + translation[1] - origin_mm[1]) * per_mm - 0.5
            inner_column = min(max(column, 0.0), last_column)
            inner_row = min(max(row, 0.0), last_row)
            grey = float(coarse[int(inner_row * per_coarse), int(inner_column * per_coarse)])
            if math.isnan(grey):
                xu, yu, xv, yv = _steps(rays, v, u)
                # Within a pixel the print's coordinates are as good as linear.
                nearer = z * z / translation[2]
                zu = nearer * (rotation[2, 0] * xu + rotation[2, 1] * yu)
                zv = nearer * (rotation[2, 0] * xv + rotation[2, 1] * yv)
                cu = per_mm * (z * (rotation[0, 0] * xu + rotation[0, 1] * yu) + zu * along_x)
                cv = per_mm * (z * (rotation[0, 0] * xv + rotation[0, 1] * yv) + zv * along_x)
                ru = per_mm * (z * (rotation[1, 0] * xu + rotation[1, 1] * yu) + zu * along_y)
                rv = per_mm * (z * (rotation[1, 0] * xv + rotation[1, 1] * yv) + zv * along_y)
                reach = 0.5 * max(abs(cu) + abs(cv), abs(ru) + abs(rv))
                grey = float(fine[int(inner_row * per_fine), int(inner_column * per_fine)])
                if math.isnan(grey) or reach > fine_block - 1.0:
                    grey = 0.0
                    for sv in range(samples):
                        along_v = (sv + 0.5) * per_sample - 0.5
                        column_v, row_v = column + along_v * cv, row + along_v * rv
                        for su in range(samples):
                            along_u = (su + 0.5) * per_sample - 0.5
                            sc = min(max(column_v + along_u * cu, 0.0), last_column)
                            sr = min(max(row_v + along_u * ru, 0.0), last_row)
                            whole_c, whole_r = np.int64(sc), np.int64(sr)
                            fc, fr = np.float32(sc - whole_c), np.float32(sr - whole_r)
                            at = np.uint64(whole_r * stride + whole_c)
                            below = at + np.uint64(stride)
                            upper = texels[at] + fc * (texels[at + one] - texels[at])
                            lower = texels[below] + fc * (texels[below + one] - texels[below])
                            grey += upper + fr * (lower - upper)
                    grey *= per_sample * per_sample
            for n in range(3):
                albedo_out[v, u, n] = grey


@njit(nogil=True, cache=True, error_model="numpy")
def shade(
    owner: NDArray[np.int32],
    normal: F32,
    albedo: F32,
    towards_lamp: Floats,
    lamp_grey: float,
    ambient_grey: float,
    seen: F32,
) -> None:
    height, width = owner.shape
    lx, ly, lz = np.float32(towards_lamp[0]), np.float32(towards_lamp[1]), np.float32(towards_lamp[2])
    lamp, ambient = np.float32(lamp_grey), np.float32(ambient_grey)
    for v in range(height):
        for u in range(width):
            if owner[v, u] < 0:
                continue
            facing = normal[v, u, 0] * lx + normal[v, u, 1] * ly + normal[v, u, 2] * lz
            light = ambient + lamp * max(facing, np.float32(0.0))
            for c in range(3):
                seen[v, u, c] = albedo[v, u, c] * light


@njit(nogil=True, cache=True, error_model="numpy")
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
    bins = reach.shape[1]
    per_rad = (bins - 1) / (2.0 * half_fan)
    count = offsets_mm.shape[0]
    lowest, highest = offsets_mm[0], offsets_mm[count - 1]
    ahead = np.empty(vertices.shape[0])
    for n in range(vertices.shape[0]):
        ahead[n] = (
            normal[0] * vertices[n, 0] + normal[1] * vertices[n, 1] + normal[2] * vertices[n, 2] - distance_mm
        )
    for face in range(faces.shape[0]):
        i, j, k = faces[face, 0], faces[face, 1], faces[face, 2]
        qi, qj, qk = ahead[i], ahead[j], ahead[k]
        low, high = min(qi, qj, qk), max(qi, qj, qk)
        if high < lowest or low > highest:
            continue
        for s in range(count):
            offset = offsets_mm[s]
            if not (low < offset <= high):
                continue
            found = 0
            px, py, rx, ry = 0.0, 0.0, 0.0, 0.0
            for edge in range(3):
                if edge == 0:
                    a, b = i, j
                elif edge == 1:
                    a, b = j, k
                else:
                    a, b = k, i
                qa, qb = ahead[a] - offset, ahead[b] - offset
                if (qa < 0.0) == (qb < 0.0):
                    continue
                share = qa / (qa - qb)
                mx = vertices[a, 0] + share * (vertices[b, 0] - vertices[a, 0]) - source[0]
                my = vertices[a, 1] + share * (vertices[b, 1] - vertices[a, 1]) - source[1]
                mz = vertices[a, 2] + share * (vertices[b, 2] - vertices[a, 2]) - source[2]
                x = mx * forward[0] + my * forward[1] + mz * forward[2]
                y = mx * sideways[0] + my * sideways[1] + mz * sideways[2]
                if found == 0:
                    px, py = x, y
                else:
                    rx, ry = x, y
                found += 1
            if found < 2 or px <= 0.0 or rx <= 0.0:
                continue
            first = (math.atan2(py, px) + half_fan) * per_rad
            last = (math.atan2(ry, rx) + half_fan) * per_rad
            if first > last:
                first, last = last, first
            start, end = max(0, math.ceil(first)), min(bins - 1, math.floor(last))
            cross = px * ry - py * rx
            for n in range(start, end + 1):
                along = cosine[n] * (ry - py) - sine[n] * (rx - px)
                if along == 0.0:
                    continue
                distance = np.float32(cross / along)
                if 0.0 < distance < reach[s, n]:
                    reach[s, n] = distance


@njit(nogil=True, cache=True, error_model="numpy")
def near(
    rays: F32, depth: F32, plane: Floats, distance_mm: float, widest_mm: float
) -> tuple[NDArray[np.int32], NDArray[np.int32]]:
    height, width = depth.shape
    n0, n1, n2 = np.float32(plane[0]), np.float32(plane[1]), np.float32(plane[2])
    offset, widest = np.float32(distance_mm), np.float32(widest_mm)
    rows, columns = np.empty(height * width, np.int32), np.empty(height * width, np.int32)
    ahead = np.empty(width, np.float32)
    count = 0
    for v in range(height):
        for u in range(width):
            ahead[u] = abs((n0 * rays[v, u, 0] + n1 * rays[v, u, 1] + n2) * depth[v, u] - offset)
        for u in range(width):
            if ahead[u] <= widest:
                rows[count], columns[count] = v, u
                count += 1
    return rows[:count].copy(), columns[:count].copy()


@njit(nogil=True, cache=True, error_model="numpy")
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
    bins, slices = reach.shape[1], offsets_mm.shape[0]
    per_rad = (bins - 1) / (2.0 * half_fan)
    spacing = offsets_mm[1] - offsets_mm[0]
    for n in range(rows.shape[0]):
        v, u = rows[n], columns[n]
        z = float(depth[v, u])
        x, y = float(rays[v, u, 0]), float(rays[v, u, 1])
        slope = plane[0] * x + plane[1] * y + plane[2]
        q = slope * z - distance_mm
        lx, ly, lz = x * z - source[0], y * z - source[1], z - source[2]
        distance = math.sqrt(lx * lx + ly * ly + lz * lz)
        sigma = sigma_mm * math.sqrt(1.0 + ((distance - focus_mm) / focus_depth_mm) ** 2)
        if abs(q) > 4.5 * sigma:
            continue
        m0, m1, m2 = float(normal[v, u, 0]), float(normal[v, u, 1]), float(normal[v, u, 2])
        facing = -(lx * m0 + ly * m1 + lz * m2) / distance
        if facing <= 0.0:
            continue
        # Walk on the surface to the nearest of the slices whose shadows are known.
        s = min(max(round((q - offsets_mm[0]) / spacing), 0), slices - 1)
        along = plane[0] * m0 + plane[1] * m1 + plane[2] * m2
        walk = (offsets_mm[s] - q) / max(1.0 - along * along, 0.02)
        wx = lx + walk * (plane[0] - along * m0)
        wy = ly + walk * (plane[1] - along * m1)
        wz = lz + walk * (plane[2] - along * m2)
        ahead = wx * forward[0] + wy * forward[1] + wz * forward[2]
        aside = wx * sideways[0] + wy * sideways[1] + wz * sideways[2]
        fan = math.atan2(aside, ahead)
        if abs(fan) > half_fan:
            continue
        nearest = reach[s, round((fan + half_fan) * per_rad)]
        if math.sqrt(ahead * ahead + aside * aside) > nearest + 0.3 + 0.1 / max(facing, 0.05):
            continue
        xu, yu, xv, yv = _steps(rays, v, u)
        towards = min(m0 * x + m1 * y + m2, -0.03)
        qu = z * (plane[0] * xu + plane[1] * yu - slope * (m0 * xu + m1 * yu) / towards)
        qv = z * (plane[0] * xv + plane[1] * yv - slope * (m0 * xv + m1 * yv) / towards)
        total = 0.0
        for a in range(3):
            for b in range(3):
                r = (q + _NODES[a] * qu + _NODES[b] * qv) / sigma
                total += _WEIGHTS[a] * _WEIGHTS[b] * math.exp(-0.5 * r * r)
        tint = colour[0] * albedo[v, u, 0] + colour[1] * albedo[v, u, 1] + colour[2] * albedo[v, u, 2]
        grey[n] = peak_grey * tint * total * facing * (focus_mm / distance) * (sigma_mm / sigma)


# Gauss and Legendre's three points on a pixel's width.
_NODES = (-0.5 * math.sqrt(0.6), 0.0, 0.5 * math.sqrt(0.6))
_WEIGHTS = (5.0 / 18.0, 8.0 / 18.0, 5.0 / 18.0)


@njit(nogil=True, cache=True, error_model="numpy")
def speckle(
    laser: F32,
    tint: F32,
    levels: F32,
    seed: np.uint64,
    first: int,
    stride: int,
    gathered: F32,
) -> None:
    height, width = laser.shape
    for v in range(height):
        for u in range(width):
            if laser[v, u] > 0.0:
                light = laser[v, u] * levels[_random(seed, first + v * stride + u) & _LOW_16]
                for c in range(gathered.shape[2]):
                    gathered[v, u, c] += light * tint[c]


@njit(nogil=True, cache=True)
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
    height, length = ambient.shape
    ones = np.ones(gathered.shape[1], np.float32)
    per_electron, read = np.float32(1.0 / electrons_per_grey), np.float32(read_variance)
    most = normals.shape[0] - length + 1
    end = left + gathered.shape[1]
    for v in range(height):
        start = np.int64(_random(seed, v) % np.uint64(most))
        noise = normals[start : start + length]
        if v < top or v >= top + gathered.shape[0]:
            _develop(ambient[v], amounts, per_electron, read, noise, image[v])
            continue
        _develop(ambient[v, :left], amounts[:left], per_electron, read, noise[:left], image[v, :left])
        _develop(gathered[v - top], ones, per_electron, read, noise[left:end], image[v, left:end])
        _develop(ambient[v, end:], amounts[end:], per_electron, read, noise[end:], image[v, end:])


@njit(nogil=True, cache=True, fastmath={"nnan", "ninf", "nsz"})
def _develop(
    light: F32,
    amounts: F32,
    per_electron: np.float32,
    read: np.float32,
    noise: F32,
    image: NDArray[np.uint8],
) -> None:
    half, black, white = np.float32(0.5), np.float32(0.0), np.float32(255.0)
    for n in range(light.shape[0]):
        grey = light[n] * amounts[n]
        grey += np.sqrt(grey * per_electron + read) * noise[n] + half
        image[n] = np.uint8(np.int32(min(max(grey, black), white)))


@njit(nogil=True, cache=True)
def _random(seed: np.uint64, number: int) -> np.uint64:
    bits = seed + np.uint64(number) * _GOLDEN
    bits = (bits ^ (bits >> np.uint64(30))) * _MIX_1
    bits = (bits ^ (bits >> np.uint64(27))) * _MIX_2
    return bits ^ (bits >> np.uint64(31))

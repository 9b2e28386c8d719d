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


@njit(nogil=True, cache=True)
def rasterise(
    vertices: Floats,
    pixels: Floats,
    faces: NDArray[np.int32],
    rays: F32,
    depth: F32,
    owner: NDArray[np.int32],
    first_face: int,
    is_closed: bool,
) -> tuple[int, int, int, int]:
    height, width = depth.shape
    top, bottom, left, right = height, 0, width, 0
    for face in range(faces.shape[0]):
        i, j, k = faces[face, 0], faces[face, 1], faces[face, 2]
        if not (vertices[i, 2] > 1e-3 and vertices[j, 2] > 1e-3 and vertices[k, 2] > 1e-3):
            continue
        ax = vertices[j, 1] * vertices[k, 2] - vertices[j, 2] * vertices[k, 1]
        ay = vertices[j, 2] * vertices[k, 0] - vertices[j, 0] * vertices[k, 2]
        az = vertices[j, 0] * vertices[k, 1] - vertices[j, 1] * vertices[k, 0]
        det = vertices[i, 0] * ax + vertices[i, 1] * ay + vertices[i, 2] * az
        if det == 0.0 or (is_closed and det > 0.0):
            continue
        bx = vertices[k, 1] * vertices[i, 2] - vertices[k, 2] * vertices[i, 1]
        by = vertices[k, 2] * vertices[i, 0] - vertices[k, 0] * vertices[i, 2]
        bz = vertices[k, 0] * vertices[i, 1] - vertices[k, 1] * vertices[i, 0]
        cx = vertices[i, 1] * vertices[j, 2] - vertices[i, 2] * vertices[j, 1]
        cy = vertices[i, 2] * vertices[j, 0] - vertices[i, 0] * vertices[j, 2]
        cz = vertices[i, 0] * vertices[j, 1] - vertices[i, 1] * vertices[j, 0]
        u_low = min(pixels[i, 0], pixels[j, 0], pixels[k, 0])
        u_high = max(pixels[i, 0], pixels[j, 0], pixels[k, 0])
        v_low = min(pixels[i, 1], pixels[j, 1], pixels[k, 1])
        v_high = max(pixels[i, 1], pixels[j, 1], pixels[k, 1])
        # Distortion bends the edges of a large triangle out of the box about its corners.
        margin = 0.06 * max(u_high - u_low, v_high - v_low)
        if not (u_low - margin < width and v_low - margin < height):
            continue
        if not (u_high + margin > -1.0 and v_high + margin > -1.0):
            continue
        u0 = max(0, math.floor(u_low - margin))
        u1 = min(width - 1, math.ceil(u_high + margin))
        v0 = max(0, math.floor(v_low - margin))
        v1 = min(height - 1, math.ceil(v_high + margin))
        sign = 1.0 if det > 0.0 else -1.0
        for v in range(v0, v1 + 1):
            for u in range(u0, u1 + 1):
                x, y = rays[v, u, 0], rays[v, u, 1]
                wa = ax * x + ay * y + az
                wb = bx * x + by * y + bz
                wc = cx * x + cy * y + cz
                if wa * sign < 0.0 or wb * sign < 0.0 or wc * sign < 0.0:
                    continue
                z = np.float32(det / (wa + wb + wc))
                if z < depth[v, u]:
                    depth[v, u] = z
                    owner[v, u] = first_face + face
                    top, bottom = min(top, v), max(bottom, v + 1)
                    left, right = min(left, u), max(right, u + 1)
    return top, bottom, left, right


@njit(nogil=True, cache=True)
def resolve(
    box: tuple[int, int, int, int],
    owner: NDArray[np.int32],
    first_face: int,
    vertices: Floats,
    normals: Floats,
    faces: NDArray[np.int32],
    albedo: F32,
    quadrics: Floats,
    face_quadric: NDArray[np.int32],
    rays: F32,
    depth: F32,
    normal_out: F32,
    albedo_out: F32,
) -> None:
    top, bottom, left, right = box
    count = faces.shape[0]
    for v in range(top, bottom):
        for u in range(left, right):
            face = owner[v, u] - first_face
            if face < 0 or face >= count:
                continue
            x, y = float(rays[v, u, 0]), float(rays[v, u, 1])
            i, j, k = faces[face, 0], faces[face, 1], faces[face, 2]
            wa = _triple(vertices, j, k, x, y)
            wb = _triple(vertices, k, i, x, y)
            wc = _triple(vertices, i, j, x, y)
            total = wa + wb + wc
            wa, wb, wc = wa / total, wb / total, wc / total
            nx = wa * normals[i, 0] + wb * normals[j, 0] + wc * normals[k, 0]
            ny = wa * normals[i, 1] + wb * normals[j, 1] + wc * normals[k, 1]
            nz = wa * normals[i, 2] + wb * normals[j, 2] + wc * normals[k, 2]
            which = face_quadric[face]
            if which >= 0:
                q = quadrics[which]
                gx = q[0, 0] * x + q[0, 1] * y + q[0, 2]
                gy = q[1, 0] * x + q[1, 1] * y + q[1, 2]
                gz = q[2, 0] * x + q[2, 1] * y + q[2, 2]
                a = gx * x + gy * y + gz
                b = q[0, 3] * x + q[1, 3] * y + q[2, 3]
                root = b * b - a * q[3, 3]
                if root > 0.0 and a != 0.0:
                    z = float(depth[v, u])
                    near, far = (-b - math.sqrt(root)) / a, (-b + math.sqrt(root)) / a
                    exact = near if abs(near - z) < abs(far - z) else far
                    if abs(exact - z) < 0.01 * z:
                        depth[v, u] = np.float32(exact)
                        sx = exact * gx + q[0, 3]
                        sy = exact * gy + q[1, 3]
                        sz = exact * gz + q[2, 3]
                        side = 1.0 if sx * nx + sy * ny + sz * nz >= 0.0 else -1.0
                        nx, ny, nz = side * sx, side * sy, side * sz
            length = math.sqrt(nx * nx + ny * ny + nz * nz)
            # Seen from behind, a surface that is not closed shows its other side.
            if nx * x + ny * y + nz > 0.0 and total > 0.0:
                length = -length
            normal_out[v, u, 0] = nx / length
            normal_out[v, u, 1] = ny / length
            normal_out[v, u, 2] = nz / length
            for c in range(3):
                albedo_out[v, u, c] = wa * albedo[i, c] + wb * albedo[j, c] + wc * albedo[k, c]


@njit(nogil=True, cache=True)
def _triple(vertices: Floats, j: int, k: int, x: float, y: float) -> float:
    volume: float = (
        (vertices[j, 1] * vertices[k, 2] - vertices[j, 2] * vertices[k, 1]) * x
        + (vertices[j, 2] * vertices[k, 0] - vertices[j, 0] * vertices[k, 2]) * y
        + (vertices[j, 0] * vertices[k, 1] - vertices[j, 1] * vertices[k, 0])
    )
    return volume


@njit(nogil=True, cache=True)
def paint(
    box: tuple[int, int, int, int],
    owner: NDArray[np.int32],
    first_face: int,
    count: int,
    rotation: Floats,
    translation: Floats,
    texture: F32,
    is_busy: NDArray[np.bool_],
    block: int,
    origin_mm: Floats,
    texel_mm: float,
    samples: int,
    rays: F32,
    albedo_out: F32,
) -> None:
    top, bottom, left, right = box
    height, width = owner.shape
    for v in range(top, bottom):
        for u in range(left, right):
            face = owner[v, u] - first_face
            if face < 0 or face >= count:
                continue
            u_next, u_last = min(u + 1, width - 1), max(u - 1, 0)
            v_next, v_last = min(v + 1, height - 1), max(v - 1, 0)
            xu = (rays[v, u_next, 0] - rays[v, u_last, 0]) / (u_next - u_last)
            yu = (rays[v, u_next, 1] - rays[v, u_last, 1]) / (u_next - u_last)
            xv = (rays[v_next, u, 0] - rays[v_last, u, 0]) / (v_next - v_last)
            yv = (rays[v_next, u, 1] - rays[v_last, u, 1]) / (v_next - v_last)
            x, y = float(rays[v, u, 0]), float(rays[v, u, 1])
            z = -translation[2] / (rotation[2, 0] * x + rotation[2, 1] * y + rotation[2, 2])
            across = (rotation[0, 0] * x + rotation[0, 1] * y + rotation[0, 2]) * z + translation[0]
            down = (rotation[1, 0] * x + rotation[1, 1] * y + rotation[1, 2]) * z + translation[1]
            column = min(max((across - origin_mm[0]) / texel_mm - 0.5, 0.0), texture.shape[1] - 1.001)
            row = min(max((down - origin_mm[1]) / texel_mm - 0.5, 0.0), texture.shape[0] - 1.001)
            total = 0.0
            if not is_busy[int(row) // block, int(column) // block]:
                total = texture[int(row), int(column)] * samples * samples
            else:
                for sv in range(samples):
                    dv = (sv + 0.5) / samples - 0.5
                    for su in range(samples):
                        du = (su + 0.5) / samples - 0.5
                        px, py = x + du * xu + dv * xv, y + du * yu + dv * yv
                        total += _printed(texture, rotation, translation, origin_mm, texel_mm, px, py)
            for c in range(3):
                albedo_out[v, u, c] = total / (samples * samples)


@njit(nogil=True, cache=True, inline="always")
def _printed(
    texture: F32,
    rotation: Floats,
    translation: Floats,
    origin_mm: Floats,
    texel_mm: float,
    x: float,
    y: float,
) -> float:
    z = -translation[2] / (rotation[2, 0] * x + rotation[2, 1] * y + rotation[2, 2])
    across = (rotation[0, 0] * x + rotation[0, 1] * y + rotation[0, 2]) * z + translation[0] - origin_mm[0]
    down = (rotation[1, 0] * x + rotation[1, 1] * y + rotation[1, 2]) * z + translation[1] - origin_mm[1]
    column = min(max(across / texel_mm - 0.5, 0.0), texture.shape[1] - 1.001)
    row = min(max(down / texel_mm - 0.5, 0.0), texture.shape[0] - 1.001)
    c, r = int(column), int(row)
    fc, fr = column - c, row - r
    upper: float = texture[r, c] + fc * (texture[r, c + 1] - texture[r, c])
    lower: float = texture[r + 1, c] + fc * (texture[r + 1, c + 1] - texture[r + 1, c])
    grey: float = upper + fr * (lower - upper)
    return grey


@njit(nogil=True, cache=True)
def shade(
    box: tuple[int, int, int, int],
    owner: NDArray[np.int32],
    first_face: int,
    normal: F32,
    albedo: F32,
    towards_lamp: Floats,
    lamp_grey: float,
    ambient_grey: float,
    seen: F32,
) -> None:
    top, bottom, left, right = box
    lx, ly, lz = np.float32(towards_lamp[0]), np.float32(towards_lamp[1]), np.float32(towards_lamp[2])
    lamp, ambient = np.float32(lamp_grey), np.float32(ambient_grey)
    for v in range(top, bottom):
        for u in range(left, right):
            if owner[v, u] < first_face:
                continue
            facing = normal[v, u, 0] * lx + normal[v, u, 1] * ly + normal[v, u, 2] * lz
            light = ambient + lamp * max(facing, np.float32(0.0))
            for c in range(3):
                seen[v, u, c] = albedo[v, u, c] * light


@njit(nogil=True, cache=True)
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


@njit(nogil=True, cache=True)
def light(
    rays: F32,
    depth: F32,
    normal: F32,
    albedo: F32,
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
    irradiance: F32,
) -> None:
    height, width = depth.shape
    bins, slices = reach.shape[1], offsets_mm.shape[0]
    per_rad = (bins - 1) / (2.0 * half_fan)
    spacing = offsets_mm[1] - offsets_mm[0]
    n0, n1, n2 = np.float32(plane[0]), np.float32(plane[1]), np.float32(plane[2])
    offset32 = np.float32(distance_mm)
    widest = np.float32(4.5 * sigma_mm * math.sqrt(1.0 + (focus_mm / focus_depth_mm) ** 2) + 0.05)
    for v in range(height):
        for u in range(width):
            z = depth[v, u]
            if abs((n0 * rays[v, u, 0] + n1 * rays[v, u, 1] + n2) * z - offset32) > widest:
                continue
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
            u_next, u_last = min(u + 1, width - 1), max(u - 1, 0)
            v_next, v_last = min(v + 1, height - 1), max(v - 1, 0)
            xu = (rays[v, u_next, 0] - rays[v, u_last, 0]) / (u_next - u_last)
            yu = (rays[v, u_next, 1] - rays[v, u_last, 1]) / (u_next - u_last)
            xv = (rays[v_next, u, 0] - rays[v_last, u, 0]) / (v_next - v_last)
            yv = (rays[v_next, u, 1] - rays[v_last, u, 1]) / (v_next - v_last)
            towards = min(m0 * x + m1 * y + m2, -0.03)
            qu = z * (plane[0] * xu + plane[1] * yu - slope * (m0 * xu + m1 * yu) / towards)
            qv = z * (plane[0] * xv + plane[1] * yv - slope * (m0 * xv + m1 * yv) / towards)
            total = 0.0
            for a in range(3):
                for b in range(3):
                    r = (q + _NODES[a] * qu + _NODES[b] * qv) / sigma
                    total += _WEIGHTS[a] * _WEIGHTS[b] * math.exp(-0.5 * r * r)
            tint = colour[0] * albedo[v, u, 0] + colour[1] * albedo[v, u, 1] + colour[2] * albedo[v, u, 2]
            irradiance[v, u] = peak_grey * tint * total * facing * (focus_mm / distance) * (sigma_mm / sigma)


# Gauss and Legendre's three points on a pixel's width.
_NODES = (-0.5 * math.sqrt(0.6), 0.0, 0.5 * math.sqrt(0.6))
_WEIGHTS = (5.0 / 18.0, 8.0 / 18.0, 5.0 / 18.0)


@njit(nogil=True, cache=True)
def expose(
    ambient: F32,
    lasers: F32,
    tints: F32,
    electrons_per_grey: float,
    read_variance: float,
    normal_levels: F32,
    speckle_levels: F32,
    seed: np.uint64,
    image: NDArray[np.uint8],
) -> None:
    height, width, channels = ambient.shape
    count = lasers.shape[0]
    per_electron = np.float32(1.0 / electrons_per_grey)
    read = np.float32(read_variance)
    half, black, white = np.float32(0.5), np.float32(0.0), np.float32(255.0)
    for v in range(height):
        for u in range(width):
            bits = _random(seed, v * width + u)
            is_lit = False
            for n in range(count):
                is_lit |= lasers[n, v, u] > 0.0
            for c in range(channels):
                grey = ambient[v, u, c]
                if is_lit:
                    for n in range(count):
                        number = ((n + 1) * height + v) * width + u
                        grain = speckle_levels[_random(seed, number) & _LOW_16]
                        grey += lasers[n, v, u] * grain * tints[n, c]
                grey += math.sqrt(grey * per_electron + read) * normal_levels[bits & _LOW_16] + half
                bits >>= np.uint64(16)
                image[v, u, c] = np.uint8(np.int32(min(max(grey, black), white)))


@njit(nogil=True, cache=True)
def _random(seed: np.uint64, number: int) -> np.uint64:
    bits = seed + np.uint64(number) * _GOLDEN
    bits = (bits ^ (bits >> np.uint64(30))) * _MIX_1
    bits = (bits ^ (bits >> np.uint64(27))) * _MIX_2
    return bits ^ (bits >> np.uint64(31))

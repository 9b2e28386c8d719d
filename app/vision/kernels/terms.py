"""Three terms of noise from mean squares; plain Python that numba can compile as it stands."""

import numpy as np

from app.geometry.arrays import Floats

_ROUNDS = 2


def noise_terms(means: Floats, squares: Floats, least: float) -> tuple[float, float, float]:
    """Non-negative x (3,) with means @ x nearest to squares, each square trusted in proportion to its size.

    Every subset of the three is tried, and the best whose members are all positive is the answer.

    Args:
        means: (M, 3); a row whose last entry is 0 is empty.
        squares: (M,).
        least: no square is smaller than this.
    """
    expected = np.maximum(squares, least)
    best = (0.0, 0.0, 0.0)
    for _ in range(_ROUNDS):
        # The mean of squares of variance v scatters in proportion to v.
        a = np.zeros((3, 3))
        b = np.zeros(3)
        for row in range(len(squares)):
            weight = 1.0 / (expected[row] * expected[row])
            for i in range(3):
                b[i] += weight * means[row, i] * squares[row]
                for j in range(3):
                    a[i, j] += weight * means[row, i] * means[row, j]
        gain = -1.0
        best = (0.0, 0.0, 0.0)
        for subset in range(1, 8):
            # Cramer's rule; a term that is left out has a row of its own that holds it at 0.
            m = np.eye(3)
            r = np.zeros(3)
            for i in range(3):
                if subset >> i & 1:
                    r[i] = b[i]
                    for j in range(3):
                        m[i, j] = a[i, j] if subset >> j & 1 else 0.0
            c0 = m[1, 1] * m[2, 2] - m[1, 2] * m[2, 1]
            c1 = m[1, 2] * m[2, 0] - m[1, 0] * m[2, 2]
            c2 = m[1, 0] * m[2, 1] - m[1, 1] * m[2, 0]
            determinant = m[0, 0] * c0 + m[0, 1] * c1 + m[0, 2] * c2
            if determinant <= 1e-9 * m[0, 0] * m[1, 1] * m[2, 2]:
                continue
            d0 = m[1, 2] * r[2] - r[1] * m[2, 2]
            d1 = r[1] * m[2, 1] - m[1, 1] * r[2]
            d2 = m[1, 0] * r[2] - r[1] * m[2, 0]
            x = (
                (r[0] * c0 + m[0, 1] * d0 + m[0, 2] * d1) / determinant,
                (-m[0, 0] * d0 + r[0] * c1 + m[0, 2] * d2) / determinant,
                (-m[0, 0] * d1 - m[0, 1] * d2 + r[0] * c2) / determinant,
            )
            # By how much this subset lowers the sum of squares.
            lowers = x[0] * b[0] + x[1] * b[1] + x[2] * b[2]
            if x[0] >= 0.0 and x[1] >= 0.0 and x[2] >= 0.0 and lowers > gain:
                gain, best = lowers, x
        for row in range(len(squares)):
            value = means[row, 0] * best[0] + means[row, 1] * best[1] + means[row, 2] * best[2]
            expected[row] = max(value, least)
    return best

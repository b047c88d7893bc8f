"""A long straight tube with an eccentric hole that pressure bends: its cross-section alone, an oracle without a solid mesh.

Far from its ends every cross-section does the same and the tube becomes a ring: a section's points move in their plane to
(y, z), and the fibre there is stretched by lambda = a + k z, k being the angle of the ring per undeformed length. The energy
per length

    int W(F) dA - P V,    F = (in-plane gradient, lambda),    V = int_hole lambda dA  (Pappus)

is stationary in the displacements, in a and in k; closed ends are in V. Squares of nine nodes on half the section, Newton's
method with exact derivatives (complex steps). Nothing is shared with the library but the law's numbers: Yeoh's law, J - 1
squared.

At small strain Betti's theorem with Saint-Venant's bending gives k in closed form: bending the tube by a moment changes the
hole's volume by (1 - 2 nu) int (z - centroid) dA times the curvature, so that k = P (1 - 2 nu) A_hole e / (E I). An
incompressible tube is not bent at all to first order.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

GAUSS = np.polynomial.legendre.leggauss(3)
STEP = 1e-30


class Section(NamedTuple):
    """Half a rectangular section with a rectangular hole, in m; z from any level.

    Attributes:
        half: Half the width.
        hole: Half the hole's width.
        levels: z of the lower face, the hole's floor, its ceiling and the upper face, rising.
    """

    half: float
    hole: float
    levels: tuple[float, float, float, float]

    def small_curvature(self, pressure: float, young: float, poisson: float) -> float:
        """k in 1/m at a small pressure, in closed form."""
        z0, z1, z2, z3 = self.levels
        parts = [(2 * self.half, z0, z3, 1.0), (2 * self.hole, z1, z2, -1.0)]
        area, first, second = (
            sum(sign * width * (high**n - low**n) / n for width, low, high, sign in parts) for n in (1, 2, 3)
        )
        centroid = first / area
        inertia = second - area * centroid**2
        eccentricity = 0.5 * (z1 + z2) - centroid
        return pressure * (1 - 2 * poisson) * 2 * self.hole * (z2 - z1) * eccentricity / (young * inertia)


def _shapes(s):
    """Three quadratic functions on -1 to 1 and their slopes, shape (3, n)."""
    return np.array([s * (s - 1) / 2, 1 - s * s, s * (s + 1) / 2]), np.array([s - 0.5, -2 * s, s + 0.5])


def stress(c, bulk, F, stretch):
    """Derivatives of W by the in-plane gradient, shape (..., 2, 2), and by the stretch across it."""
    det = F[..., 0, 0] * F[..., 1, 1] - F[..., 0, 1] * F[..., 1, 0]
    cofactor = np.stack([np.stack([F[..., 1, 1], -F[..., 1, 0]], -1), np.stack([-F[..., 0, 1], F[..., 0, 0]], -1)], -2)
    J, I1 = det * stretch, (F * F).sum((-2, -1)) + stretch**2
    k = J ** (-2 / 3) * I1 - 3
    slope = (c[0] + 2 * c[1] * k + 3 * c[2] * k**2) * J ** (-2 / 3)
    p = bulk * (J - 1)
    inverse = cofactor / det[..., None, None]
    plane = 2 * slope[..., None, None] * (F - (I1 / 3)[..., None, None] * inverse) + (p * J)[..., None, None] * inverse
    return plane, 2 * slope * (stretch - I1 / 3 / stretch) + p * det


class BentTube:
    """A section of a law's constants c1, c2, c3 (Pa) and its bulk modulus (Pa), ``n`` squares along each of its parts."""

    def __init__(self, section, constants, bulk, n=3):
        self.constants, self.bulk = constants, bulk
        ys = np.concatenate([np.linspace(0, section.hole, 2 * n + 1), np.linspace(section.hole, section.half, 2 * n + 1)[1:]])
        zs = np.concatenate(
            [
                np.linspace(*pair, 2 * n + 1)[(k > 0) :]
                for k, pair in enumerate(zip(section.levels, section.levels[1:], strict=False))
            ]
        )
        grid = np.arange(len(ys) * len(zs)).reshape(len(ys), len(zs))
        cells = [
            grid[i : i + 3, j : j + 3].ravel()
            for i in range(0, len(ys) - 2, 2)
            for j in range(0, len(zs) - 2, 2)
            if not (ys[i + 1] < section.hole and section.levels[1] < zs[j + 1] < section.levels[2])
        ]
        self.places = np.array([(y, z) for y in ys for z in zs])
        self.cells = np.array(cells)
        # The hole's wall, air on its left, from the floor's middle to the ceiling's.
        i, (low, high) = 2 * n, (2 * n, 4 * n)
        line = [*grid[:i, low], *grid[i, low:high], *grid[i::-1, high]]
        self.edges = np.array([line[k : k + 3] for k in range(0, len(line) - 2, 2)])
        used = np.zeros(len(self.places), dtype=bool)
        used[self.cells.ravel()] = True
        free = np.repeat(used, 2)
        free[0::2] &= self.places[:, 0] > 0
        free[1] = False  # z of the lower face's middle: a says the same
        self.free = np.append(np.flatnonzero(free), [free.size, free.size + 1])
        self.q = np.append(np.zeros(free.size), [1.0, 0.0])
        points, weights = GAUSS
        values, slopes = _shapes(points)
        self.N = np.einsum("ap,bq->pqab", values, values).reshape(9, 9)
        along = np.einsum("ap,bq->pqab", slopes, values).reshape(9, 9)
        up = np.einsum("ap,bq->pqab", values, slopes).reshape(9, 9)
        X = self.places[self.cells]
        jacobian = np.stack([np.einsum("qa,cai->cqi", d, X) for d in (along, up)], -1)
        self.weight = np.linalg.det(jacobian) * np.outer(weights, weights).ravel()
        self.slope = np.einsum("nqa,cqni->cqai", np.stack([along, up]), np.linalg.inv(jacobian))
        self.line, self.line_slope, self.line_weight = values.T, slopes.T, weights

    def _solid(self, q):
        """Forces on every cell's unknowns: nine nodes' y and z, then a and k; complex numbers pass through."""
        u, (a, k) = q[..., :18].reshape(*q.shape[:-1], 9, 2), (q[..., 18], q[..., 19])
        F = np.eye(2) + np.einsum("cai,cqaj->cqij", u, self.slope)
        z = np.einsum("qa,ca->cq", self.N, u[..., 1] + self.places[self.cells][..., 1])
        plane, along = stress(self.constants, self.bulk, F, a[:, None] + k[:, None] * z)
        nodes = np.einsum("cqij,cqaj,cq->cai", plane, self.slope, self.weight)
        across = along * self.weight
        nodes[..., 1] += k[:, None] * np.einsum("cq,qa->ca", across, self.N)
        return np.concatenate([nodes.reshape(-1, 18), across.sum(1)[:, None], (across * z).sum(1)[:, None]], 1)

    def _hole(self, q):
        """Derivative of the hole's volume per length by every edge's unknowns: V = int (a z + k z^2 / 2) dy, clockwise."""
        u, (a, k) = q[..., :6].reshape(*q.shape[:-1], 3, 2) + self.places[self.edges], (q[..., 6:7], q[..., 7:8])
        y, z = np.einsum("qa,ea->eq", self.line_slope, u[..., 0]), np.einsum("qa,ea->eq", self.line, u[..., 1])
        w = -self.line_weight  # the wall is run through with the air on its left
        nodes = np.stack(
            [
                np.einsum("q,eq,qa->ea", w, a * z + k * z**2 / 2, self.line_slope),
                np.einsum("q,eq,qa->ea", w, (a + k * z) * y, self.line),
            ],
            -1,
        )
        ends = [np.einsum("q,eq->e", w, z * y), np.einsum("q,eq->e", w, z**2 / 2 * y)]
        return np.concatenate([nodes.reshape(-1, 6), np.array(ends).T], 1)

    def _assembled(self, forces, parts):
        """Sum of forces and their derivatives over cells or edges."""
        nodes = np.stack([2 * parts, 2 * parts + 1], -1).reshape(len(parts), -1)
        dofs = np.concatenate([nodes, np.tile([self.q.size - 2, self.q.size - 1], (len(parts), 1))], 1)
        own = self.q[dofs]
        total, matrix = np.zeros(self.q.size), np.zeros((self.q.size,) * 2)
        np.add.at(total, dofs, forces(own))
        for j in range(dofs.shape[1]):
            moved = own.astype(complex)
            moved[:, j] += STEP * 1j
            np.add.at(matrix, (dofs, dofs[:, j : j + 1]), forces(moved).imag / STEP)
        return total, matrix

    def solve(self, pressure):
        """k in 1/m at a pressure in Pa, from the last state."""
        for _ in range(30):
            (force, K), (load, L) = self._assembled(self._solid, self.cells), self._assembled(self._hole, self.edges)
            left, matrix = (force - pressure * load)[self.free], (K - pressure * L)[np.ix_(self.free, self.free)]
            step = np.linalg.solve(matrix, -left)
            self.q[self.free] += step
            if np.abs(step[:-2]).max() < 1e-12 * np.ptp(self.places):
                return float(self.q[-1])
        raise RuntimeError(f"no equilibrium at {pressure} Pa")

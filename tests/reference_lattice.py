"""The lattice of docs/model.md in NumPy, tensor by tensor: what the program must agree with.

Nothing is shared with the program: strains come from the Green-Lagrange tensor (Eq. 12), forces
of bonds from F S N (Eqs 10-11) one by one, and those of cells are differences of their energies.
"""

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from taichi_foam.scene import Scene

PACKED = 4.0  # slope of packed foam over K


@dataclass
class ReferenceLattice:
    """One lattice of I x J nodes; history and breaks by bond, as a Snapshot has them."""

    scene: Scene
    position: np.ndarray  # (I, J, 2)
    velocity: np.ndarray | None = None
    worst_a: np.ndarray | None = None  # (I-1, J), 0 by default
    worst_b: np.ndarray | None = None
    intact_a: np.ndarray | None = None  # share of a whole bond's face, 1 by default
    intact_b: np.ndarray | None = None
    broken_a: set[tuple[int, int]] = field(default_factory=set)
    broken_b: set[tuple[int, int]] = field(default_factory=set)

    def __post_init__(self) -> None:
        self.I, self.J = self.position.shape[:2]

    def exists(self, axis: int, i: int, j: int) -> bool:
        """Whether bond (i, j) of this axis (0: A, 1: B) was ever there."""
        last_i, last_j = (self.I - 1, self.J) if axis == 0 else (self.I, self.J - 1)
        return 0 <= i < last_i and 0 <= j < last_j

    def whole(self, axis: int, i: int, j: int) -> bool:
        broken = self.broken_a if axis == 0 else self.broken_b
        return self.exists(axis, i, j) and (i, j) not in broken

    def left(self, axis: int) -> np.ndarray:
        """Shares of the bonds' faces that carry tension and shear; 0 of broken ones."""
        shape = (self.I - 1, self.J) if axis == 0 else (self.I, self.J - 1)
        given = (self.intact_a, self.intact_b)[axis]
        shares = np.ones(shape) if given is None else given.copy()
        for place in self.broken_a if axis == 0 else self.broken_b:
            shares[place] = 0.0
        return shares

    def counts(self, axis: int, i: int, j: int, side: int) -> bool:
        """Whether the cell ahead of a bond (`side` 0), or behind it (-1), is in its gradient.

        By the face form as long as both bonds that cross there are whole (Eq. 27), else as long as
        it carries shear.
        """
        if self.scene.model.shear == "face":
            ends = [(i, j), (i + 1, j) if axis == 0 else (i, j + 1)]
            step = (0, side) if axis == 0 else (side, 0)
            return all(self.whole(1 - axis, m + step[0], n + step[1]) for m, n in ends)
        m, n = (i, j + side) if axis == 0 else (i + side, j)
        return 0 <= m < self.I - 1 and 0 <= n < self.J - 1 and self.grips[m, n] > 0.0

    def gradient(self, axis: int, i: int, j: int) -> np.ndarray:
        """F with the columns along x and y (Eqs 13, 27); zeros for the second where none is left.

        The cross column is the mean of the one-sided differences at the two end nodes, on each side
        that counts.
        """
        x, (dx, dy) = self.position, self.cell
        ends = [(i, j), (i + 1, j) if axis == 0 else (i, j + 1)]
        length, beside = (dx, dy) if axis == 0 else (dy, dx)
        along = (x[ends[1]] - x[ends[0]]) / length
        step = np.array([0, 1]) if axis == 0 else np.array([1, 0])
        differences = []
        for side in (0, -1):  # what starts at the node, and what ends there
            if self.counts(axis, i, j, side):
                for end in ends:
                    first = np.array(end) + side * step
                    differences.append(x[tuple(first + step)] - x[tuple(first)])
        across = np.mean(differences, axis=0) / beside if differences else 0 * along
        columns = [along, across] if axis == 0 else [across, along]
        return np.stack(columns, axis=1)

    @cached_property
    def cell(self) -> tuple[float, float]:
        return self.scene.block.dx, self.scene.block.dy

    def strains(self, axis: int, i: int, j: int) -> tuple[float, float]:
        """Engineering strain along the bond and shear strain (Eqs 12, 21, 23)."""
        F = self.gradient(axis, i, j)
        E = 0.5 * (F.T @ F - np.eye(2))
        return float(np.sqrt(1 + 2 * E[axis, axis]) - 1), float(2 * E[0, 1])

    def stress(self, e: float, e_min: float, broken: bool) -> float:
        """Fig. 19 with the broken pair's law of continuous reloading, and the rate's overstress."""
        f = self.scene.foam
        K = f.youngs_modulus
        behind = max(min(e_min, f.yield_strain) - e, 0.0) if f.rate else 0.0
        if not f.rate:
            e_min = min(e, e_min)
        e_p = max(e_min, f.densification_strain) - f.yield_strain if e_min < f.yield_strain else 0.0
        if e < f.densification_strain:
            room = (e - f.locking_strain) ** f.densification_b
            sigma = -f.plateau_stress * np.exp(
                f.densification_a * (f.densification_strain - e) / room
            )
        elif e > e_p and e_min < f.yield_strain:
            e_c = f.crushed_tensile_fraction * f.tensile_strain
            sigma = K * e_c * (e - e_p) / (e_c - e_p)
        else:
            sigma = max(K * (e - e_p), -f.plateau_stress)
        sigma -= K * behind
        return min(sigma, 0.0) if broken else sigma

    @cached_property
    def grips(self) -> np.ndarray:
        """Shares of cells that carry shear (I-1, J-1).

        What they hold, times the better of their two sides along each axis.
        """
        a, b = self.left(0), self.left(1)
        along = np.maximum(a[:, :-1], a[:, 1:]), np.maximum(b[:-1], b[1:])
        return self.held() * along[0] * along[1]

    def cell_strains(self, corners: np.ndarray) -> np.ndarray:
        """Shear strains of cells (4, ..., 2): of the means of their opposite sides."""
        dx, dy = self.cell
        first, second, third, fourth = corners
        along_x = 0.5 * ((second - first) + (third - fourth)) / dx
        along_y = 0.5 * ((fourth - first) + (third - second)) / dy
        return (along_x * along_y).sum(axis=-1)

    @property
    def volume(self) -> float:
        """Of a cell [m3]."""
        return self.cell[0] * self.cell[1] * self.scene.block.depth

    def shear_energies(self, corners: np.ndarray) -> np.ndarray:
        """G gamma^2 / 2 times what the volume of each cell grips [J]."""
        modulus = self.scene.foam.shear_modulus
        return 0.5 * modulus * self.volume * self.grips * self.cell_strains(corners) ** 2

    def shear_losses(self, velocities: np.ndarray) -> np.ndarray:
        """Half of the powers [W] that cells lose in shear, at velocities of corners (4, ..., 2).

        Strains are of second order in the positions: a difference over any way is exact.
        """
        f, corners = self.scene.foam, self.corners()
        time = 0.1 * min(self.cell)  # over a velocity of 1 m/s
        ahead, behind = (self.cell_strains(corners + way * velocities) for way in (time, -time))
        rates = (ahead - behind) / (2.0 * time)
        viscosity = self.scene.numerics.damping_time * f.shear_modulus
        return 0.5 * viscosity * self.volume * self.grips * rates**2

    def shear_forces(self) -> np.ndarray:
        """Less the gradients of the cells' energy by position and of their loss by velocity [N].

        In one coordinate both are polynomials of degree four at most, so that the difference over
        five points is exact, and its step may be long: rounding is small.
        """
        forces = self.corner_slopes(self.shear_energies, self.corners(), 0.1 * min(self.cell))
        if self.velocity is not None and self.scene.model.damping == "stiffness":
            forces = forces + self.corner_slopes(self.shear_losses, self.corners("velocity"), 1.0)
        return -forces

    def corner_slopes(
        self, function: Callable[[np.ndarray], np.ndarray], at: np.ndarray, step: float
    ) -> np.ndarray:
        """Gradient (I, J, 2) of a sum over cells by what their corners (4, I-1, J-1, 2) are at."""
        slopes = np.zeros_like(self.position)
        for corner, component in np.ndindex(4, 2):
            total = np.zeros((self.I - 1, self.J - 1))
            for way, weight in ((-2, 1.0), (-1, -8.0), (1, 8.0), (2, -1.0)):
                moved = at.copy()
                moved[corner, ..., component] += way * step
                total += weight * function(moved) / (12.0 * step)
            i, j = ((0, 0), (1, 0), (1, 1), (0, 1))[corner]
            slopes[i : i + self.I - 1, j : j + self.J - 1, component] += total
        return slopes

    def corners(self, name: str = "position") -> np.ndarray:
        """Positions, or velocities, of the corners of the cells, anticlockwise (4, I-1, J-1, 2)."""
        x = getattr(self, name)
        return np.stack([x[:-1, :-1], x[1:, :-1], x[1:, 1:], x[:-1, 1:]])

    def rooms(self) -> np.ndarray:
        """Areas that cells' bonds have left them, over those at rest (I-1, J-1)."""
        left = []
        for axis, worst in enumerate((self.worst_a, self.worst_b)):
            strain = np.linalg.norm(np.diff(self.position, axis=axis), axis=-1) / self.cell[axis]
            met = np.minimum(strain - 1.0, 0.0 if worst is None else worst)
            left.append(0.5 * (met[:, :-1] + met[:, 1:] if axis == 0 else met[:-1] + met[1:]))
        return (1.0 + left[0]) * (1.0 + left[1])

    def held(self) -> np.ndarray:
        """What torn cells hold, by their longer diagonal in cells and their area (I-1, J-1)."""
        corners = self.corners()
        diagonals = np.linalg.norm([corners[2] - corners[0], corners[3] - corners[1]], axis=-1)
        size = diagonals.max(axis=0) / np.sqrt(0.5 * (self.cell[0] ** 2 + self.cell[1] ** 2))
        torn = np.zeros(size.shape, dtype=bool)
        for i, j in np.ndindex(*size.shape):
            sides = ((0, i, j), (0, i, j + 1), (1, i, j), (1, i + 1, j))
            torn[i, j] = not all(self.whole(*side) for side in sides)
        hold = np.clip((4.0 - size) / 2.0, 0.0, 1.0) * (self.areas(corners) <= 1.5)
        return np.where(torn, hold, 1.0)

    def areas(self, corners: np.ndarray) -> np.ndarray:
        """Signed areas within corners (4, ..., 2) by the shoelace rule, over those at rest."""
        following = np.roll(corners, -1, axis=0)
        crossed = corners[..., 0] * following[..., 1] - corners[..., 1] * following[..., 0]
        return 0.5 * crossed.sum(axis=0) / (self.cell[0] * self.cell[1])

    def room_forces(self) -> np.ndarray:
        """Less the gradient of the cells' energy for their room, whose size is held [N], (I, J, 2).

        In one coordinate the energy is a parabola, so that a difference over a long way is exact.
        """
        f = self.scene.foam
        left, corners = self.rooms(), self.corners()
        room = np.minimum(left, 1.0 + f.densification_strain)
        yielded = np.clip((left - 1.0 - f.yield_strain) / f.yield_strain, 0.0, 1.0)
        stiffness = PACKED * f.youngs_modulus * yielded * self.held()
        stiffness = stiffness * (self.areas(corners) < room) * self.volume

        def energies(moved: np.ndarray) -> np.ndarray:
            return 0.5 * stiffness * (room - self.areas(moved)) ** 2

        return -self.corner_slopes(energies, corners, 0.1 * min(self.cell))

    def face_force(self, axis: int, i: int, j: int) -> np.ndarray:
        """Force [N] of the face on the bond's first node: T = F S N A0, and its dashpot."""
        block, f = self.scene.block, self.scene.foam
        dx, dy = self.cell
        area = (dy if axis == 0 else dx) * block.depth
        left = self.left(axis)[i, j]
        worst = (self.worst_a, self.worst_b)[axis]
        F = self.gradient(axis, i, j)
        e, gamma = self.strains(axis, i, j)
        stress = self.stress(e, 0.0 if worst is None else worst[i, j], left == 0.0)
        S = np.zeros((2, 2))
        S[axis, axis] = (stress * left if stress > 0.0 else stress) / (1 + e)
        if self.scene.model.shear == "face":
            S[0, 1] = S[1, 0] = f.shear_modulus * gamma * left
        force = F @ S @ np.eye(2)[axis] * area
        if self.velocity is not None and self.scene.model.damping == "stiffness":
            end = (i + 1, j) if axis == 0 else (i, j + 1)
            rate = (self.velocity[end] - self.velocity[i, j]) / (dx, dy)[axis]
            way = self.position[end] - self.position[i, j]
            closing = way * (way @ rate) / (way @ way)
            time = self.scene.numerics.damping_time
            force = force + time * f.youngs_modulus * area * left * closing
        return force

    def node_forces(self) -> np.ndarray:
        """Sum of the forces of bonds and cells on every node [N], (I, J, 2)."""
        by_cells = self.scene.model.shear == "cell"
        total = self.shear_forces() if by_cells else np.zeros((self.I, self.J, 2))
        if self.scene.model.crushed_room:
            total += self.room_forces()
        for axis, i, j in self.bonds():
            force = self.face_force(axis, i, j)
            total[i, j] += force
            total[(i + 1, j) if axis == 0 else (i, j + 1)] -= force
        return total

    def bonds(self) -> list[tuple[int, int, int]]:
        """(axis, i, j) of every bond."""
        return [
            (axis, i, j)
            for axis in (0, 1)
            for i in range(self.I)
            for j in range(self.J)
            if self.exists(axis, i, j)
        ]


def reference_positions(scene: Scene) -> np.ndarray:
    """Cell centres (I, J, 2) [m] of a scene's block."""
    block = scene.block
    x = (np.arange(block.columns) - (block.columns - 1) / 2) * block.dx
    y = (np.arange(block.rows) + 0.5) * block.dy
    return np.stack(np.meshgrid(x, y, indexing="ij"), axis=-1)

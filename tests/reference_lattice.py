"""The lattice of docs/model.md in NumPy, tensor by tensor: what the program must agree with.

Nothing is shared with the program: strains come from the Green-Lagrange tensor (Eq. 12), forces
of bonds from F S N (Eqs 10-11), and those of cells are differences of their energies. Tensors of
all bonds of an axis (0: A, 1: B) stand in one array: (I-1, J, ...) of A, (I, J-1, ...) of B.
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

    def shape(self, axis: int) -> tuple[int, int]:
        """Of the bonds of an axis."""
        return (self.I - 1, self.J) if axis == 0 else (self.I, self.J - 1)

    def whole(self, axis: int) -> np.ndarray:
        """Which bonds are not broken."""
        whole = np.ones(self.shape(axis), dtype=bool)
        for place in self.broken_a if axis == 0 else self.broken_b:
            whole[place] = False
        return whole

    def left(self, axis: int) -> np.ndarray:
        """Shares of the bonds' faces that carry tension and shear; 0 of broken ones."""
        given = (self.intact_a, self.intact_b)[axis]
        return np.where(self.whole(axis), 1.0 if given is None else given, 0.0)

    def worst(self, axis: int) -> np.ndarray:
        """Lowest strains that bonds have met before."""
        given = (self.worst_a, self.worst_b)[axis]
        return np.zeros(self.shape(axis)) if given is None else given

    def counts(self, axis: int) -> np.ndarray:
        """Which cells are in the gradients of the bonds on two of their sides (I-1, J-1).

        By the face form as long as both bonds that cross there are whole (Eq. 27), else as long as
        the cell carries shear.
        """
        if self.scene.model.shear == "face":
            return np.logical_and(*ends(self.whole(1 - axis), axis))
        return self.grips > 0.0

    def gradients(self, axis: int) -> np.ndarray:
        """F (..., 2, 2) with the columns along x and y (Eqs 13, 27).

        The cross column is the mean of the one-sided differences at the two end nodes, on each side
        that counts; zeros where none is left.
        """
        length, beside = self.cell if axis == 0 else self.cell[::-1]
        along = np.diff(self.position, axis=axis) / length
        at_ends = ends(np.diff(self.position, axis=1 - axis), axis)  # (I-1, J-1, 2) each
        counts = self.counts(axis)[..., None]
        differences = self.sums_beside(axis, counts * (at_ends[0] + at_ends[1]))
        number = self.sums_beside(axis, 2 * counts)
        across = differences / np.maximum(number, 1) / beside
        columns = [along, across] if axis == 0 else [across, along]
        return np.stack(columns, axis=-1)

    def sums_beside(self, axis: int, cells: np.ndarray) -> np.ndarray:
        """Sums over the cell ahead of each bond and the one behind, of values (I-1, J-1, n)."""
        total = np.zeros((*self.shape(axis), cells.shape[-1]))
        for part in ends(total, 1 - axis):
            part += cells
        return total

    @cached_property
    def cell(self) -> tuple[float, float]:
        return self.scene.block.dx, self.scene.block.dy

    def strains(self, axis: int) -> tuple[np.ndarray, np.ndarray]:
        """Engineering strains along the bonds and shear strains (Eqs 12, 21, 23)."""
        F = self.gradients(axis)
        E = 0.5 * (np.swapaxes(F, -1, -2) @ F - np.eye(2))
        return np.sqrt(1 + 2 * E[..., axis, axis]) - 1, 2 * E[..., 0, 1]

    def stresses(self, e: np.ndarray, e_min: np.ndarray, broken: np.ndarray) -> np.ndarray:
        """Fig. 19 with the broken pair's law of continuous reloading, and the rate's overstress."""
        f = self.scene.foam
        K, yielded_at, dense_at = f.youngs_modulus, f.yield_strain, f.densification_strain
        behind = np.maximum(np.minimum(e_min, yielded_at) - e, 0.0) if f.rate else 0.0
        if not f.rate:
            e_min = np.minimum(e, e_min)
        yielded = e_min < yielded_at
        e_p = np.where(yielded, np.maximum(e_min, dense_at) - yielded_at, 0.0)

        packed = np.minimum(e, dense_at)
        room = (packed - f.locking_strain) ** f.densification_b
        densified = -f.plateau_stress * np.exp(f.densification_a * (dense_at - packed) / room)
        e_c = f.crushed_tensile_fraction * f.tensile_strain
        stretched = K * e_c * (e - e_p) / (e_c - e_p)
        pressed = np.maximum(K * (e - e_p), -f.plateau_stress)

        sigma = np.where(yielded & (e > e_p), stretched, pressed)
        sigma = np.where(e < dense_at, densified, sigma) - K * behind
        return np.where(broken, np.minimum(sigma, 0.0), sigma)

    @cached_property
    def grips(self) -> np.ndarray:
        """Shares of cells that carry shear (I-1, J-1).

        What they hold, times the better of their two sides along each axis.
        """
        along = [np.maximum(*ends(self.left(axis), 1 - axis)) for axis in (0, 1)]
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
        """Half of the powers [W] that cells lose in shear, at velocities (4, n, I-1, J-1, 2).

        Strains are of second order in the positions: a difference over any way is exact.
        """
        f, corners = self.scene.foam, self.corners()[:, None]
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
        """Gradient (I, J, 2) of a sum over cells by what their corners (4, I-1, J-1, 2) are at.

        The function gives the terms of the sum (n, I-1, J-1), of corners (4, n, I-1, J-1, 2).
        """
        coordinates = np.eye(8).reshape(8, 4, 1, 1, 2)  # each of one corner
        slopes = np.zeros((4, 2, self.I - 1, self.J - 1))
        for way, weight in ((-2, 1.0), (-1, -8.0), (1, 8.0), (2, -1.0)):
            moved = at + way * step * coordinates
            values = function(np.moveaxis(moved, 0, 1))  # (8, I-1, J-1)
            slopes += weight * values.reshape(slopes.shape) / (12.0 * step)
        total = np.zeros_like(self.position)
        for corner, (i, j) in enumerate(((0, 0), (1, 0), (1, 1), (0, 1))):
            total[i : i + self.I - 1, j : j + self.J - 1] += np.moveaxis(slopes[corner], 0, -1)
        return total

    def corners(self, name: str = "position") -> np.ndarray:
        """Positions, or velocities, of the corners of the cells, anticlockwise (4, I-1, J-1, 2)."""
        x = getattr(self, name)
        return np.stack([x[:-1, :-1], x[1:, :-1], x[1:, 1:], x[:-1, 1:]])

    def rooms(self) -> np.ndarray:
        """Areas that cells' bonds have left them, over those at rest (I-1, J-1)."""
        left = []
        for axis in (0, 1):
            strain = np.linalg.norm(np.diff(self.position, axis=axis), axis=-1) / self.cell[axis]
            met = np.minimum(strain - 1.0, self.worst(axis))
            left.append(0.5 * np.add(*ends(met, 1 - axis)))
        return (1.0 + left[0]) * (1.0 + left[1])

    def held(self) -> np.ndarray:
        """What torn cells hold, by their longer diagonal in cells and their area (I-1, J-1)."""
        corners = self.corners()
        diagonals = np.linalg.norm([corners[2] - corners[0], corners[3] - corners[1]], axis=-1)
        size = diagonals.max(axis=0) / np.sqrt(0.5 * (self.cell[0] ** 2 + self.cell[1] ** 2))
        sides = [side for axis in (0, 1) for side in ends(self.whole(axis), 1 - axis)]
        torn = ~np.all(sides, axis=0)
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
        stiffness = PACKED * f.youngs_modulus * self.held()
        stiffness = stiffness * (self.areas(corners) < room) * self.volume

        def energies(moved: np.ndarray) -> np.ndarray:
            return 0.5 * stiffness * (room - self.areas(moved)) ** 2

        return -self.corner_slopes(energies, corners, 0.1 * min(self.cell))

    def face_forces(self, axis: int) -> np.ndarray:
        """Forces [N] of the faces on the bonds' first nodes: T = F S N A0, and their dashpots."""
        block, f = self.scene.block, self.scene.foam
        length, beside = self.cell if axis == 0 else self.cell[::-1]
        area = beside * block.depth
        left = self.left(axis)
        F = self.gradients(axis)
        e, gamma = self.strains(axis)
        stress = self.stresses(e, self.worst(axis), left == 0.0)
        S = np.zeros((*self.shape(axis), 2, 2))
        S[..., axis, axis] = np.where(stress > 0.0, stress * left, stress) / (1 + e)
        if self.scene.model.shear == "face":
            S[..., 0, 1] = S[..., 1, 0] = f.shear_modulus * gamma * left
        forces = F @ S @ np.eye(2)[axis] * area
        if self.velocity is not None and self.scene.model.damping == "stiffness":
            rate = np.diff(self.velocity, axis=axis) / length
            way = np.diff(self.position, axis=axis)
            share = (way * rate).sum(axis=-1) / (way * way).sum(axis=-1)
            time = self.scene.numerics.damping_time
            forces += (time * f.youngs_modulus * area * left * share)[..., None] * way
        return forces

    def node_forces(self) -> np.ndarray:
        """Sum of the forces of bonds and cells on every node [N], (I, J, 2)."""
        by_cells = self.scene.model.shear == "cell"
        total = self.shear_forces() if by_cells else np.zeros((self.I, self.J, 2))
        if self.scene.model.crushed_room:
            total += self.room_forces()
        for axis in (0, 1):
            forces, (first, second) = self.face_forces(axis), ends(total, axis)
            first += forces
            second -= forces
        return total


def ends(values: np.ndarray, axis: int) -> tuple[np.ndarray, np.ndarray]:
    """Views of the first and of the second of each two neighbours along an axis (I or J)."""
    return (values[:-1], values[1:]) if axis == 0 else (values[:, :-1], values[:, 1:])


def reference_positions(scene: Scene) -> np.ndarray:
    """Cell centres (I, J, 2) [m] of a scene's block."""
    block = scene.block
    x = (np.arange(block.columns) - (block.columns - 1) / 2) * block.dx
    y = (np.arange(block.rows) + 0.5) * block.dy
    return np.stack(np.meshgrid(x, y, indexing="ij"), axis=-1)

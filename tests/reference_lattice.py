"""Sections 4.1-4.5 of the paper in NumPy, tensor by tensor: what the program must agree with.

Nothing is shared with the program: strains come from the Green-Lagrange tensor (Eq. 12), forces
from F S N (Eqs 10-11), and it loops over bonds one by one. Shear forces of the variational
form are differences of the shear energy.
"""

from dataclasses import dataclass, field, replace
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

    def gradient(self, axis: int, i: int, j: int) -> np.ndarray | None:
        """F with the columns along x and y (Eq. 13, 27); None for the second where none is left.

        The cross column is the mean of the one-sided differences at the two end nodes, on each side
        one for each, that the chosen reading of Eq. 27 keeps.
        """
        keeps = {"either": all, "both": any}.get(self.scene.model.broken_halves)
        x, (dx, dy) = self.position, self.cell
        ends = [(i, j), (i + 1, j) if axis == 0 else (i, j + 1)]
        length, beside = (dx, dy) if axis == 0 else (dy, dx)
        along = (x[ends[1]] - x[ends[0]]) / length
        step = np.array([0, 1]) if axis == 0 else np.array([1, 0])
        differences = []
        for side in (0, -1):  # the crossing bond that starts at the node, or ends there
            crossing = [
                (end[0] + side * int(step[0]), end[1] + side * int(step[1])) for end in ends
            ]
            whole = [self.whole(1 - axis, *c) for c in crossing]
            if keeps:
                # a half without a pair of nodes at its ends is no half
                there = all(self.exists(1 - axis, *c) for c in crossing)
                whole = [there and keeps(whole)] * 2
            differences += [
                x[c[0] + step[0], c[1] + step[1]] - x[c]
                for c, counts in zip(crossing, whole, strict=True)
                if counts
            ]
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

    def sheared_volume(self, axis: int, i: int, j: int) -> float:
        """Reference volume [m3] of a bond that carries shear: whole and no bare fibre."""
        bare = not self.gradient(axis, i, j)[:, 1 - axis].any()
        volume = self.cell[0] * self.cell[1] * self.scene.block.thickness
        return 0.0 if bare or not self.whole(axis, i, j) else volume

    def columns_of_gradients(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """What positions F's columns are made of: along and across, (2, I, J, nodes) each.

        F is linear in the positions: it is taken of a lattice whose positions are unit vectors.
        With them come the volumes [m3] of what carries shear, (2, I, J).
        """
        nodes = self.I * self.J
        units = replace(self, position=np.eye(nodes).reshape(self.I, self.J, nodes))
        along, across = np.zeros((2, 2, self.I, self.J, nodes))
        volume = np.zeros((2, self.I, self.J))
        for axis, i, j in self.bonds():
            F = units.gradient(axis, i, j)
            along[axis, i, j], across[axis, i, j] = F[:, axis], F[:, 1 - axis]
            volume[axis, i, j] = self.sheared_volume(axis, i, j)
        return along, across, volume

    def shear_energies(self, position: np.ndarray, columns: tuple | None = None) -> np.ndarray:
        """G gamma^2 / 2 times its volume [J] of every bond, (2, I, J)."""
        along, across, volume = columns or self.columns_of_gradients()
        nodes = position.reshape(-1, 2)
        gamma = ((along @ nodes) * (across @ nodes)).sum(axis=-1)
        return 0.5 * self.scene.foam.shear_modulus * gamma**2 * volume

    def shear_forces(self) -> np.ndarray:
        """Less the gradient of the shear energy [N], (I, J, 2), by central differences.

        In one coordinate the energy is a polynomial of degree four (gamma is at most quadratic), so
        that the difference over five points is exact, and its step may be long: rounding is small.
        A node's energy is that of the bonds near it, so every third node is moved at once.
        """
        step = 0.1 * min(self.cell)
        columns = self.columns_of_gradients()
        forces = np.zeros_like(self.position)
        for first_i, first_j, component in np.ndindex(3, 3, 2):
            way = np.zeros_like(self.position)
            way[first_i::3, first_j::3, component] = step
            slope = np.zeros((self.I, self.J))
            for ahead, weight in ((-2, 1), (-1, -8), (1, 8), (2, -1)):
                energies = self.shear_energies(self.position + ahead * way, columns)
                slope += weight * energies.sum(axis=0) / (12.0 * step)
            for i in range(first_i, self.I, 3):
                for j in range(first_j, self.J, 3):
                    near = slope[max(i - 1, 0) : i + 2, max(j - 1, 0) : j + 2]
                    forces[i, j, component] = -near.sum()
        return forces

    def corners(self) -> np.ndarray:
        """Positions of the corners of the cells between four nodes, anticlockwise (4, I-1, J-1)."""
        x = self.position
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
        f, (dx, dy) = self.scene.foam, self.cell
        left, corners = self.rooms(), self.corners()
        room = np.minimum(left, 1.0 + f.densification_strain)
        yielded = np.clip((left - 1.0 - f.yield_strain) / f.yield_strain, 0.0, 1.0)
        stiffness = PACKED * f.youngs_modulus * yielded * self.held()
        stiffness = stiffness * (self.areas(corners) < room) * dx * dy * self.scene.block.thickness
        forces = np.zeros_like(self.position)
        step = 0.1 * min(self.cell)
        for corner, component in np.ndindex(4, 2):
            energy = []
            for way in (-step, step):
                moved = corners.copy()
                moved[corner, ..., component] += way
                energy.append(0.5 * stiffness * (room - self.areas(moved)) ** 2)
            i, j = ((0, 0), (1, 0), (1, 1), (0, 1))[corner]
            slope = (energy[1] - energy[0]) / (2.0 * step)
            forces[i : i + self.I - 1, j : j + self.J - 1, component] -= slope
        return forces

    def face_force(self, axis: int, i: int, j: int) -> np.ndarray:
        """Force [N] of the face on the bond's first node: T = F S N A0, and its dashpot."""
        block, f = self.scene.block, self.scene.foam
        dx, dy = self.cell
        area = (dy if axis == 0 else dx) * block.thickness
        broken = not self.whole(axis, i, j)
        sheared = self.scene.model.shear == "face" and self.sheared_volume(axis, i, j)
        worst = (self.worst_a, self.worst_b)[axis]
        F = self.gradient(axis, i, j)
        e, gamma = self.strains(axis, i, j)
        S = np.zeros((2, 2))
        S[axis, axis] = self.stress(e, 0.0 if worst is None else worst[i, j], broken) / (1 + e)
        if sheared:
            S[0, 1] = S[1, 0] = f.shear_modulus * gamma
        force = F @ S @ np.eye(2)[axis] * area
        if self.velocity is not None and not broken:
            end = (i + 1, j) if axis == 0 else (i, j + 1)
            rate = (self.velocity[end] - self.velocity[i, j]) / (dx, dy)[axis]
            way = self.position[end] - self.position[i, j]
            closing = way * (way @ rate) / (way @ way)
            across = {"bond": f.youngs_modulus, "stiffness": f.shear_modulus}
            viscous = f.youngs_modulus * closing
            viscous = viscous + across[self.scene.model.damping] * (rate - closing)
            force = force + self.scene.numerics.damping_time * area * viscous
        return force

    def node_forces(self) -> np.ndarray:
        """Sum of the faces' forces on every node [N], (I, J, 2)."""
        variational = self.scene.model.shear == "variational"
        total = self.shear_forces() if variational else np.zeros((self.I, self.J, 2))
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

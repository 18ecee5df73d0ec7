"""Scratch: working memory of a step. Only history rows persist in it, until they are harvested."""

from taichi_foam.backend import ti
from taichi_foam.engine.features import Features
from taichi_foam.engine.layout import Layout
from taichi_foam.records.history import BOOKED, ENERGIES_NOW, row_columns

HISTORY_ROWS = 256  # kept on the device between two calls

# Members of a GPU's sums over a lattice.
CONTACT_FORCE = 0  # on the impactor, upwards [N]
SIDE_FORCE = 1  # on an impactor that turns, to the right [N]
TORQUE = 2  # on an impactor that turns [N m]
MOVED = 3  # largest squared displacement of a node in this step [m2]
STIFFEST = 4  # stiffest stiffened bond [N/m]
OVERLAP = 5  # largest overlap with the impactor so far [m]
DIVERGING = 6  # minus the smallest number of a diverged node
CRUSH = 7  # largest crush of a bond
BREAKS = 8  # bonds that break in this step
ENERGIES = 9  # those of `records.history.ENERGIES_NOW`, then BOOKED [J]
ENERGY_SUMS = len(ENERGIES_NOW) + len(BOOKED)
SUMS = ENERGIES + ENERGY_SUMS


class ScratchFields:
    """Workspace of a batch of lattices on the device.

    trial     motion of the nodes at the current stage; x their full radii while a CPU lists
              neighbours
    force     forces of the bonds [N]; on a CPU, of the few columns that a sweep needs at a time
    strain    present strains of the bonds of a column
    tally     sums over a strip of nodes; strips are then added in the same order on any machine
    stiffest, contact_force, energy   of each strip: its stiffest stiffened bond [N/m], the present
              force of its nodes on the impactor [N], energies of `records.history.ENERGIES_NOW` [J]
    side_force, torque   of each strip on an impactor that turns [N], [N m]
    column_breaks   bonds of each column that break in this step
    presses, column_presses   whether cells of a pack, and on a CPU of a column, may press now
    cell_push   forces of cells on the second ends of both their diagonals [N], stored like `force`
    around    for each bond A and B the worst strain around it, see `cells._look_around`
    crush     for both axes the lasting crush of the cells' bonds at the last look
    excess_shear   shear stress of the cells beyond balance at the last look [Pa], see
              `cells._note_shear`
    column_softens  bonds of each column that soften in this step
    push, candidate_push   forces of other pieces on the nodes [N]: on a GPU, and on a CPU by
              candidate
    bin_head, next_in_bin, bin_of_node   search grid
    history   (batch, HISTORY_ROWS, `row_columns`) rows since the last harvest
    shake     acceleration of the base at the next stage [m/s2]
    sums, totals   sums over each of a GPU's blocks, and over the lattice
    """

    def __init__(self, layout: Layout, features: Features) -> None:
        pack = layout.pack
        self.trial = ti.types.struct(x=pack, y=pack, u=pack, v=pack).field()
        layout.by_columns(self.trial)
        self.force = ti.types.struct(ax=pack, ay=pack, bx=pack, by=pack).field()
        layout.of_sweeps(self.force)
        if not layout.on_gpu:
            self.strain = ti.types.struct(a=pack, b=pack).field()
            layout.listed_by_sweep(layout.packs, self.strain)
        tally = {
            "least": pack,  # smallest strain
            "sheared": pack,  # power of shear [W]
            "damped": pack,  # power of the dashpots [W]
            "pressed": pack,  # power of the cells' room [W]
            "breaks": pack,  # bonds that break in this step
            "by_bonds": pack,  # power of all bonds and cells at the stage [W]
            "moved": pack,  # largest squared displacement in the step [m2]
            "diverged": pack,  # number of diverged nodes
        }
        if features.softens:
            tally["softens"] = pack  # bonds that soften in this step
            self.column_softens = ti.field(ti.i32)
            layout.listed(layout.columns, self.column_softens, whole=True)
        self.tally = ti.types.struct(**tally).field()
        self.stiffest, self.contact_force = ti.field(ti.f64), ti.field(ti.f64)
        self.energy = ti.types.vector(len(ENERGIES_NOW), ti.f64).field()
        layout.of_strips(self.tally, self.stiffest, self.contact_force, self.energy)
        if features.turns:
            self.side_force, self.torque = ti.field(ti.f64), ti.field(ti.f64)
            layout.of_strips(self.side_force, self.torque)
        self.column_breaks = ti.field(ti.i32)
        layout.listed(layout.columns, self.column_breaks, whole=True)
        self.history = ti.field(ti.f64)
        layout.tabled(HISTORY_ROWS, len(row_columns(features.turns)), self.history)
        if layout.on_gpu:
            self.sums, self.totals = ti.field(ti.f64), ti.field(ti.f64)
            layout.tabled(layout.blocks, SUMS, self.sums)
            layout.tabled(1, SUMS, self.totals)
        if features.shaken:
            self.shake = ti.field(ti.f64)
            layout.of_lattices(self.shake)
        if features.cells:
            ends = ("x1", "y1", "x2", "y2")
            if features.law.shears_stiffer and not features.faces:
                ends += ("lean_x", "lean_y")
            self.cell_push = ti.types.struct(**dict.fromkeys(ends, pack)).field()
            layout.of_sweeps(self.cell_push)
        if features.law.looks_around:
            self.around = layout.small_pack.field(), layout.small_pack.field()
            layout.of_nodes(*self.around)
        if features.shear_yields:
            self.crush = layout.small_pack.field(), layout.small_pack.field()
            layout.of_nodes(*self.crush)
            self.excess_shear = layout.small_pack.field()
            layout.of_nodes(self.excess_shear)
        if features.crushed_room:
            self.presses = ti.field(ti.i32)
            layout.of_nodes(self.presses, whole=True)
            self.column_presses = ti.field(ti.i32)
            layout.listed(layout.columns, self.column_presses, whole=True)
        if features.self_contact:
            self._place_contact(layout)

    def _place_contact(self, layout: Layout) -> None:
        self.next_in_bin, self.bin_head = ti.field(ti.i32), ti.field(ti.i32)
        layout.listed(layout.nodes, self.next_in_bin, whole=True)
        layout.listed(layout.bins_x * layout.bins_y, self.bin_head, whole=True)
        if layout.on_gpu:
            self.push = ti.types.struct(x=layout.pack, y=layout.pack).field()
            layout.of_nodes(self.push)
            self.bin_of_node = ti.field(ti.i32)
            layout.listed(layout.nodes, self.bin_of_node, whole=True)
        else:
            # separate from fields that are read: a wide load after a narrow store would stall
            self.candidate_push = ti.types.vector(2, ti.f64).field()
            layout.listed(layout.most_candidates, self.candidate_push)

"""What the figures say: one paragraph to each study."""

SHOCK = """Locking foam obeys Reid and Peng within 4 % at all velocities; what is missing is the
precursor, which has already brought the foam to 2.3 m/s. With it, and with the law as it is, the
jump conditions hold within 0.3 % (0.05 % from 100 m/s on), in both foams, for stress, strain and
energy; momentum, rho c [v] with the front's measured speed, within 0.05 %. Rigid locking foam is
a bad picture of the paper's foam: 20 % too high, since it densifies to 0.92 and not to 0.80, and
since v is counted from rest and not from 16.5 m/s. Below 16.5 m/s it has no front at all. At 20
m/s the front would be 0.9 m thick, and the bar is too short to settle: strain and speed miss,
stress does not. The automatic step does not foresee how densification stiffens: from 100 m/s on
these runs take `numerics.safety = 20 / v`; with 0.8, the run of locking foam at 200 m/s diverges.
"""

LATTICES = """Harrigan, Reid and Yaghoubi argue that mass-spring models cannot have the
discontinuity of a compaction front. A lattice has none, indeed, but it has what a discontinuity
does: stress, strain, speed and dissipation are those of the jump conditions, for every cell, and
they do not depend on the front's thickness. The thickness is that of the dashpots, which a
continuum with the same viscosity has as well, and converges to it with the first power of the
cell (14.6 Pa s: +55, +17, +8, +4 %); at 48.8 Pa s the last 4 % are a front that has not quite
settled. A front that the dashpots would make thinner than about two cells stays 1.6 to 2 cells
thick, and cells ring behind it. So the front sharpens towards a discontinuity with both cell and
viscosity, as with artificial viscosity in any code. They are right about a chain without
dashpots: there nothing takes the energy rho [v]^2 / 2 that a front has to lose, the ringing is as
large as the stress itself (rows swing by 135 % at a hundredth of Table 6's viscosity), and with
none at all plate and foam part and the mean stress is 25 % off. A hundredth is enough for a mean
within 0.7 %, a tenth for 0.2 %.
"""

CONVERGENCE = """With strains as the limits nothing that has to do with cracks converges: the
broken area grows by 1.7 to 2.2 with each halving of the cell down to 2.5 mm, since a crack costs
half as much, the flat face sinks ever deeper (5.9, 6.6, 7.2, 7.6 cm), and under the cylinder the
block of 2.5 mm cells splits and lets it through to the support. Differences between cells are
larger than the ensembles' ranges. With scaled strains, cells of 2.5 mm give what those of 5 mm
give: displacement +1, -3 and -5 %, within or next to the ranges, with histories a few millimetres
apart; so the remedy works there. The broken area itself still changes by up to a factor of two.
Cells of 10 mm agree with neither: four mass points below a flat face, and limits so low that they
are reached before yield (0.035). The crushed zone's width is the flat face's 50 mm to the cell
from 5 mm on, with either strength. Single histories after the first break are chance, and have no
order of convergence: only medians can be compared. Where a row of a cell is missing it was not
computed.
"""

SMOOTH = """Foam that crushes but does not break converges with about the first power of the cell,
by no clean order: mass points meet a curved or pointed impactor one by one, the wedge's tip finds
the first of them half a cell away, and the edges of a flat face are singular. The step's error is
below 1e-3 with the automatic step, and below 3e-6 in the motion.
"""

CANTILEVER = """A crack that stands still stores and releases what beam theory says, to 3 % with
twelve columns of bonds in an arm and to 16 % with six: halving the cell takes off more than
half of the error; that the tip is known to half a cell alone makes 2 to 3 % with cells of 5 mm.
The root matters most: without it, energies are 30 to 45 % off; shear alone is 4 to 9 %. A growing
crack does not creep but jumps by some cells, as brittle ones do: it starts within 10 % of the
release rate that the strain at a standing tip foretells and stops at about half of that. What it
dissipates, drag on the moving arms taken off, is what the beam's arms release: +5 % and -0.1 %. A
strip with everything half as large, cells too, takes half of it per area: toughness goes with the
cell. Only a quarter of it is the energy of the bonds that break; the rest is radiated, and
drag takes it. So the fracture column of the ledger is no measure of a crack's cost: that is about
6 times (K e_t^2 / 2) dx to start it. One caution: in strips of 60 mm arms in cells of 5 mm, cut
0.24 to 0.30 m deep, the cylinder of 20 mm mostly drove the arms' innermost columns down instead
of apart as it entered; the ledger's shear then fell far below zero, even in foam that cannot
break. The shear force of a face is not the gradient of an energy, which would explain it, but
that has not been tested against the variational one. Such runs are not shown.
"""

WAVES = """Without dashpots the front's place errs by a sixth of a cell, first order, from where
the plate meets the first mass point; its width is Airy's within 1.4 % in the coarsest cells, and
shrinks with the power 2/3 of the cell. With Table 6's dashpots the width is that of the
continuum, 158 mm, within 0.6 % in any cell: there the cells do not matter, and what is left of
the place, 2 mm or 0.3 %, is the dashpots' too and does not go away.
"""

"""The history of a run: one row per history interval, one column for each of `COLUMNS`.

The content of a history is defined only here. Its files, the energy ledger in pictures, tables and
on the page, and the rows that the engine writes on the device follow from these definitions.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from taichi_foam.errors import UserError, installed
from taichi_foam.formulas.traces import channel
from taichi_foam.units import SHOWN_UNITS

if TYPE_CHECKING:
    import pandas

Array = NDArray[np.float64]

CHANNEL_CLASS = 180
"""Channel frequency class [Hz] of the smoothed deceleration, see `formulas.traces`."""

FILTER = channel(CHANNEL_CLASS)
"""How this filter is named beside what it smoothed."""

ENERGIES_NOW: tuple[str, ...] = ("kinetic", "potential", "in_bonds", "in_shear", "in_room")
"""Energies [J] of the nodes, and energies stored in the bonds and in the cells' shear and room."""

BOOKED: tuple[str, ...] = (
    "bonds", "shear", "room", "dashpots",       # works: of bonds and cells, of their parts [J]
    "contact", "friction", "pieces", "base",    # works of contacts [J]
    "lost_by_bonds", "lost_by_shear", "lost_by_room",  # stored energy that breaking has lost [J]
    "held_by_contact", "held_by_friction",      # stored now in contacts of the impactor [J],
    "held_by_base", "held_by_base_friction",    # of floor and support,
    "held_by_pieces",                           # and of pieces
)  # fmt: skip
"""Quantities that strips of nodes accumulate as they step; works are positive where the nodes lose
energy. What contacts store is not accumulated, but is the value at the end of the last step."""


@dataclass(frozen=True)
class Loss:
    """Energy that a mechanism has dissipated since the first row.

    It is the work done on it, minus the increase of its stored energy, and minus the stored energy
    that is counted as fracture energy.

    work      booked work
    stored    energies that the mechanism stores
    fracture  booked stored energy that breaking has lost; empty: none
    besides   booked works that are parts of `work`, and belong to other columns
    """

    work: str
    stored: tuple[str, ...]
    fracture: str = ""
    besides: tuple[str, ...] = ()

    @property
    def members(self) -> tuple[str, ...]:
        """All that it is computed from."""
        fracture = (self.fracture,) if self.fracture else ()
        return (self.work, *self.besides, *self.stored, *fracture)


@dataclass(frozen=True)
class Column:
    """One column of the history.

    name        name in history.csv, ending in the unit
    unit        SI unit; empty for a count
    label       label in tables and on the page
    meaning     definition, including the sign
    source      what it is computed from: members of the engine's clock, body (the impactor) and
                turn ("body.y"), ENERGIES_NOW and BOOKED. A loss, or the sum of the members unless
                `analysis.columns.history_of` says otherwise
    turns       whether it exists only for an impactor that can rotate
    dissipates  whether it is dissipated energy, which can only grow
    is_integer  whether history.csv holds whole numbers
    shown       unit on the axes of figures, of `units.SHOWN_UNITS`; empty: the SI unit
    """

    name: str
    unit: str
    label: str
    meaning: str
    source: tuple[str, ...] | Loss
    turns: bool = False
    dissipates: bool = False
    is_integer: bool = False
    shown: str = ""

    @property
    def members(self) -> tuple[str, ...]:
        """All that it is computed from."""
        return self.source.members if isinstance(self.source, Loss) else self.source

    @property
    def in_ledger(self) -> bool:
        """Whether it is a positive term in the sum of energies that is conserved."""
        return self.unit == "J" and self.name != "residual_J"

    @property
    def axis(self) -> tuple[str, float]:
        """Label of an axis, and the factor that converts values to its unit."""
        factor = SHOWN_UNITS[self.shown] if self.shown else 1.0
        return f"{self.label} ({self.shown or self.unit})", factor


COLUMNS: Mapping[str, Column] = {column.name: column for column in (
    Column("time_s", "s", "time", "end of the row's interval", ("clock.time",)),
    Column("displacement_m", "m", "displacement",
           "of the impactor from its start, positive downwards; relative to a shaken base",
           ("body.y",), shown="cm"),
    Column("velocity_m_s", "m/s", "velocity",
           "of the impactor, positive downwards; relative to a shaken base", ("body.v",)),
    Column("deceleration_m_s2", "m/s²", "deceleration, raw",
           "of the impactor, positive upwards, mean over the row's interval; on a shaken base its "
           "absolute acceleration", ("clock.time", "body.v")),
    Column("deceleration_smoothed_m_s2", "m/s²", "deceleration",
           f"the same, smoothed: {FILTER}, zero phase", ("clock.time", "body.v")),
    Column("contact_force_N", "N", "contact force",
           "of the foam on the impactor, upwards", ("body.force",)),
    Column("displacement_x_m", "m", "sideways displacement",
           "of the impactor's centre of mass from its start, positive to the right", ("turn.x",),
           turns=True, shown="cm"),
    Column("velocity_x_m_s", "m/s", "sideways velocity",
           "of the impactor's centre of mass, positive to the right", ("turn.u",), turns=True),
    Column("angle_rad", "rad", "angle",
           "rotation of the impactor since its start, counter-clockwise", ("turn.angle",),
           turns=True, shown="°"),
    Column("spin_rad_s", "rad/s", "spin",
           "angular velocity of the impactor, counter-clockwise", ("turn.spin",), turns=True),
    Column("impactor_kinetic_J", "J", "impactor, kinetic",
           "kinetic energy of the impactor", ("body.v",)),
    Column("foam_kinetic_J", "J", "foam, kinetic",
           "kinetic energy of the mass points", ("kinetic",)),
    Column("strain_J", "J", "elastic strain", "stored in bonds", ("in_bonds",)),
    Column("shear_J", "J", "elastic shear", "stored in sheared cells", ("in_shear",)),
    Column("room_J", "J", "pressed cells", "stored in cells pressed below their packing limit",
           ("in_room",)),
    Column("contact_J", "J", "contacts", "stored in contacts of impactor, base and pieces",
           ("held_by_contact", "held_by_friction", "held_by_base", "held_by_base_friction",
            "held_by_pieces")),
    Column("crushing_J", "J", "crushing", "lost by normal stresses",
           Loss("bonds", ("in_bonds",), "lost_by_bonds", besides=("shear", "room", "dashpots")),
           dissipates=True),
    Column("folding_J", "J", "folding",
           "lost by pressed cells as crushing lowered their packing limit",
           Loss("room", ("in_room",), "lost_by_room"), dissipates=True),
    Column("shearing_J", "J", "shearing", "lost by shear stresses",
           Loss("shear", ("in_shear",), "lost_by_shear"), dissipates=True),
    Column("damping_J", "J", "damping", "lost in dashpots or by drag", ("dashpots",),
           dissipates=True),
    Column("friction_J", "J", "friction", "lost by friction on impactor and base",
           Loss("friction", ("held_by_friction", "held_by_base_friction")), dissipates=True),
    Column("contact_loss_J", "J", "contact, lost",
           "lost by contact with impactor and base, without friction",
           Loss("contact", ("held_by_contact", "held_by_base")), dissipates=True),
    Column("self_contact_J", "J", "pieces' contact", "lost by contact of pieces",
           Loss("pieces", ("held_by_pieces",)), dissipates=True),
    Column("fracture_J", "J", "fracture",
           "stored energy that bonds and cells lost when they broke, softened or separated",
           ("lost_by_bonds", "lost_by_shear", "lost_by_room"), dissipates=True),
    Column("base_J", "J", "base",
           "given to the base and to the stop under the impactor; negative: received from a "
           "crosshead or a pulse",
           ("base",)),
    Column("gravity_J", "J", "gravity",
           "potential energy of foam and impactor above that at the start",
           ("potential", "body.y")),
    Column("residual_J", "J", "unaccounted for",
           "sum of the ledger at the first row minus the present sum", ()),
    Column("broken_bonds", "", "broken bonds",
           "number of broken bonds", ("clock.broken",), is_integer=True),
    Column("dt_s", "s", "time step", "time step at the end of the row's interval", ("clock.step",)),
)}  # fmt: skip
"""Columns of the history by name, in order."""


@cache
def row_columns(turns: bool) -> tuple[str, ...]:
    """Entries of each row that the engine writes: all that columns are computed from, in order.

    turns: the scene's impactor can rotate.
    """
    columns = [column for column in COLUMNS.values() if turns or not column.turns]
    return tuple(dict.fromkeys(member for column in columns for member in column.members))


HISTORY_COLUMNS = tuple(name for name, column in COLUMNS.items() if not column.turns)
"""Names of the columns that every history has, in order."""

DISSIPATIONS = tuple(column for column in COLUMNS.values() if column.dissipates)
"""Ledger entries that can only grow."""

ENERGIES = tuple(column for column in COLUMNS.values() if column.unit == "J")
"""Ledger entries in order, and last the residual."""


@dataclass(frozen=True)
class Layer:
    """One part of the ledger as it is displayed: the columns that add up to it."""

    label: str
    colour: str
    columns: tuple[str, ...]


LEDGER = (
    Layer("motion of the impactor", "#B8BEC6", ("impactor_kinetic_J",)),
    Layer("foam, elastic and in motion", "#56B4E9",
          ("foam_kinetic_J", "strain_J", "shear_J", "room_J", "contact_J")),
    Layer("crushing", "#D55E00", ("crushing_J", "folding_J", "shearing_J")),
    Layer("cracks", "#AA4A8A", ("fracture_J",)),
    Layer("friction and damping", "#009E73",
          ("friction_J", "damping_J", "contact_loss_J", "self_contact_J")),
    Layer("base", "#5A5A5A", ("base_J",)),
)  # fmt: skip
"""Parts of the ledger in pictures, bottom to top, and on the page; gravity can be negative and is
left out."""


class History(dict[str, Array]):
    """Columns (n,) by name, in SI units; `history["time_s"]` is also `history.time_s`.

    The columns of COLUMNS come first. A history written by another version may lack some of them
    and have others; these are kept.

    Raises ValueError if the time column is missing or a column has another length; UserError on
    access to a column that does not exist.
    """

    def __init__(self, columns: Mapping[str, Array]) -> None:
        if "time_s" not in columns:
            raise ValueError("the history has no column time_s")
        if len({np.shape(column) for column in columns.values()}) != 1:
            raise ValueError("history columns differ in length")
        known = [name for name in COLUMNS if name in columns]
        names = dict.fromkeys([*known, *columns])
        super().__init__({name: columns[name] for name in names})

    def __missing__(self, name: str) -> Array:
        raise UserError(
            f"this history has no column {name!r}; it has {', '.join(self)}. "
            "Fix: if an earlier version wrote it, run its scene again"
        )

    def __getattr__(self, name: str) -> Array:
        if name in self:
            return self[name]
        raise AttributeError(f"this history has no column {name!r}; it has {', '.join(self)}")

    def __dir__(self) -> list[str]:
        return [*super().__dir__(), *self]

    def __repr__(self) -> str:
        rows = len(self["time_s"])
        last = f" until {self['time_s'][-1]:.4g} s" if rows else ""
        return f"<History of {rows} rows{last}, {len(self)} columns>"

    @property
    def units(self) -> dict[str, str]:
        """Unit of each column by name; empty for a count, or if unknown."""
        return {name: COLUMNS[name].unit if name in COLUMNS else "" for name in self}

    def to_pandas(self) -> pandas.DataFrame:
        """The history as a data frame; `frame.attrs["units"]` holds the units.

        Raises UserError if pandas is not installed.
        """
        with installed("a history as a data frame", "pandas"):
            import pandas
        frame = pandas.DataFrame(dict(self))
        frame.attrs["units"] = self.units
        return frame

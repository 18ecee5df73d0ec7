"""What the page's tables and curve show beside the run itself: names and units."""

from __future__ import annotations

from taichi_foam.analysis.measures import shown_in
from taichi_foam.records import history

FIGURES = tuple((one.key, one.name, one.unit, one.factor, one.digits) for one in shown_in("page"))
"""The figures of the page's table, in its order."""

ENERGIES = (
    *((layer.label, layer.columns) for layer in history.LEDGER),
    *((history.COLUMNS[name].label, (name,)) for name in ("gravity_J", "residual_J")),
)
"""The ledger as the page shows it: words, and the columns of the history that add up to them."""

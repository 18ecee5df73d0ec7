"""What the page's tables and curve show beside the run itself: names and units."""

from __future__ import annotations

from taichi_foam.analysis import quantities as q
from taichi_foam.records import history

QUANTITIES = (
    q.CREST, q.CREST_G, q.CREST_TIME, q.RAW_CREST, q.RAW_CREST_G, q.STRAIN,
    q.DISPLACEMENT, q.DURATION, q.PLATEAU, q.ENERGY_PER_VOLUME, q.ENERGY_ABSORBED, q.PEAK,
    q.RESULTANT_G, q.ANGLE, q.SPIN, q.SIDEWAYS,
    q.REBOUND, q.CHANGE, q.RESTITUTION, q.FALL, q.WIDTH, q.HEIGHT, q.PIECES, q.BROKEN, q.RESIDUAL,
    q.BASE_G, q.BASE_CHANGE, q.STRESS, q.STRESS_STRAIN,
)  # fmt: skip
"""The figures of the page's table, in its order."""

FIGURES = tuple((one.key, one.name, one.unit, one.factor, one.digits) for one in QUANTITIES)
"""The same as the page gets them."""

ENERGIES = (
    *((layer.label, layer.columns) for layer in history.LEDGER),
    *((history.COLUMNS[name].label, (name,)) for name in ("gravity_J", "residual_J")),
)
"""The ledger as the page shows it: words, and the columns of the history that add up to them."""

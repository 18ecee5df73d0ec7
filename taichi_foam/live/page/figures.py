"""What the page's tables and curve show beside the run itself: names and units."""

from __future__ import annotations

FIGURES = (
    ("max_displacement_m", "displacement", "cm", 1e2, 2),
    ("impact_duration_s", "duration", "ms", 1e3, 1),
    ("plateau_deceleration_m_s2", "plateau", "m/s²", 1.0, 1),
    ("energy_per_volume_J_m3", "energy per volume", "10⁵ J/m³", 1e-5, 2),
    ("energy_absorbed_J", "energy absorbed", "J", 1.0, 2),
    ("initial_peak_m_s2", "initial peak", "m/s²", 1.0, 0),
    ("rebound_velocity_m_s", "rebound", "m/s", 1.0, 2),
    ("crushed_width_m", "crushed width", "cm", 1e2, 1),
    ("crushed_height_m", "crushed height", "cm", 1e2, 1),
    ("pieces", "pieces", "", 1.0, 0),
    ("broken_bonds", "broken bonds", "", 1.0, 0),
    ("energy_residual", "unaccounted for", "%", 1e2, 3),
)
"""Key in `measures.summary`, words, unit, units in one SI unit, decimals."""

ENERGIES = (
    ("impactor_kinetic_J", "impactor, kinetic"),
    ("foam_kinetic_J", "foam, kinetic"),
    ("strain_J", "elastic strain"),
    ("crushing_J", "crushing"),
    ("shear_J", "shear"),
    ("damping_J", "damping"),
    ("friction_J", "friction"),
    ("contact_J", "impactor contact"),
    ("self_contact_J", "pieces' contact"),
    ("fracture_J", "fracture"),
    ("base_J", "base"),
    ("gravity_J", "gravity"),
    ("residual_J", "unaccounted for"),
)
"""Columns of the history and their words, in the ledger's order."""

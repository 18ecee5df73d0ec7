"""The history of a run: one row per history interval."""

from __future__ import annotations

ROW_COLUMNS = (
    "time", "step", "y", "v", "force", "broken", "kinetic", "stored", "potential", "fracture",
    "bonds", "shear", "dashpots", "drag", "impactor", "friction", "base", "self_contact",
)  # fmt: skip
"""What the engine writes for each row: time and step [s], the impactor's height [m], upward
velocity [m/s] and force [N], the broken bonds, and energies [J]: of the nodes, then works."""

HISTORY_COLUMNS = (
    "time_s",
    "displacement_m",
    "velocity_m_s",
    "deceleration_m_s2",  # mean over the row's interval, which ends at time_s
    "deceleration_smoothed_m_s2",  # CFC 180, zero phase
    "contact_force_N",
    "impactor_kinetic_J",
    "foam_kinetic_J",
    "strain_J",
    "crushing_J",
    "shear_J",
    "damping_J",
    "friction_J",
    "contact_J",
    "self_contact_J",
    "fracture_J",
    "base_J",
    "gravity_J",
    "residual_J",
    "broken_bonds",
    "dt_s",
)
"""Columns of the history, in order. Displacement (from its start), velocity, deceleration: of the
impactor, downwards."""

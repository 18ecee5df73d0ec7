"""Measures of an impact: figures, fragments, crushing, energy balance, warnings."""

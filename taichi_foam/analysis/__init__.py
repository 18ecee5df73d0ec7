"""Measures of an impact: figures, fragments, crushing, filters."""

"""Hand formulas of cushioning, on plain numbers and arrays: no scene, no foam, no file.

`energy` holds the energy balance, efficiency and the optimum of a cushion; `stress_energy` the
curve that joins cushions of all thicknesses; `envelope` the best of a family of foams; `fragility`
what a product withstands; `traces` filters and figures of measured pulses. Strain and stress are
engineering ones, positive in compression. Values are in SI units, decelerations in g where the name
says `g`.
"""

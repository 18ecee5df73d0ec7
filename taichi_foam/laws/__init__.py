"""The physics, as small functions that know no fields: each is tested alone against a closed form.

All are `ti.func`; lengths in m, stresses in Pa, tension positive.
"""

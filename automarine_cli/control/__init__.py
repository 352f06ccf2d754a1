"""Controllers designed from an identified model, with the margin that its uncertainty needs.

The way through: `targets` (the stacks that will be flown, one file each), `vehicles` (what may be in the pool, and how
it answers an output, in time and in frequency), `knowledge` (what the files say), `closed_loop` (flights and margins),
and `design` (gains and the verdict). `flown` compares a log with what was promised.
"""

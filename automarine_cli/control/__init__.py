"""Controllers designed from an identified model, with the margin that its uncertainty needs.

The way through: `knowledge` (what the files say) and `members` (what is uncertain, as vehicles that may be the one in
the pool), `actuators` and `plant` (how such a vehicle answers an output, in time and in frequency), `targets` (the
stacks that will be flown, one file each), `flight` (both together, step by step), `margins` (how far a loop is from
oscillating), `search` (gains) and `design` (the verdict). `flown` compares a log with what was promised.
"""

"""The next campaign: which runs tell most of what is still unsure, within what a day at the pool allows.

The way through: `limits` (what the day allows) and `known` (what the model and its diagnosis leave open), then
`candidates` (runs that might be made, put on paper by `layout`), `fitting` and `information` (what each would tell a
fit) and `rivals` (how far it splits two explanations), then `objectives` and `choose` (the search, which knows of no
vehicle), used by `selection` within the `budget`, and `schedule` (order, waits, battery). `campaign` does all of it;
`commands`, `rehearsal` and `comparison` make the files and the curves; `drive` and `consumption` are of the thrusters.
"""

"""The next campaign: which runs tell most of what is still unsure, within what a day at the pool allows.

The way through: `limits` (what the day allows) and `prior_results` (what the model and its diagnosis leave open), then
`candidates` (runs that might be made, what each costs, their order), `fitting` and `information` (what each would tell
a fit), `rivals` (how far it splits two explanations) and `selection` (the search, which knows of no vehicle).
`campaign` does all of it; `vehicle` has the thrusters, the battery's use and the files to play.
"""

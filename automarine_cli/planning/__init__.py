"""The next campaign: which runs tell most of what is still unsure, within what a day at the pool allows.

The way through: `limits` (what the day allows), `candidates` (runs that might be made, what each costs, their order),
`information` (what each would tell a fit), `prior_results` (what the model and its diagnosis leave open), `rivals` (how
far runs split two explanations) and `campaign` (the search, and what to expect); `vehicle` has the thrusters, the
battery's use and the files to play.
"""

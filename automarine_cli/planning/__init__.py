"""The next campaign: which runs tell most of what is still unsure, within what a day at the pool allows."""

"""Where simulation and measurement disagree, which missing effect explains it, and what it changes."""

"""Models: a motion with its inertia, terms and parameters; closed forms of models 1 to 3; files."""

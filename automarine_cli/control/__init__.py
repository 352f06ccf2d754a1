"""Controllers designed from an identified model, with the margin that its uncertainty needs."""

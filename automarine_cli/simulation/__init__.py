"""All runs and all parameter sets advance together with a fixed step; knows no effect by name."""

"""The shared core of every command: named steps, settings, whole-or-nothing output. Knows no physics."""

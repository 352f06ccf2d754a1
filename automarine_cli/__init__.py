"""automarine: identification of ROV and AUV yaw models from open-loop pool tests."""

__version__ = "0.1.0"

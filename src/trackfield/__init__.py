"""trackfield: from the readings of a field of cheap sensors to tracks."""

__version__ = "0.1.0"

"""Worlds that make readings: Sources like any other."""

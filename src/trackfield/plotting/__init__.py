"""Figures and animations as files; drawn with Matplotlib (extra `plot`)."""

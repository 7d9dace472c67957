"""Belief over time: Kalman filters, interacting models, robust weights, smoothing."""

"""Tracking groups: each tracks its own region, hands targets over, and the base unites them."""

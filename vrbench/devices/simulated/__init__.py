"""Simulated devices: they share a stage, in virtual time, and keep the truth of what they did."""

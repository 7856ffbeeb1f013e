"""Motions: head trajectories that are replayed, as versioned files and generators."""

"""Devices: what a headset, a motion-capture source and a robot must offer, and simulated ones."""

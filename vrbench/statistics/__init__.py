"""How sure the numbers are: bootstrap, paired differences, noise floor; pure functions."""

NORMAL_95 = 1.96
"""Standard deviations to either side of a normal distribution's mean that hold 95 % of it."""

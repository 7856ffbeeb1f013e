"""How sure the numbers are: bootstrap, paired differences, noise floor; pure functions."""

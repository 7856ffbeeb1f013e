"""When and where: clock, trimming, hand-eye, spatio-temporal fit, alignment. Pure functions."""

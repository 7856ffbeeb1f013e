"""When and where: clocks, trimming, hand-eye, alignment; pure functions."""

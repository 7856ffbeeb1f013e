"""When and where: clock, trimming, hand-eye, spatio-temporal fit, alignment. Pure functions.

In the order of their use: `trim` finds where the reference moves, `clock` (with `correlation` and
`drift`) when the two streams are, `interpolation` puts the reference at the estimate's times,
`excitation` and `handeye` start X and Y, `fit` (with `model`, `normal` and `blocks`) refines all of
it and says how well it is known, `alignment` lays one trajectory onto the other. `peaks` is the
paper's clock, for comparison. `checks` refuses what nothing can be estimated from; `noise`,
`robust`, `outliers` and `jumps` say which samples count, and for how much.
"""

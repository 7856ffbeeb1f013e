"""`python -m vrbench`: the command line."""

from vrbench.cli import main

main()

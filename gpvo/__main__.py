"""`python -m gpvo` is `gpvo`."""

from gpvo.commands.cli import main

main()

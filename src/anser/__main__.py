"""Entry point of `python -m anser`: the command line."""

from anser.cli import main

main()

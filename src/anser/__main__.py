"""`python -m anser`."""

from anser.cli import main

main()

"""`python -m maquette` is the command line."""

from .cli import main

main()

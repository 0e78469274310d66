"""`python -m maquette` is the command line."""

from .cli.main import main

main()

"""`python -m contactwrench`."""

from .cli.main import main

main()

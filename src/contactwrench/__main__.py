"""`python -m contactwrench`."""

from .cli import main

main()

"""`python -m kinid`: the command line."""

from kinid.cli import main

main()

"""`python -m raytwin`."""

from raytwin.cli import main

main()

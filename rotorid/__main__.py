"""``python -m rotorid`` is the command ``rotorid``."""

from rotorid.cli.main import main

main()

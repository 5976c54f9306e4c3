"""The command line: one file for each command, `rotorid.cli.main` is the entry point."""

"""Pipeline: one log to a result, a folder to a fleet result, and the command line."""

"""The commands of ``rotorid``, a file each; `pipeline.cli` puts them together."""

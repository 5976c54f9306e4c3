"""The folder that an analysis leaves behind, file by file."""

"""Imported first by the process that others are forked from: it ends with its server, also while it still imports."""

from api.work.confinement import die_with_parent

die_with_parent()

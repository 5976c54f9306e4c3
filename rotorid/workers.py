"""What worker processes import once for all, before they are given logs."""

PRELOAD = (
    "pipeline.execution.compiling",
    "pipeline.execution.executors",
    "pipeline.fleet.job",
    "pipeline.fleet.crafts",
    "reports.files.folder",
)

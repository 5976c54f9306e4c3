"""One log to one result: read, estimate, identify, validate, measure coverage, recommend."""

"""What all packages need: units, parameters, findings, tables and numbers for people, serialisation, compiled loops."""

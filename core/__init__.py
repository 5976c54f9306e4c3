"""What every package needs: units, parameters, findings, tables and numbers for people, serialisation, compiled loops."""

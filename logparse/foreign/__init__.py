"""Tables of other origin: motion capture, laboratory recorders, published benchmarks; CSV, Parquet and MATLAB files."""

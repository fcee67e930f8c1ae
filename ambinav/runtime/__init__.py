"""Tools that every package uses: errors, files, compiled kernels, threads, provenance."""

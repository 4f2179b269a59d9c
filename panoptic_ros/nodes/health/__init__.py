"""What nodes tell of themselves: diagnostics, notices, counts, clocks, previews."""

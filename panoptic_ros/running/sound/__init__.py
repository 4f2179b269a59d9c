"""Camera clocks of a run from recorded sound."""

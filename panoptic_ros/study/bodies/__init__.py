"""Studies of bodies from cameras and IMUs, beside the solver of Malleson et al. 2020."""

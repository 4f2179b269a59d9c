"""Studies of bodies from cameras and IMUs, next to the solver of Malleson et al. 2020."""

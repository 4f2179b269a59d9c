"""Studies of bodies from cameras and IMUs, compared with the solver of Malleson et al. 2020."""

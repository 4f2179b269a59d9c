"""One pose, or a window of them, solved from weighed targets: sums, kernels and covariances."""
